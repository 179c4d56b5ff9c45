/* The two ports to the host (one pair of rings, whichever is built in), the button, the LED. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "driver/gpio.h"
#include "driver/rmt_tx.h"
#include "driver/uart.h"
#include "driver/usb_serial_jtag.h"
#include "fake.h"

enum { RING_BYTES = 4096, BYTES_PER_MS = 800 };

static uint8_t from_host[RING_BYTES];
static size_t from_host_n;
static size_t to_host_n;
static bool reads = true;
static uint64_t drained_us;
static bool pressed;
static bool installed;

static void install(size_t to_host, size_t to_chip) {
    fake_only_in_task(__func__);
    if (installed || to_host != RING_BYTES || to_chip != RING_BYTES)
        abort();
    fake_take_memory(to_host);
    installed = true;
}

/* What a host that reads has taken since. */
static void drain(void) {
    uint64_t taken = (fake_now_us - drained_us) * BYTES_PER_MS / 1000;
    drained_us = fake_now_us;
    if (reads)
        to_host_n = taken < to_host_n ? to_host_n - (size_t)taken : 0;
}

static int write_all(const void *bytes, size_t n) {
    fake_only_in_task(__func__);
    drain();
    if (to_host_n + n > RING_BYTES)
        return 0;
    to_host_n += n;
    fake_tell_bytes("host ", bytes, n);
    return (int)n;
}

static int read_some(void *bytes, size_t cap) {
    fake_only_in_task(__func__);
    size_t n = from_host_n < cap ? from_host_n : cap;
    memcpy(bytes, from_host, n);
    from_host_n -= n;
    memmove(from_host, from_host + n, from_host_n);
    return (int)n;
}

static void wait_until_drained(TickType_t wait) {
    for (TickType_t i = 0; i < wait && to_host_n > 0; i++) {
        fake_pass_until(fake_now_us + 1000);
        drain();
    }
    printf("flushed, %zu bytes left\n", to_host_n);
}

void fake_host_sends(const uint8_t *bytes, size_t n) {
    if (from_host_n + n > RING_BYTES)
        return;
    memcpy(from_host + from_host_n, bytes, n);
    from_host_n += n;
}

void fake_host_reads(bool now_reads) {
    drain();
    reads = now_reads;
}

/* ---- USB ----------------------------------------------------------------------------------------------- */

esp_err_t usb_serial_jtag_driver_install(usb_serial_jtag_driver_config_t *config) {
    install(config->tx_buffer_size, config->rx_buffer_size);
    return ESP_OK;
}

int usb_serial_jtag_read_bytes(void *buffer, uint32_t length, TickType_t wait) {
    return wait == 0 ? read_some(buffer, length) : -1;
}

int usb_serial_jtag_write_bytes(const void *source, size_t size, TickType_t wait) {
    return wait == 0 ? write_all(source, size) : -1;
}

esp_err_t usb_serial_jtag_wait_tx_done(TickType_t wait) {
    wait_until_drained(wait);
    return ESP_OK;
}

/* ---- UART ---------------------------------------------------------------------------------------------- */

esp_err_t uart_driver_install(uart_port_t port, int rx, int tx, int events, QueueHandle_t *queue, int flags) {
    (void)events;
    (void)flags;
    install((size_t)tx, (size_t)rx);
    return port == UART_NUM_0 && queue == NULL ? ESP_OK : ESP_FAIL;
}

esp_err_t uart_param_config(uart_port_t port, const uart_config_t *config) {
    return port == UART_NUM_0 && config->baud_rate == 921600 ? ESP_OK : ESP_FAIL;
}

esp_err_t uart_set_pin(uart_port_t port, int tx, int rx, int rts, int cts) {
    return port == UART_NUM_0 && tx == 43 && rx == 44 && rts < 0 && cts < 0 ? ESP_OK : ESP_FAIL;
}

int uart_read_bytes(uart_port_t port, void *buffer, uint32_t length, TickType_t wait) {
    return port == UART_NUM_0 && wait == 0 ? read_some(buffer, length) : -1;
}

esp_err_t uart_get_tx_buffer_free_size(uart_port_t port, size_t *size) {
    drain();
    *size = port == UART_NUM_0 ? RING_BYTES - to_host_n : 0;
    return ESP_OK;
}

/* The driver would wait here without limit. */
int uart_write_bytes(uart_port_t port, const void *source, size_t size) {
    int n = port == UART_NUM_0 ? write_all(source, size) : 0;
    if (n == 0)
        abort();
    return n;
}

esp_err_t uart_wait_tx_done(uart_port_t port, TickType_t wait) {
    (void)port;
    wait_until_drained(wait);
    return ESP_OK;
}

/* ---- the button and the LED ---------------------------------------------------------------------------- */

void fake_press(bool down) {
    pressed = down;
}

esp_err_t gpio_config(const gpio_config_t *config) {
    bool is_button = config->pin_bit_mask == 1 && config->mode == GPIO_MODE_INPUT;
    return !is_button || config->pull_up_en == GPIO_PULLUP_ENABLE ? ESP_OK : ESP_FAIL;
}

int gpio_get_level(gpio_num_t pin) {
    fake_only_in_task(__func__);
    return pin == 0 && pressed ? 0 : 1;
}

esp_err_t gpio_set_level(gpio_num_t pin, uint32_t level) {
    printf("led %" PRIu64 " pin %d %u\n", fake_now_us, pin, level);
    return ESP_OK;
}

esp_err_t rmt_new_tx_channel(const rmt_tx_channel_config_t *config, rmt_channel_handle_t *channel) {
    *channel = fake_take_memory(100);
    return config->resolution_hz == 10000000 ? ESP_OK : ESP_FAIL;
}

esp_err_t rmt_new_bytes_encoder(const rmt_bytes_encoder_config_t *config, rmt_encoder_handle_t *encoder) {
    *encoder = fake_take_memory(100);
    return config->flags.msb_first ? ESP_OK : ESP_FAIL;
}

esp_err_t rmt_enable(rmt_channel_handle_t channel) {
    return channel != NULL ? ESP_OK : ESP_FAIL;
}

esp_err_t rmt_transmit(rmt_channel_handle_t channel, rmt_encoder_handle_t encoder, const void *payload,
                       size_t n, const rmt_transmit_config_t *config) {
    const uint8_t *grb = payload;
    fake_only_in_task(__func__);
    if (channel == NULL || encoder == NULL || n != 3 || !config->flags.queue_nonblocking)
        abort();
    printf("led %" PRIu64 " rgb %u %u %u\n", fake_now_us, grb[1], grb[0], grb[2]);
    return ESP_OK;
}
