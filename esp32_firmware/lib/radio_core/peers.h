/* Which frames of which sender were heard before: sequence numbers per sender and boot. */
#ifndef RC_PEERS_H
#define RC_PEERS_H

#include "frame.h"

typedef struct {
    bool known;
    uint32_t boot;
    uint32_t sequence; /* the newest heard */
} rc_epoch;

/* The boot before the present one is remembered, so that a late copy from it is not taken for a reboot. */
typedef struct {
    rc_epoch present, before;
} rc_peer;

/* True for a frame newer than all heard of that sender and boot; it is then remembered. */
bool rc_peer_fresh(rc_peer *peer, uint32_t boot, uint32_t sequence);

#endif
