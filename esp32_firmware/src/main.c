/* The ESP32-S3 around the radio core: one task owns the core and carries bytes and frames to and from it. */
#include <string.h>

#include "esp_log.h"
#include "esp_mac.h"
#include "esp_random.h"
#include "esp_system.h"
#include "esp_task_wdt.h"
#include "esp_timer.h"
#include "freertos/FreeRTOS.h"
#include "freertos/queue.h"
#include "freertos/task.h"
#include "hal_espnow.h"
#include "hal_nvs.h"
#include "hal_usb.h"
#include "radio_core.h"

#ifndef HIPPOMAT_GIT_HASH
#define HIPPOMAT_GIT_HASH unknown
#endif
#define TEXT_OF(token) #token
#define TEXT(token) TEXT_OF(token)

/* Core 1, above everything there; the Wi-Fi task has core 0. */
enum { RADIO_STACK_BYTES = 12288, RADIO_PRIORITY = 20, RADIO_CORE = 1, AIR_EVENTS = 48, USB_CHUNK = 1024 };

_Static_assert(USB_CHUNK >= (int)RC_LINK_MAX_ENCODED, "a chunk holds the longest message");

static const char *TAG = "radio";
static rc_radio radio;
static QueueHandle_t air_events;

static uint64_t now_us(void) {
    return (uint64_t)esp_timer_get_time();
}

static void take_air_event(const air_event *event) {
    if (event->kind == AIR_HEARD)
        rc_air_rx(&radio, (uint64_t)event->time_us, event->rssi_dbm, event->frame, event->length);
    else
        rc_air_done(&radio, (uint64_t)event->time_us, event->ok);
}

static void send_to_air(void) {
    uint8_t frame[RC_MAX_FRAME];
    size_t n = rc_air_tx(&radio, now_us(), frame);
    if (n > 0 && !hal_espnow_send(frame, n))
        rc_air_done(&radio, now_us(), false);
}

static void read_from_host(void) {
    uint8_t chunk[USB_CHUNK];
    size_t n = hal_usb_read(chunk, sizeof chunk);
    rc_usb_rx(&radio, now_us(), chunk, n);
}

static void write_to_host(void) {
    uint8_t chunk[USB_CHUNK];
    size_t n = rc_usb_tx(&radio, chunk, sizeof chunk);
    if (n == 0 || hal_usb_write(chunk, n))
        return;
    uint32_t messages = 0;
    for (size_t i = 0; i < n; i++)
        messages += chunk[i] == 0;
    rc_lost(&radio, messages);
}

/* The core may have adopted the identity that its host named. */
static void keep_identity(rc_identity *stored) {
    rc_identity current = rc_identity_of(&radio);
    if (memcmp(&current, stored, sizeof current) == 0)
        return;
    bool tuned = current.channel == stored->channel || hal_espnow_set_channel(current.channel) == ESP_OK;
    if (!tuned) {
        ESP_LOGE(TAG, "channel %u is not available here", current.channel);
        current.channel = stored->channel;
        radio.config.identity = current; /* so that the status names the channel in use */
    }
    /* A listener follows its host; only a robot's identity outlives a reboot. */
    if (tuned && current.robot != RC_NO_ROBOT && hal_nvs_store_identity(current) != ESP_OK)
        ESP_LOGE(TAG, "identity not stored: the host will name it again after a reboot");
    *stored = current;
}

static void radio_task(void *unused) {
    (void)unused;
    rc_identity stored = radio.config.identity;
    ESP_ERROR_CHECK(esp_task_wdt_add(NULL));
    for (;;) {
        air_event event;
        /* Waits for one tick at most; then everything that has come meanwhile. */
        TickType_t wait = 1;
        for (int taken = 0; taken < AIR_EVENTS && xQueueReceive(air_events, &event, wait) == pdTRUE;
             taken++) {
            take_air_event(&event);
            wait = 0;
        }
        rc_lost(&radio, hal_espnow_take_dropped());
        read_from_host();
        keep_identity(&stored);
        rc_tick(&radio, now_us());
        send_to_air();
        write_to_host();
        esp_task_wdt_reset();
    }
}

static rc_config describe(rc_identity identity, uint32_t boot_counter) {
    rc_config config = {
        .about =
            {
                .boot_id = esp_random(),
                .boot_counter = boot_counter,
                .reset_reason = (uint8_t)esp_reset_reason(),
                .firmware = "hippomat 0.1.0",
            },
        .identity = identity,
    };
    /* Exactly filled fields have no closing zero. */
    const char git_hash[] = TEXT(HIPPOMAT_GIT_HASH);
    size_t n = strlen(git_hash);
    memcpy(config.about.git_hash, git_hash,
           n < sizeof config.about.git_hash ? n : sizeof config.about.git_hash);
    ESP_ERROR_CHECK(esp_read_mac(config.about.mac, ESP_MAC_WIFI_STA));
    return config;
}

void app_main(void) {
    ESP_ERROR_CHECK(hal_nvs_start());
    rc_identity identity = hal_nvs_load_identity();
    uint32_t boot_counter = hal_nvs_count_boot();
    air_events = xQueueCreate(AIR_EVENTS, sizeof(air_event));
    configASSERT(air_events != NULL);
    ESP_ERROR_CHECK(hal_usb_start());
    ESP_ERROR_CHECK(hal_espnow_start(air_events, identity.channel));
    /* After the start of Wi-Fi, so that the random numbers are. */
    rc_config config = describe(identity, boot_counter);
    rc_init(&radio, &config);
    ESP_LOGI(TAG, "boot %lu as robot %u", (unsigned long)boot_counter, identity.robot);
    BaseType_t started = xTaskCreatePinnedToCore(radio_task, "radio", RADIO_STACK_BYTES, NULL, RADIO_PRIORITY,
                                                 NULL, RADIO_CORE);
    configASSERT(started == pdPASS);
}
