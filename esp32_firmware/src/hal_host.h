/* The port to the host: bytes both ways. Knows no messages and never waits. Two of them, one chosen when
 * compiling: hal_usb for the chip's own USB connector, hal_uart for boards that have a UART bridge only. */
#ifndef HAL_HOST_H
#define HAL_HOST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "esp_err.h"

enum { HAL_HOST_RING_BYTES = 4096 }; /* each way; a driver's default is shorter than a frame */

typedef struct {
    esp_err_t (*start)(void);
    /* What the host sent, up to cap bytes. */
    size_t (*read)(uint8_t *bytes, size_t cap);
    /* All or nothing. False: no room, try again later. */
    bool (*write)(const uint8_t *bytes, size_t n);
    /* Waits until all was sent, this long at most: before a restart. */
    void (*flush)(uint32_t limit_ms);
} hal_host;

extern const hal_host hal_usb, hal_uart;

#endif
