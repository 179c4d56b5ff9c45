/* The ESP32-S3 that the shell runs on in tests: time, drivers and flash as small as they can be. Tests drive
 * it through lines on standard input and read lines on standard output; commands.c has the list. */
#ifndef FAKE_H
#define FAKE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Where code runs: what it may call depends on that. */
typedef enum { IN_TASK, IN_WIFI_TASK, IN_INTERRUPT } fake_place;
extern fake_place fake_where;
extern uint64_t fake_now_us;
/* Aborts, naming the function, unless the task is running. */
void fake_only_in_task(const char *function);

/* Takes from the heap, as the driver does. */
void *fake_take_memory(size_t n);

/* kernel.c */
void fake_pass_until(uint64_t until_us); /* what happens meanwhile, happens */
void fake_run_radio_task(void);
void fake_count_timers(bool tell);

/* radio.c: what is due by now, and when the next thing is */
uint64_t fake_radio_due_us(void);
void fake_radio_go_on(void);
void fake_hear(const uint8_t *mac, int rssi_dbm, const uint8_t *frame, size_t n);
void fake_espnow_is(const char *mood, unsigned times);

/* ports.c */
void fake_host_sends(const uint8_t *bytes, size_t n);
void fake_host_reads(bool reads);
void fake_press(bool down);

/* flash.c */
void fake_nvs_put(const char *key, const uint8_t *bytes, size_t n);
void fake_nvs_breaks(const char *what, bool broken);

/* commands.c: reads lines until one lets time pass, or the input ends and with it the program. */
void fake_read_commands(void);
void fake_tell_bytes(const char *what, const uint8_t *bytes, size_t n);

#endif
