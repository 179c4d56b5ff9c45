/* The body of TASKS: task slots with generation, place and state. */
#include "bytes.h"
#include "frame.h"

static bool tasks_valid(const rc_tasks *tasks) {
    if (tasks->count < 1 || tasks->count > RC_MAX_TASK_ROWS)
        return false;
    for (size_t i = 0; i < tasks->count; i++)
        if (tasks->slots[i].slot >= RC_MAX_TASK_SLOTS || tasks->slots[i].state > 3)
            return false;
    return true;
}

size_t rc_tasks_encode(const rc_tasks *tasks, uint8_t *out) {
    if (!tasks_valid(tasks))
        return 0;
    uint8_t *at = out;
    for (size_t i = 0; i < tasks->count; i++) {
        const rc_task *task = &tasks->slots[i];
        at = rc_put8(at, task->slot);
        at = rc_put16(at, task->generation);
        at = rc_put8(at, task->state);
        at = rc_put_i16(at, task->x_cm);
        at = rc_put_i16(at, task->y_cm);
        at = rc_put_i16(at, task->z_cm);
    }
    return (size_t)(at - out);
}

bool rc_tasks_decode(const uint8_t *body, size_t n, rc_tasks *tasks) {
    if (n % RC_TASK_ROW_BYTES != 0 || n / RC_TASK_ROW_BYTES > RC_MAX_TASK_ROWS)
        return false;
    tasks->count = (uint8_t)(n / RC_TASK_ROW_BYTES);
    const uint8_t *at = body;
    for (size_t i = 0; i < tasks->count; i++) {
        rc_task *task = &tasks->slots[i];
        task->slot = rc_take8(&at);
        task->generation = rc_take16(&at);
        task->state = rc_take8(&at);
        task->x_cm = rc_take_i16(&at);
        task->y_cm = rc_take_i16(&at);
        task->z_cm = rc_take_i16(&at);
    }
    return tasks_valid(tasks);
}
