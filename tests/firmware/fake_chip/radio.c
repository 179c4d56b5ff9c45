/* Wi-Fi and ESP-NOW: one frame on the air at a time, its callback 300 us later or, if it sulks, never. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "esp_event.h"
#include "esp_netif.h"
#include "esp_now.h"
#include "fake.h"

enum { AIRTIME_US = 300, ALLOWED_CHANNELS = 11 };

static esp_now_recv_cb_t on_heard;
static esp_now_send_cb_t on_sent;
static esp_now_rate_config_t rate;
static uint8_t channel = 1;
static bool up;
static uint64_t done_us = UINT64_MAX;
static char mood[16] = "well";
static unsigned sulks;

#define AS_TOLD(name, ...)                                                                                   \
    esp_err_t name(__VA_ARGS__) {                                                                            \
        fake_only_in_task(__func__);                                                                         \
        return ESP_OK;                                                                                       \
    }
#pragma GCC diagnostic ignored "-Wunused-parameter"
AS_TOLD(esp_netif_init, void)
AS_TOLD(esp_event_loop_create_default, void)
AS_TOLD(esp_wifi_init, const wifi_init_config_t *config)
AS_TOLD(esp_wifi_set_storage, wifi_storage_t storage)
AS_TOLD(esp_wifi_set_mode, wifi_mode_t mode)
AS_TOLD(esp_wifi_start, void)
AS_TOLD(esp_now_add_peer, const esp_now_peer_info_t *peer)

esp_err_t esp_wifi_set_ps(wifi_ps_type_t type) {
    printf("power save %d\n", type);
    return ESP_OK;
}

esp_err_t esp_wifi_set_channel(uint8_t primary, wifi_second_chan_t second) {
    fake_only_in_task(__func__);
    if (primary > ALLOWED_CHANNELS)
        return ESP_FAIL;
    channel = primary;
    printf("channel %u\n", primary);
    return ESP_OK;
}

esp_err_t esp_wifi_get_channel(uint8_t *primary, wifi_second_chan_t *second) {
    *primary = channel;
    *second = WIFI_SECOND_CHAN_NONE;
    return ESP_OK;
}

esp_err_t esp_now_init(void) {
    fake_only_in_task(__func__);
    fake_take_memory(100);
    printf("espnow starts\n");
    up = true;
    return ESP_OK;
}

esp_err_t esp_now_deinit(void) {
    fake_only_in_task(__func__);
    printf("espnow ends\n");
    up = false;
    done_us = UINT64_MAX;
    return ESP_OK;
}

esp_err_t esp_now_register_recv_cb(esp_now_recv_cb_t callback) {
    on_heard = callback;
    return up ? ESP_OK : ESP_FAIL;
}

esp_err_t esp_now_register_send_cb(esp_now_send_cb_t callback) {
    on_sent = callback;
    return up ? ESP_OK : ESP_FAIL;
}

esp_err_t esp_now_set_peer_rate_config(const uint8_t *peer, esp_now_rate_config_t *config) {
    rate = *config;
    printf("rate: phymode %d, rate %d\n", config->phymode, config->rate);
    return ESP_OK;
}

static bool sulking(const char *how) {
    if (strcmp(mood, how) != 0 || sulks == 0)
        return false;
    sulks--;
    return true;
}

void fake_espnow_is(const char *how, unsigned times) {
    snprintf(mood, sizeof mood, "%s", how);
    sulks = times;
}

esp_err_t esp_now_send(const uint8_t *peer, const uint8_t *data, size_t length) {
    fake_only_in_task(__func__);
    if (!up)
        return ESP_ERR_ESPNOW_NOT_INIT;
    bool full = sulking("no-memory");
    printf("%s %" PRIu64 " ", full ? "refused" : "sent", fake_now_us);
    fake_tell_bytes("", data, length);
    if (full)
        return ESP_ERR_ESPNOW_NO_MEM;
    done_us = sulking("silent") ? UINT64_MAX : fake_now_us + AIRTIME_US;
    return ESP_OK;
}

uint64_t fake_radio_due_us(void) {
    return done_us;
}

void fake_radio_go_on(void) {
    if (fake_now_us < done_us)
        return;
    done_us = UINT64_MAX;
    fake_where = IN_WIFI_TASK;
    on_sent(NULL, ESP_NOW_SEND_SUCCESS);
    fake_where = IN_TASK;
}

/* Every pointer that the callback gets is good for its time only. */
void fake_hear(const uint8_t *mac, int rssi_dbm, const uint8_t *frame, size_t n) {
    uint8_t *source = malloc(6), *data = malloc(n > 0 ? n : 1);
    wifi_pkt_rx_ctrl_t *control = malloc(sizeof *control);
    memcpy(source, mac, 6);
    memcpy(data, frame, n);
    *control = (wifi_pkt_rx_ctrl_t){.rssi = rssi_dbm};
    esp_now_recv_info_t info = {.src_addr = source, .rx_ctrl = control};
    fake_where = IN_WIFI_TASK;
    on_heard(&info, data, (int)n);
    fake_where = IN_TASK;
    free(source);
    free(data);
    free(control);
}
