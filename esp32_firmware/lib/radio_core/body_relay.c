/* The body of RELAY: rows of peers that others miss. */
#include "bytes.h"
#include "frame.h"

static bool row_valid(const rc_relay_row *row, uint8_t m) {
    if (row->robot >= RC_MAX_ROBOTS || row->status > RC_MAX_STATUS || row->confirmed > 1 ||
        row->tag > RC_MAX_TAG)
        return false;
    if (row->slot != RC_NO_SLOT)
        return row->slot < m && row->tag > 0;
    return row->generation == 0 && row->cost == 0 && row->confirmed == 0 && row->tag == 0;
}

static bool relay_valid(const rc_relay *relay) {
    if (relay->m < 1 || relay->m > RC_MAX_TASK_SLOTS || relay->count < 1 ||
        relay->count > RC_MAX_RELAY_ROWS || RC_RELAY_BYTES(relay->count, relay->m) > RC_MAX_BODY)
        return false;
    for (size_t i = 0; i < relay->count; i++)
        if (!row_valid(&relay->rows[i], relay->m))
            return false;
    return true;
}

size_t rc_relay_encode(const rc_relay *relay, uint8_t *out) {
    if (!relay_valid(relay))
        return 0;
    uint8_t *at = rc_put8(out, relay->m);
    for (size_t i = 0; i < relay->count; i++) {
        const rc_relay_row *row = &relay->rows[i];
        at = rc_put8(at, row->robot);
        at = rc_put8(at, row->age);
        at = rc_put8(at, row->slot);
        at = rc_put16(at, row->generation);
        at = rc_put8(at, row->cost);
        at = rc_put8(at, (uint8_t)(row->confirmed | row->tag << 1 | row->status << 3));
        at = rc_put_i16(at, row->x_cm);
        at = rc_put_i16(at, row->y_cm);
        at = rc_put_i16(at, row->z_cm);
        at = rc_put8(at, row->eta_s);
        at = rc_put8(at, row->round_low);
        at = rc_put_bytes(at, row->costs, relay->m);
    }
    return (size_t)(at - out);
}

static void take_row(const uint8_t **at, rc_relay_row *row, uint8_t m) {
    row->robot = rc_take8(at);
    row->age = rc_take8(at);
    row->slot = rc_take8(at);
    row->generation = rc_take16(at);
    row->cost = rc_take8(at);
    uint8_t bits = rc_take8(at);
    row->confirmed = bits & 1;
    row->tag = (bits >> 1) & 3;
    row->status = bits >> 3;
    row->x_cm = rc_take_i16(at);
    row->y_cm = rc_take_i16(at);
    row->z_cm = rc_take_i16(at);
    row->eta_s = rc_take8(at);
    row->round_low = rc_take8(at);
    rc_take_bytes(at, row->costs, m);
}

bool rc_relay_decode(const uint8_t *body, size_t n, rc_relay *relay) {
    if (n < 1 || n > RC_MAX_BODY)
        return false;
    const uint8_t *at = body;
    relay->m = rc_take8(&at);
    if (relay->m < 1 || relay->m > RC_MAX_TASK_SLOTS || (n - 1) % (RC_RELAY_ROW_BYTES + relay->m) != 0)
        return false;
    relay->count = (uint8_t)((n - 1) / (RC_RELAY_ROW_BYTES + relay->m));
    for (size_t i = 0; i < relay->count; i++)
        take_row(&at, &relay->rows[i], relay->m);
    return relay_valid(relay);
}
