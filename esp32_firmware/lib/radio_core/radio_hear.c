/* What is believed of a frame heard, and what is learned from it. What is sent is in radio_send.c. */
#include <string.h>

#include "bytes.h"
#include "radio_parts.h"

/* A stranger among the operators gets a free place, else that of the longest unheard. */
static bool makes_room(const rc_peer *peer, const rc_peer *other) {
    bool is_free = peer->boot == 0, other_is_free = other->boot == 0;
    return is_free != other_is_free ? is_free : peer->heard_us < other->heard_us;
}

/* The place of a sender. Operators share one id: theirs are by MAC. */
static rc_peer *place_of(rc_radio *rc, const rc_header *header, const uint8_t *mac) {
    if (header->sender < RC_MAX_ROBOTS)
        return &rc->peers[header->sender];
    rc_peer *oldest = &rc->operators[0];
    for (size_t i = 0; i < RC_OPERATORS; i++) {
        rc_peer *peer = &rc->operators[i];
        if (memcmp(peer->mac, mac, RC_MAC_BYTES) == 0)
            return peer;
        if (makes_room(peer, oldest))
            oldest = peer;
    }
    return oldest;
}

/* A stranger among the operators: the place is his only once he proved authentic. */
static rc_peer judged_as(const rc_peer *place, const rc_header *header, const uint8_t *mac) {
    if (header->sender == RC_OPERATOR && memcmp(place->mac, mac, RC_MAC_BYTES) != 0)
        return (rc_peer){0};
    return *place;
}

static void keep_boot(rc_radio *rc, const rc_header *header, const rc_peer *peer) {
    rc_memory *memory = &rc->config.memory;
    if (!memory->keyed) /* without a key it proves nothing */
        return;
    if (header->sender < RC_MAX_ROBOTS) {
        memory->peer_boots[header->sender] = peer->boot;
    } else {
        rc_operator *place = &memory->operators[peer - rc->operators];
        memcpy(place->mac, peer->mac, RC_MAC_BYTES);
        place->boot = peer->boot;
    }
    rc->dirty |= RC_KEEP_PEERS;
}

static void go_passive(rc_radio *rc, uint64_t now_us) {
    rc->counters.dropped_impostor++;
    if (rc->passive)
        return;
    rc->passive = true;
    rc->outbox.state_waiting = false;
    rc_tell_status(rc, now_us);
}

static bool is_ours(const rc_radio *rc, const rc_header *header) {
    return rc_is_robot(rc) && header->sender == rc->config.memory.identity.robot;
}

/* Is it of this fleet, and does it claim to be sealed as this fleet's frames are? Counted if not. */
static bool belongs(rc_radio *rc, const uint8_t *frame, size_t n, rc_header *header) {
    const rc_memory *memory = &rc->config.memory;
    if (n >= 2 && (frame[0] >> 4 != RC_PROTOCOL_VERSION || frame[1] != memory->identity.fleet)) {
        rc->counters.dropped_foreign++;
        return false;
    }
    if (n > RC_MAX_FRAME || !rc_header_decode(frame, n, header)) {
        rc->counters.dropped_malformed++;
        return false;
    }
    if (header->sealed != memory->keyed) {
        rc->counters.dropped_seal++;
        return false;
    }
    return true;
}

/* Header and plain body, *n bytes, which may lie in buffer[RC_MAX_FRAME]; NULL for a frame that is forged or
 * malformed, then counted. */
static const uint8_t *opened(rc_radio *rc, const rc_header *header, const uint8_t *mac, const uint8_t *frame,
                             size_t *n, uint8_t *buffer) {
    const rc_config *config = &rc->config;
    if (header->sealed) {
        *n = rc_unseal(&config->cipher, config->memory.key, mac, frame, *n, buffer);
        frame = buffer;
    }
    if (*n == 0) {
        rc->counters.dropped_forged++;
        return NULL;
    }
    if (*n > RC_MAX_FRAME - RC_TAG_BYTES ||
        !rc_body_valid(header->kind, frame + RC_HEADER_BYTES, *n - RC_HEADER_BYTES)) {
        rc->counters.dropped_malformed++;
        return NULL;
    }
    return frame;
}

/* Of whoever sends it: a passive twin, one under another's id, one that sends too much. */
static void heed_stop(rc_radio *rc, uint64_t now_us, const rc_header *header, const uint8_t *body, size_t n) {
    rc_stop stop;
    if (header->kind == RC_STOP && rc_stop_decode(body, n, &stop))
        rc_stop_heard(&rc->stop, now_us, RC_STOP, &stop);
    rc_note_stop(rc, now_us);
}

