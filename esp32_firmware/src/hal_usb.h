/* The chip's own USB serial port (/dev/ttyACM0 on the host). Knows bytes, not messages. */
#ifndef HAL_USB_H
#define HAL_USB_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "esp_err.h"

esp_err_t hal_usb_start(void);

/* What the host sent, up to cap bytes; does not wait. */
size_t hal_usb_read(uint8_t *bytes, size_t cap);

/* All or nothing; waits a few milliseconds at most. False: the host does not read, the bytes are lost. */
bool hal_usb_write(const uint8_t *bytes, size_t n);

#endif
