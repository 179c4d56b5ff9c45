/* A radio's memory in flash, in a partition of its own: Wi-Fi's data and ours cannot push each other out. */
#ifndef HAL_NVS_H
#define HAL_NVS_H

#include "esp_err.h"
#include "radio_core.h"

/* Anything but ESP_OK: the radio runs, and everything below says that nothing is kept. */
esp_err_t hal_nvs_start(void);

/* Fills in the parts that the flash holds, the boot counter excepted; the others stay as they are. */
void hal_nvs_load(rc_memory *memory);

/* Counts this boot and stores the number, before anything is sent under it. False: not stored, or it is not
 * known what was counted before although there is a key; memory->boot_counter is then worth nothing. */
bool hal_nvs_count_boot(rc_memory *memory);

/* Writes these parts; the boot counter first, and nothing behind one that fails. Which were stored. */
unsigned hal_nvs_store(const rc_memory *memory, unsigned parts);

#endif
