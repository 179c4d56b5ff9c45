/* The chip's own USB serial port (/dev/ttyACM0 on the host). */
#include "driver/usb_serial_jtag.h"
#include "freertos/FreeRTOS.h"
#include "hal_host.h"

static esp_err_t host_start(void) {
    usb_serial_jtag_driver_config_t config = {
        .tx_buffer_size = HAL_HOST_RING_BYTES,
        .rx_buffer_size = HAL_HOST_RING_BYTES,
    };
    return usb_serial_jtag_driver_install(&config);
}

static size_t host_read(uint8_t *bytes, size_t cap) {
    int n = usb_serial_jtag_read_bytes(bytes, (uint32_t)cap, 0);
    return n > 0 ? (size_t)n : 0;
}

static bool host_write(const uint8_t *bytes, size_t n) {
    return usb_serial_jtag_write_bytes(bytes, n, 0) == (int)n;
}

static void host_flush(uint32_t limit_ms) {
    usb_serial_jtag_wait_tx_done(pdMS_TO_TICKS(limit_ms));
}

const hal_host hal_usb = {.start = host_start, .read = host_read, .write = host_write, .flush = host_flush};
