#include "hal_espnow.h"

#include <stdatomic.h>
#include <string.h>

#include "esp_event.h"
#include "esp_idf_version.h"
#include "esp_log.h"
#include "esp_netif.h"
#include "esp_now.h"
#include "esp_timer.h"
#include "esp_wifi.h"
#include "freertos/task.h"

enum { NO_MEM_RETRIES = 3, NO_MEM_BEFORE_RESTART = 20 };

static const char *TAG = "espnow";
static const uint8_t BROADCAST[ESP_NOW_ETH_ALEN] = {0xff, 0xff, 0xff, 0xff, 0xff, 0xff};

static QueueHandle_t air_events;
static atomic_uint dropped;
static unsigned out_of_memory; /* sends in a row that found ESP-NOW's buffers full */

/* Both callbacks run in the Wi-Fi task: copy, queue without waiting, count what does not fit. */

static void on_heard(const esp_now_recv_info_t *info, const uint8_t *data, int length) {
    if (length <= 0 || length > RC_MAX_FRAME) {
        atomic_fetch_add(&dropped, 1);
        return;
    }
    air_event event = {
        .time_us = esp_timer_get_time(),
        .kind = AIR_HEARD,
        .rssi_dbm = (int8_t)info->rx_ctrl->rssi,
        .length = (uint8_t)length,
    };
    memcpy(event.frame, data, (size_t)length);
    if (xQueueSend(air_events, &event, 0) != pdTRUE)
        atomic_fetch_add(&dropped, 1);
}

#if ESP_IDF_VERSION >= ESP_IDF_VERSION_VAL(5, 5, 0)
static void on_done(const esp_now_send_info_t *info, esp_now_send_status_t status) {
#else
static void on_done(const uint8_t *info, esp_now_send_status_t status) {
#endif
    (void)info;
    air_event event = {
        .time_us = esp_timer_get_time(),
        .kind = AIR_DONE,
        .ok = status == ESP_NOW_SEND_SUCCESS,
    };
    /* One that is lost here is made up for by the radio core's timeout. */
    if (xQueueSend(air_events, &event, 0) != pdTRUE)
        atomic_fetch_add(&dropped, 1);
}

#define TRY(call)                                                                                            \
    do {                                                                                                     \
        esp_err_t error_ = (call);                                                                           \
        if (error_ != ESP_OK) {                                                                              \
            ESP_LOGE(TAG, "%s: %s", #call, esp_err_to_name(error_));                                         \
            return error_;                                                                                   \
        }                                                                                                    \
    } while (0)

static esp_err_t start_espnow(void) {
    TRY(esp_now_init());
    TRY(esp_now_register_recv_cb(on_heard));
    TRY(esp_now_register_send_cb(on_done));
    esp_now_peer_info_t peer = {.channel = 0, .ifidx = WIFI_IF_STA, .encrypt = false};
    memcpy(peer.peer_addr, BROADCAST, sizeof BROADCAST);
    TRY(esp_now_add_peer(&peer));
    /* The default of 1 Mbit/s would need six times the airtime. */
    esp_now_rate_config_t rate = {
        .phymode = WIFI_PHY_MODE_11G,
        .rate = WIFI_PHY_RATE_6M,
        .ersu = false,
        .dcm = false,
    };
    return esp_now_set_peer_rate_config(BROADCAST, &rate);
}

esp_err_t hal_espnow_start(QueueHandle_t events, uint8_t channel) {
    air_events = events;
    TRY(esp_netif_init());
    TRY(esp_event_loop_create_default());
    wifi_init_config_t config = WIFI_INIT_CONFIG_DEFAULT();
    TRY(esp_wifi_init(&config));
    TRY(esp_wifi_set_storage(WIFI_STORAGE_RAM));
    TRY(esp_wifi_set_mode(WIFI_MODE_STA));
    TRY(esp_wifi_start());
    TRY(esp_wifi_set_ps(WIFI_PS_NONE));
    hal_espnow_set_channel(channel); /* says so if it cannot; a boot loop would help nobody */
    TRY(start_espnow());
    return ESP_OK;
}

esp_err_t hal_espnow_set_channel(uint8_t channel) {
    TRY(esp_wifi_set_channel(channel, WIFI_SECOND_CHAN_NONE));
    return ESP_OK;
}

static void restart_espnow(void) {
    ESP_LOGW(TAG, "restart after %u sends without memory", out_of_memory);
    out_of_memory = 0;
    esp_now_deinit();
    if (start_espnow() != ESP_OK)
        ESP_LOGE(TAG, "ESP-NOW does not start again");
}

bool hal_espnow_send(const uint8_t *frame, size_t n) {
    esp_err_t error = esp_now_send(BROADCAST, frame, n);
    for (int retry = 0; error == ESP_ERR_ESPNOW_NO_MEM && retry < NO_MEM_RETRIES; retry++) {
        vTaskDelay(1);
        error = esp_now_send(BROADCAST, frame, n);
    }
    out_of_memory = error == ESP_ERR_ESPNOW_NO_MEM ? out_of_memory + 1 : 0;
    if (out_of_memory >= NO_MEM_BEFORE_RESTART)
        restart_espnow();
    return error == ESP_OK;
}

uint32_t hal_espnow_take_dropped(void) {
    return atomic_exchange(&dropped, 0);
}
