/* Time, the queue, the timer, the task. Time passes while the task waits, and a microsecond with each look at
 * the clock. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "esp_mac.h"
#include "esp_random.h"
#include "esp_system.h"
#include "esp_task_wdt.h"
#include "esp_timer.h"
#include "fake.h"
#include "freertos/queue.h"
#include "freertos/task.h"

enum { TICK_US = 1000 };

struct QueueDefinition {
    size_t length, size, first, count;
    uint8_t *bytes;
};
_Static_assert(sizeof(struct QueueDefinition) <= sizeof(StaticQueue_t), "a queue is where the caller put it");

struct esp_timer {
    void (*callback)(void *argument);
    void *argument;
    uint64_t due_us; /* UINT64_MAX: not running */
};

fake_place fake_where = IN_TASK;
uint64_t fake_now_us = 200000; /* the boot loader's part */
static struct esp_timer *timer;
static bool tell_timers;
static void (*task)(void *);

void fake_only_in_task(const char *function) {
    if (fake_where == IN_TASK)
        return;
    fprintf(stderr, "%s is called in a callback\n", function);
    abort();
}

/* ---- time ---------------------------------------------------------------------------------------------- */

static void ring(void) {
    timer->due_us = UINT64_MAX;
    fake_where = IN_INTERRUPT;
    timer->callback(timer->argument);
    fake_where = IN_TASK;
}

/* The next thing that happens, until_us at the latest. */
static void pass_to_next(uint64_t until_us) {
    uint64_t timer_us = timer != NULL ? timer->due_us : UINT64_MAX;
    uint64_t radio_us = fake_radio_due_us();
    uint64_t next_us = timer_us < radio_us ? timer_us : radio_us;
    next_us = next_us < until_us ? next_us : until_us;
    fake_now_us = next_us > fake_now_us ? next_us : fake_now_us;
    fake_radio_go_on();
    if (timer != NULL && timer->due_us <= fake_now_us)
        ring();
}

void fake_pass_until(uint64_t until_us) {
    while (fake_now_us < until_us)
        pass_to_next(until_us);
}

int64_t esp_timer_get_time(void) {
    return (int64_t)fake_now_us++;
}

void fake_count_timers(bool tell) {
    tell_timers = tell;
}

esp_err_t esp_timer_create(const esp_timer_create_args_t *args, esp_timer_handle_t *handle) {
    fake_only_in_task(__func__);
    timer = fake_take_memory(sizeof *timer);
    *timer = (struct esp_timer){.callback = args->callback, .argument = args->arg, .due_us = UINT64_MAX};
    *handle = timer;
    return args->dispatch_method == ESP_TIMER_ISR ? ESP_OK : ESP_FAIL;
}

esp_err_t esp_timer_start_once(esp_timer_handle_t handle, uint64_t timeout_us) {
    fake_only_in_task(__func__);
    if (handle->due_us != UINT64_MAX)
        return ESP_FAIL;
    handle->due_us = fake_now_us + timeout_us;
    if (tell_timers)
        printf("alarm %" PRIu64 "\n", handle->due_us);
    return ESP_OK;
}

esp_err_t esp_timer_stop(esp_timer_handle_t handle) {
    fake_only_in_task(__func__);
    bool ran = handle->due_us != UINT64_MAX;
    handle->due_us = UINT64_MAX;
    return ran ? ESP_OK : ESP_FAIL;
}

void esp_timer_isr_dispatch_need_yield(void) {
}

/* ---- the queue ----------------------------------------------------------------------------------------- */

QueueHandle_t xQueueCreateStatic(UBaseType_t length, UBaseType_t size, uint8_t *bytes, StaticQueue_t *room) {
    struct QueueDefinition *queue = (struct QueueDefinition *)room;
    *queue = (struct QueueDefinition){.length = length, .size = size, .bytes = bytes};
    return queue;
}

static BaseType_t put(QueueHandle_t queue, const void *item) {
    if (queue->count == queue->length)
        return pdFALSE;
    size_t at = (queue->first + queue->count++) % queue->length;
    memcpy(queue->bytes + at * queue->size, item, queue->size);
    return pdTRUE;
}

BaseType_t xQueueSend(QueueHandle_t queue, const void *item, TickType_t wait) {
    if (fake_where == IN_INTERRUPT || wait != 0)
        abort();
    return put(queue, item);
}

BaseType_t xQueueSendFromISR(QueueHandle_t queue, const void *item, BaseType_t *woken) {
    if (fake_where != IN_INTERRUPT)
        abort();
    *woken = pdTRUE;
    return put(queue, item);
}

BaseType_t xQueueReceive(QueueHandle_t queue, void *item, TickType_t wait) {
    fake_only_in_task(__func__);
    uint64_t until_us = (fake_now_us / TICK_US + wait) * TICK_US;
    fake_radio_go_on();
    while (queue->count == 0 && wait > 0 && fake_now_us < until_us)
        pass_to_next(until_us);
    if (queue->count == 0)
        return pdFALSE;
    memcpy(item, queue->bytes + queue->first * queue->size, queue->size);
    queue->first = (queue->first + 1) % queue->length;
    queue->count--;
    return pdTRUE;
}

/* ---- the task and the system --------------------------------------------------------------------------- */

TaskHandle_t xTaskCreateStaticPinnedToCore(void (*code)(void *), const char *name, uint32_t stack_bytes,
                                           void *argument, UBaseType_t priority, StackType_t *stack,
                                           StaticTask_t *room, BaseType_t core) {
    (void)argument;
    memset(stack, 0, stack_bytes);
    task = code;
    printf("task %s: priority %u, core %d\n", name, priority, core);
    return (TaskHandle_t)room;
}

void fake_run_radio_task(void) {
    task(NULL);
}

void vTaskDelay(TickType_t ticks) {
    fake_only_in_task(__func__);
    fake_pass_until(fake_now_us + (uint64_t)ticks * TICK_US);
}

esp_err_t esp_task_wdt_add(TaskHandle_t unused) {
    (void)unused;
    return ESP_OK;
}

/* Once in each round of the task's loop: here the test gets its turn. */
esp_err_t esp_task_wdt_reset(void) {
    fake_read_commands();
    return ESP_OK;
}

uint32_t esp_random(void) {
    static uint32_t noise = 12345;
    noise = noise * 1664525u + 1013904223u;
    return noise;
}

esp_reset_reason_t esp_reset_reason(void) {
    return ESP_RST_POWERON;
}

void esp_restart(void) {
    printf("restart %" PRIu64 "\n", fake_now_us);
    exit(0);
}

esp_err_t esp_read_mac(uint8_t *mac, esp_mac_type_t type) {
    static const uint8_t OURS[] = {2, 0, 0, 0, 0, 3};
    (void)type;
    memcpy(mac, OURS, sizeof OURS);
    return ESP_OK;
}

const char *esp_err_to_name(esp_err_t code) {
    return code == ESP_OK ? "ok" : "failed";
}
