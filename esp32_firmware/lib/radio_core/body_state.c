/* The body of STATE. */
#include "bytes.h"
#include "frame.h"

enum {
    STATUS_AT = 0,
    FLAGS_AT = 1,
    CLAIM_AT = 10,
    CLAIM_BYTES = 15,
    N_AT = 25,
    M_AT = 26,
    COSTS_AT = 27,
    CELL_BYTES = 5,   /* of the first intent cell, before the steps */
    INTENT_BYTES = 13 /* cell and steps */
};
enum { CLAIM_TAG_AT = 6, TAG_SHIFT = 1 }; /* within the claim */
enum { STEP_BITS = 5, COUNT_SHIFT = 60 };

static size_t intent_at(uint8_t m) {
    return COSTS_AT + m + (2u * m + 7) / 8;
}

static bool claim_valid(const uint8_t *claim, uint8_t m) {
    uint8_t slot = claim[0], tag = claim[CLAIM_TAG_AT] >> TAG_SHIFT;
    if (slot != RC_NO_SLOT)
        return slot < m && tag >= 1 && tag <= RC_MAX_TAG;
    unsigned bits = 0;
    for (size_t i = 1; i < CLAIM_BYTES; i++)
        bits |= claim[i];
    return bits == 0;
}

static bool steps_valid(uint64_t packed) {
    unsigned count = (unsigned)(packed >> COUNT_SHIFT);
    uint64_t steps = packed & (((uint64_t)1 << COUNT_SHIFT) - 1);
    if (count > RC_MAX_INTENT_STEPS || steps >> (STEP_BITS * count) != 0)
        return false;
    for (; steps != 0; steps >>= STEP_BITS)
        if ((steps & 31) > RC_MAX_MOVE)
            return false;
    return true;
}

bool rc_state_valid(const uint8_t *body, size_t length) {
    if (length < RC_STATE_FIXED_BYTES)
        return false;
    uint8_t n = body[N_AT], m = body[M_AT];
    if (n < 1 || n > RC_MAX_ROBOTS || m < 1 || m > RC_MAX_TASK_SLOTS ||
        length != (size_t)RC_STATE_BYTES(n, m))
        return false;
    const uint8_t *steps = body + intent_at(m) + CELL_BYTES;
    const uint8_t *heard = body + intent_at(m) + INTENT_BYTES, *endorsed = heard + (n + 7u) / 8;
    return body[STATUS_AT] <= RC_MAX_STATUS && body[FLAGS_AT] <= RC_ALL_FLAGS &&
           claim_valid(body + CLAIM_AT, m) && rc_rest_is_zero(body + COSTS_AT + m, m, 2) &&
           steps_valid(rc_take64(&steps)) && rc_rest_is_zero(heard, n, 1) && rc_rest_is_zero(endorsed, n, 2);
}

static bool all_at_most(const uint8_t *values, size_t count, uint8_t high) {
    for (size_t i = 0; i < count; i++)
        if (values[i] > high)
            return false;
    return true;
}

/* Sizes and small fields are what their bits can hold; rc_state_valid has the rest of the rules. */
static bool fits(const rc_state *s) {
    return s->n <= RC_MAX_ROBOTS && s->m <= RC_MAX_TASK_SLOTS && s->intent_count <= RC_MAX_INTENT_STEPS &&
           (s->n == RC_MAX_ROBOTS || s->heard >> s->n == 0) && s->claim.confirmed <= 1 &&
           s->claim.tag <= RC_MAX_TAG && all_at_most(s->task_states, s->m, 3) &&
           all_at_most(s->intent_steps, s->intent_count, RC_MAX_MOVE) && all_at_most(s->endorsed, s->n, 3);
}

static uint8_t *put_claim(uint8_t *at, const rc_claim *claim) {
    at = rc_put8(at, claim->slot);
    at = rc_put16(at, claim->generation);
    at = rc_put8(at, claim->cost);
    at = rc_put16(at, claim->round);
    at = rc_put8(at, (uint8_t)(claim->confirmed | claim->tag << TAG_SHIFT));
    at = rc_put_i16(at, claim->x_cm);
    at = rc_put_i16(at, claim->y_cm);
    at = rc_put_i16(at, claim->z_cm);
    return rc_put16(at, claim->eta_ds);
}

