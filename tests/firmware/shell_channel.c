/* The shell on a chip whose region forbids the channel it is told to use; the chip is played by this file. */
#define air_events main_air_events
#define TAG MAIN_TAG
#include "main.c"
#undef air_events
#undef TAG
#include "hal_espnow.c"

static unsigned stored;

const char *esp_err_to_name(esp_err_t code) {
    return code == ESP_OK ? "ok" : "failed";
}

esp_err_t esp_wifi_set_channel(uint8_t primary, wifi_second_chan_t second) {
    (void)second;
    return primary <= 11 ? ESP_OK : ESP_FAIL;
}

esp_err_t hal_nvs_store_identity(rc_identity identity) {
    (void)identity;
    stored++;
    return ESP_OK;
}

#define PLAYED(name, ...)                                                                                    \
    esp_err_t name(__VA_ARGS__) {                                                                            \
        return ESP_OK;                                                                                       \
    }
#pragma GCC diagnostic ignored "-Wunused-parameter"
PLAYED(esp_netif_init, void)
PLAYED(esp_event_loop_create_default, void)
PLAYED(esp_wifi_init, const wifi_init_config_t *config)
PLAYED(esp_wifi_set_storage, wifi_storage_t storage)
PLAYED(esp_wifi_set_mode, wifi_mode_t mode)
PLAYED(esp_wifi_start, void)
PLAYED(esp_wifi_set_ps, wifi_ps_type_t type)
PLAYED(esp_now_init, void)
PLAYED(esp_now_deinit, void)
PLAYED(esp_now_register_recv_cb, esp_now_recv_cb_t callback)
PLAYED(esp_now_register_send_cb, esp_now_send_cb_t callback)
PLAYED(esp_now_add_peer, const esp_now_peer_info_t *peer)
PLAYED(esp_now_send, const uint8_t *peer, const uint8_t *data, size_t length)
PLAYED(esp_now_set_peer_rate_config, const uint8_t *peer, esp_now_rate_config_t *config)
PLAYED(esp_read_mac, uint8_t *mac, esp_mac_type_t type)
PLAYED(esp_task_wdt_add, TaskHandle_t task)
PLAYED(esp_task_wdt_reset, void)
PLAYED(hal_usb_start, void)
PLAYED(hal_nvs_start, void)

size_t hal_usb_read(uint8_t *bytes, size_t cap) {
    return 0;
}
bool hal_usb_write(const uint8_t *bytes, size_t n) {
    return true;
}
uint32_t hal_nvs_count_boot(void) {
    return 1;
}
rc_identity hal_nvs_load_identity(void) {
    return (rc_identity){.robot = RC_NO_ROBOT, .fleet = 1, .channel = 1};
}
int64_t esp_timer_get_time(void) {
    return 0;
}
uint32_t esp_random(void) {
    return 4;
}
esp_reset_reason_t esp_reset_reason(void) {
    return ESP_RST_POWERON;
}
QueueHandle_t xQueueCreate(UBaseType_t length, UBaseType_t size) {
    return NULL;
}
BaseType_t xQueueSend(QueueHandle_t queue, const void *item, TickType_t wait) {
    return pdTRUE;
}
BaseType_t xQueueReceive(QueueHandle_t queue, void *item, TickType_t wait) {
    return 0;
}
void vTaskDelay(TickType_t ticks) {
}
BaseType_t xTaskCreatePinnedToCore(void (*code)(void *), const char *name, uint32_t stack, void *argument,
                                   UBaseType_t priority, TaskHandle_t *task, BaseType_t core) {
    return pdPASS;
}

static void adopt(uint8_t channel) {
    rc_identity nobody = {.robot = RC_NO_ROBOT, .fleet = 1, .channel = 1};
    rc_config config = describe(nobody, 1);
    rc_init(&radio, &config);
    radio.config.identity = (rc_identity){.robot = 3, .fleet = 1, .channel = channel};
    keep_identity(&nobody);
}

int main(void) {
    adopt(11);
    printf("\nstored %u\n", stored);
    adopt(13);
    printf("\nstored %u\n", stored);
    printf("\nstarted %d\n", hal_espnow_start(NULL, 13) == ESP_OK);
    return 0;
}
