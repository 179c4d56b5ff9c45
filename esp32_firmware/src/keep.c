#include "keep.h"

#include "bytes.h"

enum { VERSION = 1, IDENTITY_BYTES = 26, PEERS_BYTES = KEEP_MAX_BYTES, STOP_BYTES = 5 };

static size_t length_of(unsigned part) {
    switch (part) {
    case RC_KEEP_IDENTITY:
        return IDENTITY_BYTES;
    case RC_KEEP_PEERS:
        return PEERS_BYTES;
    case RC_KEEP_STOP:
        return STOP_BYTES;
    default:
        return 0;
    }
}

static void put_identity(const rc_memory *memory, uint8_t *at) {
    at = rc_put8(at, memory->identity.robot);
    at = rc_put8(at, memory->identity.fleet);
    at = rc_put8(at, memory->identity.channel);
    at = rc_put16(at, memory->schedule.round_ms);
    at = rc_put8(at, memory->schedule.slots);
    at = rc_put8(at, memory->rate_mbps);
    at = rc_put8(at, memory->provisioned);
    at = rc_put8(at, memory->keyed);
    rc_put_bytes(at, memory->key, RC_KEY_BYTES);
}

static bool take_identity(rc_memory *memory, const uint8_t *at) {
    rc_memory read = *memory;
    read.identity.robot = rc_take8(&at);
    read.identity.fleet = rc_take8(&at);
    read.identity.channel = rc_take8(&at);
    read.schedule.round_ms = rc_take16(&at);
    read.schedule.slots = rc_take8(&at);
    read.rate_mbps = rc_take8(&at);
    read.provisioned = rc_take8(&at);
    read.keyed = rc_take8(&at);
    rc_take_bytes(&at, read.key, RC_KEY_BYTES);
    if (read.provisioned > 1 || read.keyed > 1)
        return false;
    *memory = read;
    return true;
}

static void put_peers(const rc_memory *memory, uint8_t *at) {
    for (size_t i = 0; i < RC_MAX_ROBOTS; i++)
        at = rc_put32(at, memory->peer_boots[i]);
    for (size_t i = 0; i < RC_OPERATORS; i++) {
        at = rc_put_bytes(at, memory->operators[i].mac, RC_MAC_BYTES);
        at = rc_put32(at, memory->operators[i].boot);
    }
}

static void take_peers(rc_memory *memory, const uint8_t *at) {
    for (size_t i = 0; i < RC_MAX_ROBOTS; i++)
        memory->peer_boots[i] = rc_take32(&at);
    for (size_t i = 0; i < RC_OPERATORS; i++) {
        rc_take_bytes(&at, memory->operators[i].mac, RC_MAC_BYTES);
        memory->operators[i].boot = rc_take32(&at);
    }
}

size_t keep_encode(const rc_memory *memory, unsigned part, uint8_t *out) {
    uint8_t *at = rc_put8(out, VERSION);
    if (part == RC_KEEP_IDENTITY)
        put_identity(memory, at);
    else if (part == RC_KEEP_PEERS)
        put_peers(memory, at);
    else if (part == RC_KEEP_STOP)
        rc_put16(rc_put16(at, memory->stop_counter), memory->stop_resumed);
    return length_of(part);
}

bool keep_decode(rc_memory *memory, unsigned part, const uint8_t *bytes, size_t n) {
    if (n == 0 || n != length_of(part) || bytes[0] != VERSION)
        return false;
    const uint8_t *at = bytes + 1;
    if (part == RC_KEEP_IDENTITY)
        return take_identity(memory, at);
    if (part == RC_KEEP_PEERS) {
        take_peers(memory, at);
    } else {
        memory->stop_counter = rc_take16(&at);
        memory->stop_resumed = rc_take16(&at);
    }
    return true;
}
