/* What a radio keeps over a reboot: its boot counter and its identity. */
#ifndef HAL_NVS_H
#define HAL_NVS_H

#include "esp_err.h"
#include "link.h"

esp_err_t hal_nvs_start(void);

/* Counts this boot. Random when the flash cannot be written: peers must not meet an old number again. */
uint32_t hal_nvs_count_boot(void);

/* RC_NO_ROBOT, fleet 1, channel 1 where nothing was stored. */
rc_identity hal_nvs_load_identity(void);
esp_err_t hal_nvs_store_identity(rc_identity identity);

#endif
