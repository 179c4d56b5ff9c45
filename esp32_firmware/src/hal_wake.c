#include "hal_wake.h"

#include "esp_attr.h"
#include "esp_timer.h"

/* An alarm that is due already: other tasks of this core get a moment, whatever the radio core asks for. */
enum { SOON_US = 50 };

static QueueHandle_t events;
static esp_timer_handle_t timer;
static uint64_t armed_us;
static hal_event wake = {.kind = EVENT_WAKE}; /* in RAM: the interrupt comes during flash writes too */

/* In the interrupt, not in esp_timer's task, which waits for the Wi-Fi task. A full queue wakes as well. */
static void IRAM_ATTR on_time(void *unused) {
    (void)unused;
    BaseType_t woken = pdFALSE;
    xQueueSendFromISR(events, &wake, &woken);
    if (woken == pdTRUE)
        esp_timer_isr_dispatch_need_yield();
}

esp_err_t hal_wake_start(QueueHandle_t queue) {
    events = queue;
    esp_timer_create_args_t args = {
        .callback = on_time,
        .dispatch_method = ESP_TIMER_ISR,
        .name = "radio",
    };
    return esp_timer_create(&args, &timer);
}

void hal_wake_at(uint64_t now_us, uint64_t at_us) {
    if (at_us == armed_us && at_us > now_us)
        return;
    armed_us = at_us;
    esp_timer_stop(timer); /* an error if it has rung, which is well */
    esp_timer_start_once(timer, at_us > now_us + SOON_US ? at_us - now_us : SOON_US);
}
