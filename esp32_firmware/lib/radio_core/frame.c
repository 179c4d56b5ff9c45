/* Header and dispatch over the kinds of frames. */
#include "frame.h"

#include "bytes.h"

static bool header_valid(const rc_header *header) {
    return header->kind >= RC_STATE && header->kind <= RC_RESUME && header->sender < RC_MAX_ROBOTS &&
           header->sequence < 1u << 24 && header->fleet_time_us < 1ull << 48;
}

size_t rc_header_encode(const rc_header *header, uint8_t *out) {
    if (!header_valid(header))
        return 0;
    uint8_t *at = rc_put8(out, (uint8_t)(RC_PROTOCOL_VERSION << 4 | header->kind));
    at = rc_put8(at, header->fleet);
    at = rc_put8(at, header->sender);
    at = rc_put32(at, header->boot);
    at = rc_put(at, header->sequence, 3);
    at = rc_put(at, header->fleet_time_us, 6);
    return (size_t)(at - out);
}

bool rc_header_decode(const uint8_t *frame, size_t n, rc_header *header) {
    if (n < RC_HEADER_BYTES || frame[0] >> 4 != RC_PROTOCOL_VERSION)
        return false;
    const uint8_t *at = frame;
    header->kind = rc_take8(&at) & 15;
    header->fleet = rc_take8(&at);
    header->sender = rc_take8(&at);
    header->boot = rc_take32(&at);
    header->sequence = (uint32_t)rc_take(&at, 3);
    header->fleet_time_us = rc_take(&at, 6);
    return header_valid(header);
}

bool rc_body_valid(uint8_t kind, const uint8_t *body, size_t n) {
    union {
        rc_state state;
        rc_relay relay;
        rc_tasks tasks;
        rc_stop stop;
    } scratch;
    switch (kind) {
    case RC_STATE:
        return rc_state_decode(body, n, &scratch.state);
    case RC_RELAY:
        return rc_relay_decode(body, n, &scratch.relay);
    case RC_TASKS:
        return rc_tasks_decode(body, n, &scratch.tasks);
    case RC_STOP:
    case RC_RESUME:
        return rc_stop_decode(body, n, &scratch.stop);
    default:
        return false;
    }
}

bool rc_frame_valid(const uint8_t *frame, size_t n) {
    rc_header header;
    return rc_header_decode(frame, n, &header) &&
           rc_body_valid(header.kind, frame + RC_HEADER_BYTES, n - RC_HEADER_BYTES);
}
