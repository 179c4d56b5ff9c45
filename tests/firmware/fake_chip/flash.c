/* NVS in memory: the partition "hippomat" alone. Whatever is set counts once it is committed, and is then
 * told. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "fake.h"
#include "nvs_flash.h"

enum { ENTRIES = 8, VALUE_BYTES = 512, BREAKABLE = 8, NAME_BYTES = 16 };

typedef struct {
    char key[NAME_BYTES]; /* empty: free */
    size_t n;
    bool committed;
    uint8_t bytes[VALUE_BYTES];
} entry;

static entry entries[ENTRIES];
static char broken[BREAKABLE][NAME_BYTES];
static bool ready;
static unsigned writes;

void fake_nvs_breaks(const char *what, bool breaks) {
    for (int i = 0; i < BREAKABLE; i++) {
        if (broken[i][0] == 0 && breaks) {
            snprintf(broken[i], NAME_BYTES, "%s", what);
            return;
        }
        if (strcmp(broken[i], what) == 0)
            broken[i][0] = 0;
    }
}

static bool is_broken(const char *what) {
    for (int i = 0; i < BREAKABLE; i++)
        if (strcmp(broken[i], what) == 0)
            return true;
    return false;
}

static entry *find(const char *key) {
    for (int i = 0; i < ENTRIES; i++)
        if (strcmp(entries[i].key, key) == 0)
            return &entries[i];
    return NULL;
}

static esp_err_t set(const char *key, const void *bytes, size_t n) {
    char what[32];
    fake_only_in_task(__func__);
    snprintf(what, sizeof what, "set %s", key);
    if (is_broken(what))
        return ESP_FAIL;
    entry *place = find(key);
    place = place != NULL ? place : find("");
    snprintf(place->key, sizeof place->key, "%s", key);
    memcpy(place->bytes, bytes, n);
    place->n = n;
    place->committed = false;
    writes++;
    return ESP_OK;
}

static esp_err_t get(const char *key, void *bytes, size_t *n) {
    char what[32];
    snprintf(what, sizeof what, "get %s", key);
    const entry *place = find(key);
    if (is_broken(what))
        return ESP_FAIL;
    if (place == NULL)
        return ESP_ERR_NVS_NOT_FOUND;
    if (place->n > *n)
        return ESP_ERR_NVS_INVALID_LENGTH;
    memcpy(bytes, place->bytes, place->n);
    *n = place->n;
    return ESP_OK;
}

void fake_nvs_put(const char *key, const uint8_t *bytes, size_t n) {
    if (set(key, bytes, n) == ESP_OK)
        find(key)->committed = true;
    writes = 0;
}

esp_err_t nvs_flash_init(void) {
    return ESP_OK;
}

esp_err_t nvs_flash_erase(void) {
    return ESP_OK;
}

esp_err_t nvs_flash_init_partition(const char *name) {
    if (is_broken("full"))
        return ESP_ERR_NVS_NO_FREE_PAGES;
    ready = strcmp(name, "hippomat") == 0 && !is_broken("init");
    return ready ? ESP_OK : ESP_FAIL;
}

esp_err_t nvs_flash_erase_partition(const char *name) {
    printf("erased %s\n", name);
    memset(entries, 0, sizeof entries);
    fake_nvs_breaks("full", false);
    return ESP_OK;
}

esp_err_t nvs_open_from_partition(const char *partition, const char *space, nvs_open_mode_t mode,
                                  nvs_handle_t *handle) {
    *handle = 1;
    fake_take_memory(50);
    return ready && strcmp(partition, space) == 0 && mode == NVS_READWRITE ? ESP_OK : ESP_FAIL;
}

esp_err_t nvs_commit(nvs_handle_t handle) {
    fake_only_in_task(__func__);
    if (handle != 1 || is_broken("commit"))
        return ESP_FAIL;
    for (int i = 0; i < ENTRIES; i++) {
        if (entries[i].key[0] == 0 || entries[i].committed)
            continue;
        entries[i].committed = true;
        printf("stored %" PRIu64 " %s ", fake_now_us, entries[i].key);
        fake_tell_bytes("", entries[i].bytes, entries[i].n);
    }
    return ESP_OK;
}

esp_err_t nvs_get_u32(nvs_handle_t handle, const char *key, uint32_t *value) {
    size_t n = sizeof *value;
    esp_err_t error = handle == 1 ? get(key, value, &n) : ESP_FAIL;
    return error == ESP_OK && n != sizeof *value ? ESP_FAIL : error;
}

esp_err_t nvs_set_u32(nvs_handle_t handle, const char *key, uint32_t value) {
    return handle == 1 ? set(key, &value, sizeof value) : ESP_FAIL;
}

esp_err_t nvs_get_blob(nvs_handle_t handle, const char *key, void *bytes, size_t *n) {
    return handle == 1 ? get(key, bytes, n) : ESP_FAIL;
}

esp_err_t nvs_set_blob(nvs_handle_t handle, const char *key, const void *bytes, size_t n) {
    return handle == 1 ? set(key, bytes, n) : ESP_FAIL;
}
