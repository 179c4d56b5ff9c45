#include "hal_nvs.h"

#include "keep.h"
#include "nvs.h"
#include "nvs_flash.h"

static const char *const NAME = "hippomat"; /* of the partition and of the name space in it */
static const char *const BOOT = "boot";

/* In the order of writing. A key is of no use without the boot counter that goes with it, so that one is
 * first. */
static const unsigned ORDER[] = {RC_KEEP_BOOT, RC_KEEP_IDENTITY, RC_KEEP_STOP, RC_KEEP_PEERS};
enum { PARTS = sizeof ORDER / sizeof ORDER[0] };

static nvs_handle_t store; /* stays open: opening takes memory */
static bool opened;

static const char *name_of(unsigned part) {
    switch (part) {
    case RC_KEEP_IDENTITY:
        return "identity";
    case RC_KEEP_STOP:
        return "stop";
    case RC_KEEP_PEERS:
        return "peers";
    default:
        return BOOT;
    }
}

static bool unreadable(esp_err_t error) {
    return error == ESP_ERR_NVS_NO_FREE_PAGES || error == ESP_ERR_NVS_NEW_VERSION_FOUND;
}

/* The data of Wi-Fi's calibration: it is made again if it is lost. */
static void start_default_partition(void) {
    if (unreadable(nvs_flash_init()) && nvs_flash_erase() == ESP_OK)
        nvs_flash_init();
}

esp_err_t hal_nvs_start(void) {
    start_default_partition();
    esp_err_t error = nvs_flash_init_partition(NAME);
    if (unreadable(error)) { /* left by other firmware; a key in it would be lost with its boot counter */
        error = nvs_flash_erase_partition(NAME);
        if (error == ESP_OK)
            error = nvs_flash_init_partition(NAME);
    }
    if (error == ESP_OK)
        error = nvs_open_from_partition(NAME, NAME, NVS_READWRITE, &store);
    opened = error == ESP_OK;
    return error;
}

void hal_nvs_load(rc_memory *memory) {
    uint8_t bytes[KEEP_MAX_BYTES];
    for (int i = 1; opened && i < PARTS; i++) {
        size_t n = sizeof bytes;
        if (nvs_get_blob(store, name_of(ORDER[i]), bytes, &n) == ESP_OK)
            keep_decode(memory, ORDER[i], bytes, n);
    }
}

static bool store_boot(uint32_t counter) {
    uint32_t back = 0;
    return nvs_set_u32(store, BOOT, counter) == ESP_OK && nvs_commit(store) == ESP_OK &&
           nvs_get_u32(store, BOOT, &back) == ESP_OK && back == counter;
}

bool hal_nvs_count_boot(rc_memory *memory) {
    uint32_t counter = 0;
    if (!opened)
        return false;
    esp_err_t error = nvs_get_u32(store, BOOT, &counter);
    bool first = error == ESP_ERR_NVS_NOT_FOUND && !memory->keyed;
    if ((error != ESP_OK && !first) || counter == UINT32_MAX)
        return false;
    memory->boot_counter = counter + 1;
    return store_boot(memory->boot_counter);
}

static bool store_part(const rc_memory *memory, unsigned part) {
    uint8_t bytes[KEEP_MAX_BYTES];
    if (!opened)
        return false;
    if (part == RC_KEEP_BOOT)
        return store_boot(memory->boot_counter);
    size_t n = keep_encode(memory, part, bytes);
    return nvs_set_blob(store, name_of(part), bytes, n) == ESP_OK && nvs_commit(store) == ESP_OK;
}

unsigned hal_nvs_store(const rc_memory *memory, unsigned parts) {
    unsigned stored = 0;
    for (int i = 0; i < PARTS; i++) {
        if ((parts & ORDER[i]) == 0)
            continue;
        if (!store_part(memory, ORDER[i]))
            break;
        stored |= ORDER[i];
    }
    return stored;
}
