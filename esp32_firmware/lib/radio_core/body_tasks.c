/* The body of TASKS: task slots with generation, place and state. */
#include "bytes.h"
#include "frame.h"

enum { SLOT_AT = 0, STATE_AT = 3, MAX_STATE = 3 }; /* within a row */

bool rc_tasks_valid(const uint8_t *body, size_t length) {
    if (length == 0 || length > RC_MAX_TASK_ROWS * RC_TASK_ROW_BYTES || length % RC_TASK_ROW_BYTES != 0)
        return false;
    for (const uint8_t *row = body; row < body + length; row += RC_TASK_ROW_BYTES)
        if (row[SLOT_AT] >= RC_MAX_TASK_SLOTS || row[STATE_AT] > MAX_STATE)
            return false;
    return true;
}

size_t rc_tasks_encode(const rc_tasks *tasks, uint8_t *out) {
    if (tasks->count > RC_MAX_TASK_ROWS)
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
    size_t length = (size_t)(at - out);
    return rc_tasks_valid(out, length) ? length : 0;
}

bool rc_tasks_decode(const uint8_t *body, size_t length, rc_tasks *tasks) {
    if (!rc_tasks_valid(body, length))
        return false;
    tasks->count = (uint8_t)(length / RC_TASK_ROW_BYTES);
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
    return true;
}