static void learn_from(rc_radio *rc, uint64_t now_us, const rc_header *header, const uint8_t *body,
                       size_t n) {
    uint32_t round = rc_round_of(&rc->config.memory.schedule, header->fleet_time_us);
    if (header->kind == RC_STATE) {
        uint16_t counter = (uint16_t)(body[n - 2] | body[n - 1] << 8);
        rc_relay_heard_state(&rc->relay, round, header->sender, body, n);
        rc_stop_shown(&rc->stop, now_us, header->sender, body[1] & 1, counter);
    } else if (header->kind == RC_RELAY) {
        rc_relay_heard_relay(&rc->relay, round, header->sender, body, n);
    } else if (header->kind == RC_RESUME) {
        rc_stop resume;
        if (rc_stop_decode(body, n, &resume))
            rc_stop_heard(&rc->stop, now_us, RC_RESUME, &resume);
    }
    rc_note_stop(rc, now_us);
}

static void believe(rc_radio *rc, uint64_t now_us, int8_t rssi_dbm, const rc_header *header,
                    const uint8_t *plain, size_t n) {
    rc->counters.received++;
    uint32_t way_us = rc_airtime_us(n + (header->sealed ? RC_TAG_BYTES : 0), rc->config.memory.rate_mbps);
    /* An operator's radio comes and goes: the fleet's time is the robots'. */
    if (header->sender < RC_MAX_ROBOTS)
        rc_fleet_time_heard(&rc->time, now_us, header->fleet_time_us, way_us + RC_FRAME_DELAY_US);
    uint8_t frame[RC_LINK_MAX_ENCODED];
    uint64_t fleet_us = rc_fleet_time_at(&rc->time, now_us);
    rc_tell_host(rc, frame, rc_heard_encode(now_us, fleet_us, rssi_dbm, plain, n, frame + 1));
    if (rc_round_of(&rc->config.memory.schedule, fleet_us) != rc->round)
        rc_follow_rounds(rc, now_us); /* the frame is the first of a round */
    learn_from(rc, now_us, header, plain + RC_HEADER_BYTES, n - RC_HEADER_BYTES);
}

/* Authentic and new, but not from whom we take frames. */
static bool turned_away(rc_radio *rc, uint64_t now_us, const rc_header *header, const uint8_t *mac,
                        rc_judgement judgement, rc_peer *place) {
    if (is_ours(rc, header)) {
        if (memcmp(mac, rc->config.about.mac, RC_MAC_BYTES) != 0)
            go_passive(rc, now_us);
        return true;
    }
    if (judgement == RC_IMPOSTOR) {
        rc->counters.dropped_impostor++;
        rc_peer_impostor(place, now_us);
        return true;
    }
    return false;
}

void rc_air_rx(rc_radio *rc, uint64_t now_us, int8_t rssi_dbm, const uint8_t *mac, const uint8_t *frame,
               size_t n) {
    rc_header header;
    if (rc->restart || !belongs(rc, frame, n, &header))
        return;
    rc_peer *place = place_of(rc, &header, mac);
    rc_peer peer = judged_as(place, &header, mac);
    bool keyed = rc->config.memory.keyed;
    rc_judgement judgement = rc_peer_judge(&peer, mac, header.boot, header.sequence, now_us, keyed);
    if (judgement == RC_REPLAYED && !is_ours(rc, &header)) {
        rc->counters.dropped_replayed++;
        return;
    }
    uint8_t buffer[RC_MAX_FRAME];
    const uint8_t *plain = opened(rc, &header, mac, frame, &n, buffer);
    if (plain == NULL)
        return;
    heed_stop(rc, now_us, &header, plain + RC_HEADER_BYTES, n - RC_HEADER_BYTES);
    if (turned_away(rc, now_us, &header, mac, judgement, place))
        return;
    if (!rc_peer_count(&peer, now_us)) {
        rc->counters.dropped_babble++;
        *place = peer;
        return;
    }
    bool new_boot = rc_peer_accept(&peer, mac, header.boot, header.sequence, rssi_dbm, now_us);
    *place = peer;
    if (new_boot)
        keep_boot(rc, &header, place);
    believe(rc, now_us, rssi_dbm, &header, plain, n);
}
