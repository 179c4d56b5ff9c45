/* ESP-NOW broadcasts at 6 Mbit/s OFDM. Decides nothing: frames and send results become events in a queue. */
#ifndef HAL_ESPNOW_H
#define HAL_ESPNOW_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "esp_err.h"
#include "frame.h"
#include "freertos/FreeRTOS.h"
#include "freertos/queue.h"

typedef enum { AIR_HEARD, AIR_DONE } air_event_kind;

typedef struct {
    int64_t time_us;
    air_event_kind kind;
    bool ok;         /* AIR_DONE */
    int8_t rssi_dbm; /* AIR_HEARD, as are the rest */
    uint8_t length;
    uint8_t frame[RC_MAX_FRAME];
} air_event;

/* events: of air_event; lives as long as the program. */
esp_err_t hal_espnow_start(QueueHandle_t events, uint8_t channel);
esp_err_t hal_espnow_set_channel(uint8_t channel);

/* True: the frame was taken, an AIR_DONE will normally follow. */
bool hal_espnow_send(const uint8_t *frame, size_t n);

/* Frames heard that found the queue full, since the last call. */
uint32_t hal_espnow_take_dropped(void);

#endif
