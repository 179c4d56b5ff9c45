/* What a test can tell the chip, a line each; bytes in hexadecimal. The chip answers "ready" before it reads.
 *
 *   nvs KEY BYTES          the flash holds this (before boot)
 *   break WHAT, mend WHAT  NVS fails at: init, full, commit, "set KEY", "get KEY"
 *   boot                   app_main
 *   run US                 time passes
 *   host BYTES             the host has sent this
 *   closed, open           the host does not read, or does again
 *   air MAC RSSI BYTES     a frame is heard
 *   press, release         the button
 *   espnow MOOD TIMES      well; no-memory or silent for so many sends
 *   alarms                 from now on each alarm that is set is told
 *   heap                   tells how often memory was taken */
#include <ctype.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fake.h"

enum { LINE_BYTES = 16384 };

void app_main(void);
void *__real_malloc(size_t n);
void *__wrap_malloc(size_t n);
void *__real_calloc(size_t count, size_t n);
void *__wrap_calloc(size_t count, size_t n);

static unsigned taken;
static bool booted;
static uint64_t run_until_us;
static char line[LINE_BYTES];
static uint8_t bytes[LINE_BYTES / 2];
static bool counting;

/* Linked with -Wl,--wrap=malloc,--wrap=calloc: whatever the shell and the drivers take. */
void *__wrap_malloc(size_t n) {
    taken += counting;
    return __real_malloc(n);
}

void *__wrap_calloc(size_t count, size_t n) {
    taken += counting;
    return __real_calloc(count, n);
}

void *fake_take_memory(size_t n) {
    return malloc(n);
}

void fake_tell_bytes(const char *what, const uint8_t *data, size_t n) {
    printf("%s", what);
    for (size_t i = 0; i < n; i++)
        printf("%02x", data[i]);
    printf("\n");
}

static size_t take_bytes(const char *text) {
    size_t n = 0;
    unsigned value;
    for (; isxdigit((unsigned char)text[2 * n]) && sscanf(text + 2 * n, "%2x", &value) == 1; n++)
        bytes[n] = (uint8_t)value;
    return n;
}

static void hear(const char *arguments) {
    uint8_t mac[6];
    int rssi_dbm, at;
    if (sscanf(arguments, "%*12s %d %n", &rssi_dbm, &at) != 1 || take_bytes(arguments) != sizeof mac)
        abort();
    memcpy(mac, bytes, sizeof mac);
    counting = false;
    fake_hear(mac, rssi_dbm, bytes, take_bytes(arguments + at));
    counting = booted;
}

static void put_in_flash(const char *arguments) {
    char key[16];
    int at;
    if (sscanf(arguments, "%15s %n", key, &at) == 1)
        fake_nvs_put(key, bytes, take_bytes(arguments + at));
}

static void set_espnow(const char *arguments) {
    char mood[16];
    unsigned times = 0;
    if (sscanf(arguments, "%15s %u", mood, &times) >= 1)
        fake_espnow_is(mood, times);
}

/* False: the line is not one of these. */
static bool obey_world(const char *command, const char *arguments) {
    if (strcmp(command, "host") == 0)
        fake_host_sends(bytes, take_bytes(arguments));
    else if (strcmp(command, "air") == 0)
        hear(arguments);
    else if (strcmp(command, "nvs") == 0)
        put_in_flash(arguments);
    else if (strcmp(command, "break") == 0 || strcmp(command, "mend") == 0)
        fake_nvs_breaks(arguments, command[0] == 'b');
    else if (strcmp(command, "closed") == 0 || strcmp(command, "open") == 0)
        fake_host_reads(command[0] == 'o');
    else if (strcmp(command, "press") == 0 || strcmp(command, "release") == 0)
        fake_press(command[0] == 'p');
    else if (strcmp(command, "espnow") == 0)
        set_espnow(arguments);
    else
        return false;
    return true;
}

static void obey(char *text) {
    text[strcspn(text, "\n")] = 0;
    char *arguments = text + strcspn(text, " ");
    if (*arguments != 0)
        *arguments++ = 0;
    if (obey_world(text, arguments))
        return;
    if (strcmp(text, "boot") == 0)
        booted = true;
    else if (strcmp(text, "run") == 0)
        run_until_us = fake_now_us + strtoull(arguments, NULL, 10);
    else if (strcmp(text, "alarms") == 0)
        fake_count_timers(true);
    else if (strcmp(text, "heap") == 0)
        printf("taken %u\n", taken);
    else
        abort();
}

void fake_read_commands(void) {
    while (fake_now_us >= run_until_us) {
        bool started = booted;
        printf("ready %" PRIu64 "\n", fake_now_us);
        fflush(stdout);
        if (fgets(line, sizeof line, stdin) == NULL)
            exit(0);
        obey(line);
        if (booted != started)
            return;
    }
}

int main(void) {
    while (!booted)
        fake_read_commands();
    counting = true;
    app_main();
    fake_run_radio_task();
    return 1;
}
