#include "peers.h"

/* 24-bit serial numbers: ahead by less than half the range (RFC 1982). */
static bool newer(uint32_t sequence, uint32_t last) {
    uint32_t ahead = (sequence - last) & 0xffffffu;
    return ahead != 0 && ahead < 0x800000u;
}

static bool advance(rc_epoch *epoch, uint32_t sequence) {
    if (!newer(sequence, epoch->sequence))
        return false;
    epoch->sequence = sequence;
    return true;
}

bool rc_peer_fresh(rc_peer *peer, uint32_t boot, uint32_t sequence) {
    if (peer->present.known && peer->present.boot == boot)
        return advance(&peer->present, sequence);
    if (peer->before.known && peer->before.boot == boot)
        return advance(&peer->before, sequence);
    peer->before = peer->present;
    peer->present = (rc_epoch){.known = true, .boot = boot, .sequence = sequence};
    return true;
}
