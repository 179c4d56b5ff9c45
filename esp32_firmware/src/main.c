/* The ESP32-S3 around the radio core: the order of the start, and the one task that owns the core. */
#include <string.h>

#include "esp_log.h"
#include "esp_mac.h"
#include "esp_random.h"
#include "esp_system.h"
#include "esp_task_wdt.h"
#include "freertos/FreeRTOS.h"
#include "freertos/queue.h"
#include "freertos/task.h"
#include "hal_board.h"
#include "hal_cipher.h"
#include "hal_espnow.h"
#include "hal_nvs.h"
#include "hal_wake.h"
#include "shell.h"

#ifndef HIPPOMAT_GIT_HASH
#define HIPPOMAT_GIT_HASH unknown
#endif
#ifndef HIPPOMAT_HOST_PORT
#define HIPPOMAT_HOST_PORT hal_usb
#endif
#define TEXT_OF(token) #token
#define TEXT(token) TEXT_OF(token)

/* Core 1, above everything there; the Wi-Fi task has core 0. */
enum {
    RADIO_STACK_BYTES = 12288,
    RADIO_PRIORITY = configMAX_PRIORITIES - 1,
    RADIO_CORE = 1,
    QUEUED_EVENTS = 48
};

static const char *const TAG = "radio";

static StaticQueue_t queue_room;
static uint8_t queue_bytes[QUEUED_EVENTS * sizeof(hal_event)];
static StaticTask_t task_room;
static StackType_t stack[RADIO_STACK_BYTES / sizeof(StackType_t)];

static void radio_task(void *unused) {
    (void)unused;
    ESP_ERROR_CHECK(esp_task_wdt_add(NULL));
    for (;;) {
        shell_step();
        esp_task_wdt_reset();
    }
}

/* After the start of Wi-Fi, whose noise makes the random numbers random. */
static void describe(rc_about *about) {
    *about = (rc_about){
        .boot_id = esp_random(),
        .reset_reason = (uint8_t)esp_reset_reason(),
        .firmware = "hippomat 0.1.0",
    };
    const char git_hash[] = TEXT(HIPPOMAT_GIT_HASH);
    size_t n = strlen(git_hash); /* a field that is full has no closing zero */
    memcpy(about->git_hash, git_hash, n < sizeof about->git_hash ? n : sizeof about->git_hash);
    ESP_ERROR_CHECK(esp_read_mac(about->mac, ESP_MAC_WIFI_STA));
}

/* The boot counter is stored here, long before the first frame is sent. */
static void recall(rc_config *config) {
    esp_err_t error = hal_nvs_start();
    if (error != ESP_OK)
        ESP_LOGE(TAG, "nothing is kept: %s", esp_err_to_name(error));
    rc_memory_init(&config->memory);
    hal_nvs_load(&config->memory);
    config->boot_kept = hal_nvs_count_boot(&config->memory);
}

static QueueHandle_t start_hardware(const rc_memory *memory) {
    QueueHandle_t events = xQueueCreateStatic(QUEUED_EVENTS, sizeof(hal_event), queue_bytes, &queue_room);
    hal_board_start();
    ESP_ERROR_CHECK(HIPPOMAT_HOST_PORT.start());
    ESP_ERROR_CHECK(hal_espnow_start(events, memory->rate_mbps));
    ESP_ERROR_CHECK(hal_wake_start(events));
    return events;
}

void app_main(void) {
    static rc_config config;
    recall(&config);
    QueueHandle_t events = start_hardware(&config.memory);
    describe(&config.about);
    hal_cipher_init(&config.cipher);
    if (config.memory.keyed)
        hal_cipher_use(config.memory.key);
    if (!config.boot_kept) /* an OPEN fleet must not meet an old number again; half the range is left above */
        config.memory.boot_counter = (esp_random() >> 1) + 1;
    shell_start(&config, events, &HIPPOMAT_HOST_PORT);
    ESP_LOGI(TAG, "boot %lu as robot %u", (unsigned long)config.memory.boot_counter,
             config.memory.identity.robot);
    xTaskCreateStaticPinnedToCore(radio_task, "radio", RADIO_STACK_BYTES, NULL, RADIO_PRIORITY, stack,
                                  &task_room, RADIO_CORE);
}
