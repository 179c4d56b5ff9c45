/* The body of RELAY: rows of robots that others miss, behind the bitmap of rows that the sender holds. */
#include "bytes.h"
#include "frame.h"

enum { M_AT = 0, N_AT = 1, HELD_AT = 2 };
/* within a row */
enum { ROBOT_AT = 0, SLOT_AT = 2, CLAIM_AT = 3, BITS_AT = 6, PLACE_AT = 7, PLACE_BYTES = 7 };
enum { CONFIRMED = 1, TAG_SHIFT = 1, STATUS_SHIFT = 3, LOCALIZED_SHIFT = 6, STOPPED_SHIFT = 7 };

static size_t rows_at(uint8_t n) {
    return HELD_AT + (n + 7u) / 8;
}

/* Generation, cost, confirmed, tag, place and ETA are of a claim. */
static bool claim_is_empty(const uint8_t *row) {
    unsigned bits = row[BITS_AT] & (CONFIRMED | RC_MAX_TAG << TAG_SHIFT);
    for (size_t i = CLAIM_AT; i < BITS_AT; i++)
        bits |= row[i];
    for (size_t i = PLACE_AT; i < PLACE_AT + PLACE_BYTES; i++)
        bits |= row[i];
    return bits == 0;
}

static bool row_valid(const uint8_t *row, uint8_t n, uint8_t m) {
    uint8_t bits = row[BITS_AT], slot = row[SLOT_AT];
    if (row[ROBOT_AT] >= n || ((bits >> STATUS_SHIFT) & 7) > RC_MAX_STATUS)
        return false;
    if (slot == RC_NO_SLOT)
        return claim_is_empty(row);
    return slot < m && ((bits >> TAG_SHIFT) & RC_MAX_TAG) > 0;
}

bool rc_relay_valid(const uint8_t *body, size_t length) {
    if (length < HELD_AT || length > RC_MAX_BODY)
        return false;
    uint8_t m = body[M_AT], n = body[N_AT];
    if (m < 1 || m > RC_MAX_TASK_SLOTS || n < 1 || n > RC_MAX_ROBOTS || length <= rows_at(n))
        return false;
    size_t row_bytes = (size_t)RC_RELAY_ROW_BYTES + m;
    if ((length - rows_at(n)) % row_bytes != 0 || !rc_rest_is_zero(body + HELD_AT, n, 1))
        return false;
    for (size_t at = rows_at(n); at < length; at += row_bytes)
        if (!row_valid(body + at, n, m))
            return false;
    return true;
}

/* Sizes and small fields are what their bytes can hold; rc_relay_valid has the rest of the rules. */
static bool fits(const rc_relay *relay) {
    if (relay->n > RC_MAX_ROBOTS || relay->m > RC_MAX_TASK_SLOTS || relay->count > RC_MAX_RELAY_ROWS ||
        RC_RELAY_BYTES(relay->count, relay->n, relay->m) > RC_MAX_BODY ||
        (relay->n < RC_MAX_ROBOTS && relay->held >> relay->n != 0))
        return false;
    for (size_t i = 0; i < relay->count; i++) {
        const rc_relay_row *row = &relay->rows[i];
        if (row->status > RC_MAX_STATUS || row->confirmed > 1 || row->tag > RC_MAX_TAG ||
            row->localized > 1 || row->stopped > 1)
            return false;
    }
    return true;
}

static uint8_t *put_row(uint8_t *at, const rc_relay_row *row, uint8_t m) {
    at = rc_put8(at, row->robot);
    at = rc_put8(at, row->age);
    at = rc_put8(at, row->slot);
    at = rc_put16(at, row->generation);
    at = rc_put8(at, row->cost);
    at = rc_put8(at, (uint8_t)(row->confirmed | row->tag << TAG_SHIFT | row->status << STATUS_SHIFT |
                               row->localized << LOCALIZED_SHIFT | row->stopped << STOPPED_SHIFT));
    at = rc_put_i16(at, row->x_cm);
    at = rc_put_i16(at, row->y_cm);
    at = rc_put_i16(at, row->z_cm);
    at = rc_put8(at, row->eta_s);
    return rc_put_bytes(at, row->costs, m);
}

size_t rc_relay_encode(const rc_relay *relay, uint8_t *out) {
    if (!fits(relay))
        return 0;
    uint8_t *at = rc_put8(out, relay->m);
    at = rc_put8(at, relay->n);
    at = rc_put(at, relay->held, (relay->n + 7u) / 8);
    for (size_t i = 0; i < relay->count; i++)
        at = put_row(at, &relay->rows[i], relay->m);
    size_t length = (size_t)(at - out);
    return rc_relay_valid(out, length) ? length : 0;
}

static void take_row(const uint8_t **at, rc_relay_row *row, uint8_t m) {
    row->robot = rc_take8(at);
    row->age = rc_take8(at);
    row->slot = rc_take8(at);
    row->generation = rc_take16(at);
    row->cost = rc_take8(at);
    uint8_t bits = rc_take8(at);
    row->confirmed = bits & CONFIRMED;
    row->tag = (bits >> TAG_SHIFT) & RC_MAX_TAG;
    row->status = (bits >> STATUS_SHIFT) & 7;
    row->localized = (bits >> LOCALIZED_SHIFT) & 1;
    row->stopped = bits >> STOPPED_SHIFT;
    row->x_cm = rc_take_i16(at);
    row->y_cm = rc_take_i16(at);
    row->z_cm = rc_take_i16(at);
    row->eta_s = rc_take8(at);
    rc_take_bytes(at, row->costs, m);
}

bool rc_relay_decode(const uint8_t *body, size_t length, rc_relay *relay) {
    if (!rc_relay_valid(body, length))
        return false;
    const uint8_t *at = body;
    relay->m = rc_take8(&at);
    relay->n = rc_take8(&at);
    relay->count = (uint8_t)((length - rows_at(relay->n)) / ((size_t)RC_RELAY_ROW_BYTES + relay->m));
    relay->held = rc_take(&at, (relay->n + 7u) / 8);
    for (size_t i = 0; i < relay->count; i++)
        take_row(&at, &relay->rows[i], relay->m);
    return true;
}
