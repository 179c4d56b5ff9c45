#include "relay_row.h"

#include "bytes.h"

enum {
    STATUS_AT = 0,
    FLAGS_AT = 1,
    SLOT_AT = 10, /* slot, generation and cost lie as in a row */
    SLOT_TO_COST_BYTES = 4,
    CLAIM_BITS_AT = 16, /* confirmed and tag, as in a row */
    PLACE_AT = 17,
    PLACE_BYTES = 6,
    ETA_AT = 23,
    N_AT = 25,
    M_AT = 26,
    COSTS_AT = 27,
    INTENT_BYTES = 13,
    DIGEST_FROM_END = 10
};
enum { FLAG_STOPPED = 1, FLAG_LOCALIZED = 2 };
enum { ROW_STATUS_SHIFT = 3, ROW_LOCALIZED = 64, ROW_STOPPED = 128 };

uint8_t rc_state_n(const uint8_t *state) {
    return state[N_AT];
}

uint8_t rc_state_m(const uint8_t *state) {
    return state[M_AT];
}

uint64_t rc_state_heard(const uint8_t *state) {
    unsigned n = rc_state_n(state), m = rc_state_m(state);
    const uint8_t *at = state + COSTS_AT + m + (2 * m + 7) / 8 + INTENT_BYTES;
    return rc_take_bits(&at, n); /* more than eight bytes follow */
}

uint32_t rc_state_fleet_digest(const uint8_t *state, size_t length) {
    const uint8_t *at = state + length - DIGEST_FROM_END;
    return rc_take32(&at);
}

static uint8_t bits_of(const uint8_t *state) {
    unsigned flags = state[FLAGS_AT];
    unsigned bits = state[CLAIM_BITS_AT] | (unsigned)state[STATUS_AT] << ROW_STATUS_SHIFT;
    bits |= flags & FLAG_LOCALIZED ? ROW_LOCALIZED : 0u;
    bits |= flags & FLAG_STOPPED ? ROW_STOPPED : 0u;
    return (uint8_t)bits;
}

static uint8_t eta_s_of(const uint8_t *state) {
    const uint8_t *at = state + ETA_AT;
    unsigned eta_s = (rc_take16(&at) + 5u) / 10;
    return (uint8_t)(eta_s < UINT8_MAX ? eta_s : UINT8_MAX);
}

void rc_relay_row_put(uint8_t *row, uint8_t robot, const uint8_t *state) {
    uint8_t *at = rc_put8(row, robot);
    at = rc_put8(at, 0);
    at = rc_put_bytes(at, state + SLOT_AT, SLOT_TO_COST_BYTES);
    at = rc_put8(at, bits_of(state));
    at = rc_put_bytes(at, state + PLACE_AT, PLACE_BYTES);
    at = rc_put8(at, eta_s_of(state));
    rc_put_bytes(at, state + COSTS_AT, rc_state_m(state));
}
