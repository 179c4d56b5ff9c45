#include "hal_usb.h"

#include "driver/usb_serial_jtag.h"
#include "freertos/FreeRTOS.h"

enum { RING_BYTES = 4096, WRITE_TIMEOUT_MS = 5 }; /* the default rings of 256 are shorter than a frame */

static bool host_reads = true;

esp_err_t hal_usb_start(void) {
    usb_serial_jtag_driver_config_t config = {
        .tx_buffer_size = RING_BYTES,
        .rx_buffer_size = RING_BYTES,
    };
    return usb_serial_jtag_driver_install(&config);
}

size_t hal_usb_read(uint8_t *bytes, size_t cap) {
    int n = usb_serial_jtag_read_bytes(bytes, (uint32_t)cap, 0);
    return n > 0 ? (size_t)n : 0;
}

bool hal_usb_write(const uint8_t *bytes, size_t n) {
    /* Waits only while the host reads: a closed port must not slow the radio down. */
    TickType_t wait = host_reads ? pdMS_TO_TICKS(WRITE_TIMEOUT_MS) : 0;
    host_reads = usb_serial_jtag_write_bytes(bytes, n, wait) == (int)n;
    return host_reads;
}
