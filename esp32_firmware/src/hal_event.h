/* What wakes the radio task: one queue for frames heard, send results and the alarm clock. */
#ifndef HAL_EVENT_H
#define HAL_EVENT_H

#include "freertos/FreeRTOS.h"
#include "freertos/queue.h"
#include "seal.h"

typedef enum { EVENT_HEARD, EVENT_SENT, EVENT_WAKE } hal_event_kind;

typedef struct {
    uint64_t time_us;
    hal_event_kind kind;
    bool ok;         /* EVENT_SENT: it was put on the air */
    int8_t rssi_dbm; /* EVENT_HEARD, as are the rest */
    uint8_t length;
    uint8_t mac[RC_MAC_BYTES];
    uint8_t frame[RC_MAX_FRAME];
} hal_event;

#endif
