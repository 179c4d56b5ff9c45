/* UART0 behind a board's USB bridge (/dev/ttyUSB0 on the host), 921600 baud: about 90 kB/s. */
#include "driver/uart.h"
#include "freertos/FreeRTOS.h"
#include "hal_host.h"
#include "soc/uart_pins.h"

enum { BAUD = 921600, MARGIN = 64 /* of the driver's own in its ring */ };

static const uart_port_t PORT = UART_NUM_0;

static esp_err_t host_start(void) {
    uart_config_t config = {
        .baud_rate = BAUD,
        .data_bits = UART_DATA_8_BITS,
        .parity = UART_PARITY_DISABLE,
        .stop_bits = UART_STOP_BITS_1,
        .flow_ctrl = UART_HW_FLOWCTRL_DISABLE,
        .source_clk = UART_SCLK_DEFAULT,
    };
    esp_err_t error = uart_driver_install(PORT, HAL_HOST_RING_BYTES, HAL_HOST_RING_BYTES, 0, NULL, 0);
    if (error == ESP_OK)
        error = uart_param_config(PORT, &config);
    if (error == ESP_OK) /* without a console the boot loader takes the pins away from the UART */
        error = uart_set_pin(PORT, U0TXD_GPIO_NUM, U0RXD_GPIO_NUM, UART_PIN_NO_CHANGE, UART_PIN_NO_CHANGE);
    return error;
}

static size_t host_read(uint8_t *bytes, size_t cap) {
    int n = uart_read_bytes(PORT, bytes, (uint32_t)cap, 0);
    return n > 0 ? (size_t)n : 0;
}

/* uart_write_bytes would wait for room without limit: it is asked for first. */
static bool host_write(const uint8_t *bytes, size_t n) {
    size_t room = 0;
    return uart_get_tx_buffer_free_size(PORT, &room) == ESP_OK && room >= n + MARGIN &&
           uart_write_bytes(PORT, bytes, n) == (int)n;
}

static void host_flush(uint32_t limit_ms) {
    uart_wait_tx_done(PORT, pdMS_TO_TICKS(limit_ms));
}

const hal_host hal_uart = {.start = host_start, .read = host_read, .write = host_write, .flush = host_flush};
