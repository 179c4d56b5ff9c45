#include "hal_board.h"

#include "driver/gpio.h"
#include "driver/rmt_tx.h"

#ifndef HIPPOMAT_BUTTON_PIN
#define HIPPOMAT_BUTTON_PIN 0 /* BOOT */
#endif
#ifndef HIPPOMAT_LED_PIN
#define HIPPOMAT_LED_PIN 48 /* ESP32-S3-DevKitC-1 v1.0; v1.1 has 38 */
#endif
#ifndef HIPPOMAT_LED_RGB
#define HIPPOMAT_LED_RGB 1
#endif

enum { RMT_HZ = 10000000, SHORT = 3, LONG = 9 }; /* a bit of a WS2812 in 0.1 us: high and low */

static bool led_works;
static rmt_channel_handle_t channel;
static rmt_encoder_handle_t encoder;

static esp_err_t start_rgb(void) {
    rmt_tx_channel_config_t to_led = {
        .gpio_num = HIPPOMAT_LED_PIN,
        .clk_src = RMT_CLK_SRC_DEFAULT,
        .resolution_hz = RMT_HZ,
        .mem_block_symbols = 48,
        .trans_queue_depth = 1,
    };
    rmt_bytes_encoder_config_t bits = {
        .bit0 = {.level0 = 1, .duration0 = SHORT, .level1 = 0, .duration1 = LONG},
        .bit1 = {.level0 = 1, .duration0 = LONG, .level1 = 0, .duration1 = SHORT},
        .flags.msb_first = 1,
    };
    esp_err_t error = rmt_new_tx_channel(&to_led, &channel);
    if (error == ESP_OK)
        error = rmt_new_bytes_encoder(&bits, &encoder);
    return error == ESP_OK ? rmt_enable(channel) : error;
}

static esp_err_t start_pin(int pin, gpio_mode_t mode, gpio_pullup_t pull_up) {
    gpio_config_t config = {.pin_bit_mask = 1ULL << pin, .mode = mode, .pull_up_en = pull_up};
    return gpio_config(&config);
}

void hal_board_start(void) {
    start_pin(HIPPOMAT_BUTTON_PIN, GPIO_MODE_INPUT, GPIO_PULLUP_ENABLE);
    if (HIPPOMAT_LED_PIN < 0)
        return;
    esp_err_t error =
        HIPPOMAT_LED_RGB ? start_rgb() : start_pin(HIPPOMAT_LED_PIN, GPIO_MODE_OUTPUT, GPIO_PULLUP_DISABLE);
    led_works = error == ESP_OK;
}

bool hal_board_pressed(void) {
    return gpio_get_level(HIPPOMAT_BUTTON_PIN) == 0;
}

static void show_rgb(lamp_light light) {
    static uint8_t grb[3]; /* read while it is sent, 30 us */
    rmt_transmit_config_t once = {.flags.queue_nonblocking = 1};
    grb[0] = light.green;
    grb[1] = light.red;
    grb[2] = light.blue;
    rmt_transmit(channel, encoder, grb, sizeof grb, &once);
}

void hal_board_show(lamp_light light) {
    if (!led_works)
        return;
    if (HIPPOMAT_LED_RGB)
        show_rgb(light);
    else
        gpio_set_level(HIPPOMAT_LED_PIN, light.on);
}
