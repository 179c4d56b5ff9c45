/* The body of STATE. */
#include "bytes.h"
#include "frame.h"

static bool claim_valid(const rc_claim *claim, uint8_t m) {
    if (claim->confirmed > 1 || claim->tag > RC_MAX_TAG)
        return false;
    if (claim->slot != RC_NO_SLOT)
        return claim->slot < m && claim->tag > 0;
    return claim->generation == 0 && claim->cost == 0 && claim->round == 0 && claim->confirmed == 0 &&
           claim->tag == 0 && claim->x_cm == 0 && claim->y_cm == 0 && claim->z_cm == 0 && claim->eta_ds == 0;
}

static bool all_at_most(const uint8_t *values, size_t count, uint8_t high) {
    for (size_t i = 0; i < count; i++)
        if (values[i] > high)
            return false;
    return true;
}

static bool sizes_valid(uint8_t n, uint8_t m) {
    return n >= 1 && n <= RC_MAX_ROBOTS && m >= 1 && m <= RC_MAX_TASK_SLOTS;
}

static bool state_valid(const rc_state *s) {
    return sizes_valid(s->n, s->m) && s->status <= RC_MAX_STATUS && s->flags <= RC_ALL_FLAGS &&
           s->intent_count <= RC_MAX_INTENT_STEPS && (s->n == RC_MAX_ROBOTS || s->heard >> s->n == 0) &&
           claim_valid(&s->claim, s->m) && all_at_most(s->task_states, s->m, 3) &&
           all_at_most(s->intent_steps, s->intent_count, RC_MAX_MOVE) && all_at_most(s->endorsed, s->n, 3);
}

static uint8_t *put_claim(uint8_t *at, const rc_claim *claim) {
    at = rc_put8(at, claim->slot);
    at = rc_put16(at, claim->generation);
    at = rc_put8(at, claim->cost);
    at = rc_put16(at, claim->round);
    at = rc_put8(at, (uint8_t)(claim->confirmed | claim->tag << 1));
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
    claim->tag = rc_take8(at);
    claim->confirmed = claim->tag & 1;
    claim->tag >>= 1; /* bits 3..7 must be zero: claim_valid sees them as too large a tag */
    claim->x_cm = rc_take_i16(at);
    claim->y_cm = rc_take_i16(at);
    claim->z_cm = rc_take_i16(at);
    claim->eta_ds = rc_take16(at);
}

static uint64_t pack_steps(const uint8_t *steps, uint8_t count) {
    uint64_t packed = (uint64_t)count << 60;
    for (unsigned i = 0; i < count; i++)
        packed |= (uint64_t)steps[i] << (5 * i);
    return packed;
}

static bool unpack_steps(uint64_t packed, rc_state *s) {
    s->intent_count = (uint8_t)(packed >> 60);
    if (s->intent_count > RC_MAX_INTENT_STEPS)
        return false;
    for (unsigned i = 0; i < s->intent_count; i++)
        s->intent_steps[i] = (packed >> (5 * i)) & 31;
    return pack_steps(s->intent_steps, s->intent_count) == packed;
}

size_t rc_state_encode(const rc_state *s, uint8_t *out) {
    if (!state_valid(s))
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
    at = rc_put(at, pack_steps(s->intent_steps, s->intent_count), 8);
    at = rc_put(at, s->heard, (s->n + 7u) / 8);
    at = rc_put_crumbs(at, s->endorsed, s->n);
    at = rc_put32(at, s->fleet_digest);
    at = rc_put32(at, s->generations_digest);
    at = rc_put16(at, s->stop_counter);
    return (size_t)(at - out);
}

static void take_head(const uint8_t **at, rc_state *s) {
    s->status = rc_take8(at);
    s->flags = rc_take8(at);
    s->x_cm = rc_take_i16(at);
    s->y_cm = rc_take_i16(at);
    s->z_cm = rc_take_i16(at);
    s->yaw_256 = rc_take8(at);
    s->speed_2cmps = rc_take8(at);
    take_claim(at, &s->claim);
    s->n = rc_take8(at);
    s->m = rc_take8(at);
}

bool rc_state_decode(const uint8_t *body, size_t n, rc_state *s) {
    if (n < RC_STATE_FIXED_BYTES)
        return false;
    const uint8_t *at = body;
    take_head(&at, s);
    if (!sizes_valid(s->n, s->m) || n != (size_t)RC_STATE_BYTES(s->n, s->m))
        return false;
    rc_take_bytes(&at, s->costs, s->m);
    bool clean = rc_take_crumbs(&at, s->task_states, s->m);
    s->intent_ix = rc_take16(&at);
    s->intent_iy = rc_take16(&at);
    s->intent_iz = rc_take8(&at);
    clean = unpack_steps(rc_take(&at, 8), s) && clean;
    s->heard = rc_take(&at, (s->n + 7u) / 8);
    clean = rc_take_crumbs(&at, s->endorsed, s->n) && clean;
    s->fleet_digest = rc_take32(&at);
    s->generations_digest = rc_take32(&at);
    s->stop_counter = rc_take16(&at);
    return clean && state_valid(s);
}

void rc_state_put_heard(uint8_t *body, uint64_t heard) {
    enum { N_AT = 25, M_AT = 26, COSTS_AT = 27, INTENT_BYTES = 13 };
    unsigned n = body[N_AT], m = body[M_AT];
    uint64_t mask = n < 64 ? ((uint64_t)1 << n) - 1 : UINT64_MAX;
    rc_put(body + COSTS_AT + m + (2 * m + 7) / 8 + INTENT_BYTES, heard & mask, (n + 7u) / 8);
}
