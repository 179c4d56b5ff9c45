/* ESP-NOW broadcasts, OFDM. Decides nothing about frames: those heard, and send results, become events in a
 * queue. Looks after the driver: backs off when it has no memory, starts it anew as the last resort. */
#ifndef HAL_ESPNOW_H
#define HAL_ESPNOW_H

#include "esp_err.h"
#include "hal_event.h"

/* events: of hal_event; lives as long as the program. rate_mbps: 6, 12 or 24. */
esp_err_t hal_espnow_start(QueueHandle_t events, uint8_t rate_mbps);

uint8_t hal_espnow_channel(void);
/* False: the region does not allow it; the channel stays as it was. */
bool hal_espnow_tune(uint8_t channel);

/* True: the frame was taken; an EVENT_SENT will normally follow. */
bool hal_espnow_send(uint64_t now_us, const uint8_t *frame, size_t n);
/* Nothing should be sent before: the driver was short of memory. */
uint64_t hal_espnow_free_us(void);

/* Events that found the queue full, since the last call. */
uint32_t hal_espnow_take_dropped(void);

#endif
