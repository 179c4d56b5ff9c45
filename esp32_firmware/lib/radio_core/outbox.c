#include "outbox.h"

#include <string.h>

static void fill(rc_body *slot, uint8_t kind, const uint8_t *body, size_t n) {
    slot->kind = kind;
    slot->length = (uint8_t)n;
    memcpy(slot->bytes, body, n);
}

static rc_queued put_urgent(rc_outbox *o, uint8_t kind, const uint8_t *body, size_t n) {
    if (o->urgent == RC_QUEUE_LENGTH)
        return RC_LOST;
    bool full = o->count == RC_QUEUE_LENGTH;
    size_t others = (size_t)(o->count - o->urgent) - full;
    rc_body *slot = &o->queue[o->urgent];
    memmove(slot + 1, slot, others * sizeof *slot);
    fill(slot, kind, body, n);
    o->urgent++;
    if (full)
        return RC_LOST;
    o->count++;
    return RC_QUEUED;
}

rc_queued rc_outbox_put(rc_outbox *o, uint8_t kind, const uint8_t *body, size_t n) {
    if (kind == RC_STATE) {
        bool replaced = o->state_waiting;
        fill(&o->state, kind, body, n);
        o->state_waiting = true;
        return replaced ? RC_REPLACED : RC_QUEUED;
    }
    if (kind == RC_STOP || kind == RC_RESUME)
        return put_urgent(o, kind, body, n);
    if (o->count == RC_QUEUE_LENGTH)
        return RC_LOST;
    fill(&o->queue[o->count++], kind, body, n);
    return RC_QUEUED;
}

bool rc_outbox_take(rc_outbox *o, rc_body *body) {
    if (o->urgent == 0 && o->state_waiting) {
        *body = o->state;
        o->state_waiting = false;
        return true;
    }
    if (o->count == 0)
        return false;
    *body = o->queue[0];
    o->count--;
    if (o->urgent > 0)
        o->urgent--;
    memmove(&o->queue[0], &o->queue[1], o->count * sizeof o->queue[0]);
    return true;
}
