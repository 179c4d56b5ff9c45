/* What the parts of the radio core share; the shell uses radio_core.h only. */
#ifndef RC_RADIO_PARTS_H
#define RC_RADIO_PARTS_H

#include "radio_core.h"

/* Where fleet time has gone on to: a round was observed, or another one has begun. */
void rc_follow_rounds(rc_radio *rc, uint64_t now_us);

/* A message for the host. frame: holds RC_LINK_MAX_ENCODED bytes, the n of the payload from frame[1] on; it
 * is written over. False: the ring is full (for frames heard a little earlier), the message is counted as
 * lost. */
bool rc_tell_host(rc_radio *rc, uint8_t *frame, size_t n);
void rc_tell_status(rc_radio *rc, uint64_t now_us);

/* The latch has changed, perhaps: it must be stored, and the host must know. */
void rc_note_stop(rc_radio *rc, uint64_t now_us);

static inline uint32_t rc_round_us(const rc_radio *rc) {
    return rc->config.memory.schedule.round_ms * 1000u;
}

static inline bool rc_is_robot(const rc_radio *rc) {
    return rc->config.memory.identity.robot != RC_NO_ROBOT;
}

/* Its boot counter is stored, and is the one that it will go on with. */
static inline bool rc_may_send(const rc_radio *rc) {
    return rc->boot_ready && !rc->provisioning && !rc->restart;
}

/* With the channel that the driver is tuned to: the memory has the one that is wished. */
rc_identity rc_identity_in_use(const rc_radio *rc);

/* Our first turn with latest_us >= fleet_us. It begins up to RC_APART_US late, a little different each time:
 * two radios of one id, which share all turns, would else never hear each other. */
enum { RC_APART_US = 200 };
rc_turn rc_own_turn(const rc_radio *rc, uint64_t fleet_us);

/* Bit k of robots that were heard of within RC_DEAD_US. */
uint64_t rc_alive(const rc_radio *rc, uint64_t now_us);

#endif
