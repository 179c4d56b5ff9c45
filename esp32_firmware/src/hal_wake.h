/* The alarm clock of the radio task: a tick of FreeRTOS is 1 ms, a slot must be met within 0.3 ms. */
#ifndef HAL_WAKE_H
#define HAL_WAKE_H

#include "esp_err.h"
#include "hal_event.h"

esp_err_t hal_wake_start(QueueHandle_t events);
/* One EVENT_WAKE at at_us, or soon if that is past; replaces what was asked for before. */
void hal_wake_at(uint64_t now_us, uint64_t at_us);

#endif
