/* Header and dispatch over the kinds of frames. */
#include "frame.h"

#include "bytes.h"

enum { KIND_BITS = 7 };

/* An operator's radio sends tasks, STOP and RESUME, nothing that only a robot can say. */
static bool sender_valid(uint8_t kind, uint8_t sender) {
    return sender < RC_MAX_ROBOTS || (sender == RC_OPERATOR && kind >= RC_TASKS);
}

static bool header_valid(const rc_header *header) {
    return header->kind >= RC_STATE && header->kind <= RC_RESUME && header->sealed <= 1 &&
           sender_valid(header->kind, header->sender) && header->sequence <= RC_MAX_SEQUENCE &&
           header->fleet_time_us < 1ull << 48;
}

size_t rc_header_encode(const rc_header *header, uint8_t *out) {
    if (!header_valid(header))
        return 0;
    unsigned first = RC_PROTOCOL_VERSION << 4 | header->kind | (header->sealed ? RC_SEALED : 0u);
    uint8_t *at = rc_put8(out, (uint8_t)first);
    at = rc_put8(at, header->fleet);
    at = rc_put8(at, header->sender);
    at = rc_put32(at, header->boot);
    at = rc_put24(at, header->sequence);
    at = rc_put48(at, header->fleet_time_us);
    return (size_t)(at - out);
}

bool rc_header_decode(const uint8_t *frame, size_t n, rc_header *header) {
    if (n < RC_HEADER_BYTES || frame[0] >> 4 != RC_PROTOCOL_VERSION)
        return false;
    const uint8_t *at = frame;
    uint8_t first = rc_take8(&at);
    header->kind = first & KIND_BITS;
    header->sealed = (first & RC_SEALED) != 0;
    header->fleet = rc_take8(&at);
    header->sender = rc_take8(&at);
    header->boot = rc_take32(&at);
    header->sequence = rc_take24(&at);
    header->fleet_time_us = rc_take48(&at);
    return header_valid(header);
}

bool rc_body_valid(uint8_t kind, const uint8_t *body, size_t n) {
    switch (kind) {
    case RC_STATE:
        return rc_state_valid(body, n);
    case RC_RELAY:
        return rc_relay_valid(body, n);
    case RC_TASKS:
        return rc_tasks_valid(body, n);
    case RC_STOP:
    case RC_RESUME:
        return n == RC_STOP_BYTES;
    default:
        return false;
    }
}

bool rc_frame_valid(const uint8_t *frame, size_t n) {
    rc_header header;
    return rc_header_decode(frame, n, &header) &&
           rc_body_valid(header.kind, frame + RC_HEADER_BYTES, n - RC_HEADER_BYTES);
}
