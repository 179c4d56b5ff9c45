#include "hal_nvs.h"

#include "esp_random.h"
#include "nvs.h"
#include "nvs_flash.h"

static const char *SPACE = "hippomat";

esp_err_t hal_nvs_start(void) {
    esp_err_t error = nvs_flash_init();
    if (error == ESP_ERR_NVS_NO_FREE_PAGES || error == ESP_ERR_NVS_NEW_VERSION_FOUND) {
        error = nvs_flash_erase();
        if (error == ESP_OK)
            error = nvs_flash_init();
    }
    return error;
}

uint32_t hal_nvs_count_boot(void) {
    nvs_handle_t store;
    if (nvs_open(SPACE, NVS_READWRITE, &store) != ESP_OK)
        return esp_random();
    uint32_t counter = 0;
    esp_err_t error = nvs_get_u32(store, "boot", &counter);
    if (error == ESP_OK || error == ESP_ERR_NVS_NOT_FOUND)
        error = nvs_set_u32(store, "boot", ++counter);
    if (error == ESP_OK)
        error = nvs_commit(store);
    nvs_close(store);
    return error == ESP_OK ? counter : esp_random();
}

rc_identity hal_nvs_load_identity(void) {
    const rc_identity none = {.robot = RC_NO_ROBOT, .fleet = 1, .channel = 1};
    rc_identity identity = none;
    nvs_handle_t store;
    if (nvs_open(SPACE, NVS_READONLY, &store) != ESP_OK)
        return none;
    bool complete = nvs_get_u8(store, "robot", &identity.robot) == ESP_OK &&
                    nvs_get_u8(store, "fleet", &identity.fleet) == ESP_OK &&
                    nvs_get_u8(store, "channel", &identity.channel) == ESP_OK;
    nvs_close(store);
    return complete && rc_identity_valid(&identity) ? identity : none;
}

esp_err_t hal_nvs_store_identity(rc_identity identity) {
    nvs_handle_t store;
    esp_err_t error = nvs_open(SPACE, NVS_READWRITE, &store);
    if (error != ESP_OK)
        return error;
    error = nvs_set_u8(store, "robot", identity.robot);
    if (error == ESP_OK)
        error = nvs_set_u8(store, "fleet", identity.fleet);
    if (error == ESP_OK)
        error = nvs_set_u8(store, "channel", identity.channel);
    if (error == ESP_OK)
        error = nvs_commit(store);
    nvs_close(store);
    return error;
}
