/* Radios for the fuzz targets, and what must hold of all that they say. */
#ifndef FUZZ_RADIOS_H
#define FUZZ_RADIOS_H

#include <stdlib.h>
#include <string.h>

#include "radio_core.h"

/* Opens everything: what lies behind the seal is to be reached. */
static inline bool fuzz_seal(void *context, const uint8_t *key, const uint8_t *nonce, const uint8_t *header,
                             const uint8_t *body, size_t n, uint8_t *out) {
    (void)context, (void)key, (void)nonce, (void)header;
    memmove(out, body, n);
    memset(out + n, 0, RC_TAG_BYTES);
    return true;
}

static inline bool fuzz_open(void *context, const uint8_t *key, const uint8_t *nonce, const uint8_t *header,
                             const uint8_t *sealed, size_t n, uint8_t *out) {
    (void)context, (void)key, (void)nonce, (void)header;
    memmove(out, sealed, n - RC_TAG_BYTES);
    return true;
}

/* The table keeps rows only of a fleet whose size it knows, from our own STATE. */
static inline void fuzz_own_state(rc_radio *radio) {
    static const rc_state state = {.n = 30, .m = 30, .fleet_digest = 0xabcd, .claim.slot = RC_NO_SLOT};
    uint8_t body[RC_MAX_BODY];
    size_t n = rc_state_encode(&state, body);
    for (uint32_t round = 0; round < 8; round++) {
        rc_relay_begin(&radio->relay, round);
        rc_relay_own(&radio->relay, round, body, n);
    }
}

static inline void fuzz_start(rc_radio *radio, bool keyed, uint8_t robot) {
    rc_config config = {
        .about = {.boot_id = 1, .mac = {2, 0, 0, 0, 0, 9}},
        .boot_kept = true,
        .cipher = {.seal = fuzz_seal, .open = fuzz_open},
    };
    rc_memory_init(&config.memory);
    config.memory.identity.robot = robot;
    config.memory.boot_counter = 1;
    config.memory.keyed = keyed;
    rc_init(radio, 0, &config);
    fuzz_own_state(radio);
}

/* Everything for the host is whole messages, and every frame in them is one. */
static inline void fuzz_check_host(rc_radio *radio) {
    uint8_t out[RC_LINK_MAX_ENCODED];
    rc_cobs_decoder decoder = {0};
    size_t n;
    while ((n = rc_usb_tx(radio, out, sizeof out)) > 0) {
        for (size_t i = 0; i < n; i++) {
            int length = rc_cobs_push(&decoder, out[i]);
            if (length >= RC_HEARD_HEAD_BYTES && decoder.buffer[0] == RC_LINK_HEARD &&
                !rc_frame_valid(decoder.buffer + RC_HEARD_HEAD_BYTES, (size_t)length - RC_HEARD_HEAD_BYTES))
                abort();
        }
    }
    if (decoder.held != 0 || decoder.skipped_bytes != 0)
        abort();
}

static inline void fuzz_send(rc_radio *radio, uint64_t now_us) {
    uint8_t frame[RC_MAX_FRAME];
    rc_tick(radio, now_us);
    size_t n = rc_air_tx(radio, now_us, frame);
    if (n > RC_MAX_FRAME)
        abort();
    if (n > 0)
        rc_air_done(radio, now_us, true);
    if (rc_next_us(radio, now_us) < now_us)
        abort();
    rc_kept(radio, rc_dirty(radio), true);
}

#endif
