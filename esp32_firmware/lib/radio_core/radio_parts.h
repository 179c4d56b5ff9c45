/* What the parts of the radio core share; the shell uses radio_core.h only. */
#ifndef RC_RADIO_PARTS_H
#define RC_RADIO_PARTS_H

#include "radio_core.h"

/* A message for the host; counted as lost when the ring is full. frame: holds RC_LINK_MAX_ENCODED bytes, the
 * n of the payload from frame[1] on; it is written over. */
void rc_tell_host(rc_radio *rc, uint8_t *frame, size_t n);
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

/* Bit k of robots that were heard of within RC_DEAD_US. */
uint64_t rc_alive(const rc_radio *rc, uint64_t now_us);

#endif
