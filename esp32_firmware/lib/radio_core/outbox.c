#include "outbox.h"

#include <string.h>

static void fill(rc_body *place, const uint8_t *body, size_t n) {
    place->length = (uint8_t)n;
    memcpy(place->bytes, body, n);
}

rc_queued rc_outbox_put(rc_outbox *o, uint8_t kind, const uint8_t *body, size_t n) {
    if (kind == RC_STATE) {
        bool replaced = o->state_waiting;
        fill(&o->state, body, n);
        o->state_waiting = true;
        return replaced ? RC_REPLACED : RC_QUEUED;
    }
    if (o->count == RC_QUEUE_LENGTH)
        return RC_LOST;
    fill(&o->queue[(o->first + o->count) % RC_QUEUE_LENGTH], body, n);
    o->count++;
    return RC_QUEUED;
}

static size_t take(const rc_body *place, uint8_t *body) {
    memcpy(body, place->bytes, place->length);
    return place->length;
}

size_t rc_outbox_take_state(rc_outbox *o, uint8_t *body) {
    if (!o->state_waiting)
        return 0;
    o->state_waiting = false;
    return take(&o->state, body);
}

size_t rc_outbox_take_tasks(rc_outbox *o, uint8_t *body) {
    if (o->count == 0)
        return 0;
    const rc_body *place = &o->queue[o->first];
    o->first = (uint8_t)((o->first + 1) % RC_QUEUE_LENGTH);
    o->count--;
    return take(place, body);
}