static void take_claim(const uint8_t **at, rc_claim *claim) {
    claim->slot = rc_take8(at);
    claim->generation = rc_take16(at);
    claim->cost = rc_take8(at);
    claim->round = rc_take16(at);
    uint8_t bits = rc_take8(at);
    claim->confirmed = bits & 1;
    claim->tag = (uint8_t)(bits >> TAG_SHIFT);
    claim->x_cm = rc_take_i16(at);
    claim->y_cm = rc_take_i16(at);
    claim->z_cm = rc_take_i16(at);
    claim->eta_ds = rc_take16(at);
}

static uint64_t pack_steps(const uint8_t *steps, uint8_t count) {
    uint64_t packed = (uint64_t)count << COUNT_SHIFT;
    for (unsigned i = 0; i < count; i++)
        packed |= (uint64_t)steps[i] << (STEP_BITS * i);
    return packed;
}

static void unpack_steps(uint64_t packed, rc_state *s) {
    s->intent_count = (uint8_t)(packed >> COUNT_SHIFT);
    for (unsigned i = 0; i < s->intent_count; i++)
        s->intent_steps[i] = (packed >> (STEP_BITS * i)) & 31;
}

size_t rc_state_encode(const rc_state *s, uint8_t *out) {
    if (!fits(s))
        return 0;
    uint8_t *at = rc_put8(out, s->status);
    at = rc_put8(at, s->flags);
    at = rc_put_i16(at, s->x_cm);
    at = rc_put_i16(at, s->y_cm);
    at = rc_put_i16(at, s->z_cm);
    at = rc_put8(at, s->yaw_256);
    at = rc_put8(at, s->speed_2cmps);
    at = put_claim(at, &s->claim);
    at = rc_put8(at, s->n);
    at = rc_put8(at, s->m);
    at = rc_put_bytes(at, s->costs, s->m);
    at = rc_put_crumbs(at, s->task_states, s->m);
    at = rc_put16(at, s->intent_ix);
    at = rc_put16(at, s->intent_iy);
    at = rc_put8(at, s->intent_iz);
    at = rc_put64(at, pack_steps(s->intent_steps, s->intent_count));
    at = rc_put(at, s->heard, (s->n + 7u) / 8);
    at = rc_put_crumbs(at, s->endorsed, s->n);
    at = rc_put32(at, s->fleet_digest);
    at = rc_put32(at, s->generations_digest);
    at = rc_put16(at, s->stop_counter);
    size_t length = (size_t)(at - out);
    return rc_state_valid(out, length) ? length : 0;
}

bool rc_state_decode(const uint8_t *body, size_t length, rc_state *s) {
    if (!rc_state_valid(body, length))
        return false;
    const uint8_t *at = body;
    s->status = rc_take8(&at);
    s->flags = rc_take8(&at);
    s->x_cm = rc_take_i16(&at);
    s->y_cm = rc_take_i16(&at);
    s->z_cm = rc_take_i16(&at);
    s->yaw_256 = rc_take8(&at);
    s->speed_2cmps = rc_take8(&at);
    take_claim(&at, &s->claim);
    s->n = rc_take8(&at);
    s->m = rc_take8(&at);
    rc_take_bytes(&at, s->costs, s->m);
    rc_take_crumbs(&at, s->task_states, s->m);
    s->intent_ix = rc_take16(&at);
    s->intent_iy = rc_take16(&at);
    s->intent_iz = rc_take8(&at);
    unpack_steps(rc_take64(&at), s);
    s->heard = rc_take(&at, (s->n + 7u) / 8);
    rc_take_crumbs(&at, s->endorsed, s->n);
    s->fleet_digest = rc_take32(&at);
    s->generations_digest = rc_take32(&at);
    s->stop_counter = rc_take16(&at);
    return true;
}

void rc_state_put_heard(uint8_t *body, uint64_t heard) {
    uint8_t n = body[N_AT];
    uint64_t mask = n < 64 ? ((uint64_t)1 << n) - 1 : UINT64_MAX;
    rc_put(body + intent_at(body[M_AT]) + INTENT_BYTES, heard & mask, (n + 7u) / 8);
}
