#include "peers.h"

#include <string.h>

enum { WINDOW = 64, SECOND_US = 1000000 };

bool rc_peer_alive(const rc_peer *peer, uint64_t now_us) {
    return peer->known && now_us - peer->heard_us <= RC_DEAD_US;
}

static bool same_mac(const rc_peer *peer, const uint8_t *mac) {
    return memcmp(peer->mac, mac, RC_MAC_BYTES) == 0;
}

/* Of the boot that is known: ahead of all, or within the window and not heard. */
static bool unheard(const rc_peer *peer, uint32_t sequence) {
    if (sequence > peer->sequence)
        return true;
    uint32_t behind = peer->sequence - sequence;
    return behind < WINDOW && (peer->window >> behind & 1) == 0;
}

rc_judgement rc_peer_judge(const rc_peer *peer, const uint8_t *mac, uint32_t boot, uint32_t sequence,
                           uint64_t now_us, bool keyed) {
    bool alive = rc_peer_alive(peer, now_us);
    if (alive && !same_mac(peer, mac))
        return RC_IMPOSTOR;
    if (boot > peer->boot)
        return RC_FRESH;
    if (boot == peer->boot && !peer->known)
        return RC_FRESH; /* heard before our own restart: its sequence numbers are forgotten */
    if (boot == peer->boot && same_mac(peer, mac))
        return unheard(peer, sequence) ? RC_FRESH : RC_REPLAYED;
    return keyed || alive ? RC_REPLAYED : RC_FRESH;
}

static void note_sequence(rc_peer *peer, uint32_t sequence) {
    if (sequence > peer->sequence) {
        uint32_t ahead = sequence - peer->sequence;
        peer->window = ahead < WINDOW ? peer->window << ahead | 1 : 1;
        peer->sequence = sequence;
    } else {
        peer->window |= (uint64_t)1 << (peer->sequence - sequence);
    }
}

bool rc_peer_accept(rc_peer *peer, const uint8_t *mac, uint32_t boot, uint32_t sequence, int8_t rssi_dbm,
                    uint64_t now_us) {
    bool other_boot = peer->boot != boot;
    if (!peer->known || other_boot || !same_mac(peer, mac)) {
        peer->rebooted = peer->known;
        peer->boot = boot;
        peer->sequence = sequence;
        peer->window = 1;
        memcpy(peer->mac, mac, RC_MAC_BYTES);
    } else {
        note_sequence(peer, sequence);
    }
    if (now_us - peer->impostor_us > RC_DEAD_US)
        peer->duplicate = false;
    peer->known = true;
    peer->rssi_dbm = rssi_dbm;
    peer->heard_us = now_us;
    peer->received++;
    return other_boot;
}

void rc_peer_impostor(rc_peer *peer, uint64_t now_us) {
    peer->duplicate = true;
    peer->impostor_us = now_us;
}

bool rc_peer_count(rc_peer *peer, uint64_t now_us) {
    if (now_us - peer->second_us >= SECOND_US) {
        peer->babbling = peer->in_second > RC_BABBLE_PER_S;
        peer->in_second = 0;
        peer->second_us = now_us;
    }
    if (peer->in_second <= RC_BABBLE_PER_S)
        peer->in_second++;
    if (peer->in_second > RC_BABBLE_PER_S)
        peer->babbling = true;
    return peer->in_second <= RC_BABBLE_PER_S;
}
