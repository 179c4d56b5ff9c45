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

enum {
    BACK_OFF_US = 2000, /* doubled with every further failure, five times */
    BACK_OFF_DOUBLINGS = 5,
    FAILED_LIMIT = 12,    /* sends in a row that failed: 0.5 s */
    UNANSWERED_LIMIT = 20 /* sends in a row without a callback: 1 s */
};

static const char *const TAG = "espnow";
static const uint8_t BROADCAST[ESP_NOW_ETH_ALEN] = {0xff, 0xff, 0xff, 0xff, 0xff, 0xff};

static QueueHandle_t events;
static esp_now_rate_config_t rate;
static atomic_uint dropped;
static atomic_uint unanswered;
static unsigned failed;
static uint64_t free_us;

/* ---- callbacks: in the Wi-Fi task. Copy, queue without waiting, count what does not fit. --------------- */

static void post(const hal_event *event) {
    if (xQueueSend(events, event, 0) != pdTRUE)
        atomic_fetch_add(&dropped, 1);
}

static void on_heard(const esp_now_recv_info_t *info, const uint8_t *data, int length) {
    if (length <= 0 || length > RC_MAX_FRAME) {
        atomic_fetch_add(&dropped, 1);
        return;
    }
    hal_event event = {
        .time_us = (uint64_t)esp_timer_get_time(),
        .kind = EVENT_HEARD,
        .rssi_dbm = (int8_t)info->rx_ctrl->rssi,
        .length = (uint8_t)length,
    };
    memcpy(event.mac, info->src_addr, RC_MAC_BYTES);
    memcpy(event.frame, data, (size_t)length);
    post(&event);
}

#if ESP_IDF_VERSION >= ESP_IDF_VERSION_VAL(5, 5, 0)
static void on_sent(const esp_now_send_info_t *info, esp_now_send_status_t status) {
#else
static void on_sent(const uint8_t *info, esp_now_send_status_t status) {
#endif
    (void)info;
    hal_event event = {
        .time_us = (uint64_t)esp_timer_get_time(),
        .kind = EVENT_SENT,
        .ok = status == ESP_NOW_SEND_SUCCESS,
    };
    atomic_store(&unanswered, 0);
    post(&event); /* one that is lost is made up for by the radio core's timeout */
}

/* ---- start --------------------------------------------------------------------------------------------- */

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
    TRY(esp_now_register_send_cb(on_sent));
    esp_now_peer_info_t peer = {.channel = 0, .ifidx = WIFI_IF_STA, .encrypt = false};
    memcpy(peer.peer_addr, BROADCAST, sizeof BROADCAST);
    TRY(esp_now_add_peer(&peer));
    TRY(esp_now_set_peer_rate_config(BROADCAST, &rate));
    return ESP_OK;
}

/* The default of 1 Mbit/s would need six times the airtime. */
static esp_now_rate_config_t ofdm(uint8_t rate_mbps) {
    return (esp_now_rate_config_t){
        .phymode = WIFI_PHY_MODE_11G,
        .rate = rate_mbps == 24   ? WIFI_PHY_RATE_24M
                : rate_mbps == 12 ? WIFI_PHY_RATE_12M
                                  : WIFI_PHY_RATE_6M,
    };
}

esp_err_t hal_espnow_start(QueueHandle_t queue, uint8_t rate_mbps) {
    events = queue;
    rate = ofdm(rate_mbps);
    wifi_init_config_t config = WIFI_INIT_CONFIG_DEFAULT();
    TRY(esp_netif_init());
    TRY(esp_event_loop_create_default());
    TRY(esp_wifi_init(&config));
    TRY(esp_wifi_set_storage(WIFI_STORAGE_RAM));
    TRY(esp_wifi_set_mode(WIFI_MODE_STA));
    TRY(esp_wifi_start());
    TRY(esp_wifi_set_ps(WIFI_PS_NONE));
    TRY(start_espnow());
    return ESP_OK;
}

uint8_t hal_espnow_channel(void) {
    uint8_t channel = 0;
    wifi_second_chan_t second;
    esp_wifi_get_channel(&channel, &second);
    return channel;
}

bool hal_espnow_tune(uint8_t channel) {
    return esp_wifi_set_channel(channel, WIFI_SECOND_CHAN_NONE) == ESP_OK;
}

/* ---- sending ------------------------------------------------------------------------------------------- */

static void start_anew(void) {
    ESP_LOGW(TAG, "start anew: %u sends failed, %u without an answer", failed, atomic_load(&unanswered));
    failed = 0;
    atomic_store(&unanswered, 0);
    esp_now_deinit();
    if (start_espnow() != ESP_OK)
        ESP_LOGE(TAG, "ESP-NOW does not start again"); /* the next sends fail: tried again after them */
}

static void back_off(uint64_t now_us) {
    unsigned doublings = failed < BACK_OFF_DOUBLINGS ? failed : BACK_OFF_DOUBLINGS;
    free_us = now_us + ((uint64_t)BACK_OFF_US << doublings);
    failed++;
}

bool hal_espnow_send(uint64_t now_us, const uint8_t *frame, size_t n) {
    if (failed >= FAILED_LIMIT || atomic_load(&unanswered) >= UNANSWERED_LIMIT)
        start_anew();
    if (esp_now_send(BROADCAST, frame, n) != ESP_OK) {
        back_off(now_us);
        return false;
    }
    failed = 0;
    atomic_fetch_add(&unanswered, 1);
    return true;
}

uint64_t hal_espnow_free_us(void) {
    return free_us;
}

uint32_t hal_espnow_take_dropped(void) {
    return atomic_exchange(&dropped, 0);
}
