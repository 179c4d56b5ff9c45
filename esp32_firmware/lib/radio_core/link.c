#include "link.h"

#include "bytes.h"
#include "cobs.h"

enum { HELLO_BYTES = 5, SEND_HEAD_BYTES = 2, HEARD_HEAD_BYTES = 10 };

_Static_assert(HEARD_HEAD_BYTES + RC_MAX_FRAME <= RC_LINK_MAX_PAYLOAD, "a heard frame fits the link");
_Static_assert(SEND_HEAD_BYTES + RC_MAX_BODY <= RC_LINK_MAX_PAYLOAD, "a body fits the link");
_Static_assert((int)RC_STATUS_BYTES <= (int)RC_LINK_MAX_PAYLOAD, "a status fits the link");
_Static_assert((int)RC_REPLY_BYTES <= (int)RC_LINK_MAX_PAYLOAD, "a reply to hello fits the link");

bool rc_identity_valid(const rc_identity *identity) {
    return (identity->robot < RC_MAX_ROBOTS || identity->robot == RC_NO_ROBOT) && identity->channel >= 1 &&
           identity->channel <= RC_MAX_CHANNEL;
}

bool rc_hello_decode(const uint8_t *payload, size_t n, rc_hello *hello) {
    if (n != HELLO_BYTES || payload[0] != RC_LINK_HELLO)
        return false;
    const uint8_t *at = payload + 1;
    hello->link_version = rc_take8(&at);
    hello->identity.robot = rc_take8(&at);
    hello->identity.fleet = rc_take8(&at);
    hello->identity.channel = rc_take8(&at);
    return rc_identity_valid(&hello->identity);
}

bool rc_send_decode(const uint8_t *payload, size_t n, rc_send *send) {
    if (n <= SEND_HEAD_BYTES || n > SEND_HEAD_BYTES + RC_MAX_BODY || payload[0] != RC_LINK_SEND)
        return false;
    send->kind = payload[1];
    send->body = payload + SEND_HEAD_BYTES;
    send->length = n - SEND_HEAD_BYTES;
    return send->kind >= RC_STATE && send->kind <= RC_RESUME;
}

static uint8_t *put_identity(uint8_t *at, const rc_identity *identity) {
    at = rc_put8(at, identity->robot);
    at = rc_put8(at, identity->fleet);
    return rc_put8(at, identity->channel);
}

size_t rc_reply_encode(const rc_about *about, const rc_identity *identity, uint8_t *out) {
    uint8_t *at = rc_put8(out, RC_LINK_HELLO_REPLY);
    at = rc_put8(at, RC_LINK_VERSION);
    at = rc_put8(at, RC_PROTOCOL_VERSION);
    at = rc_put32(at, about->boot_id);
    at = rc_put32(at, about->boot_counter);
    at = rc_put8(at, about->reset_reason);
    at = rc_put_bytes(at, about->mac, sizeof about->mac);
    at = put_identity(at, identity);
    at = rc_put_bytes(at, (const uint8_t *)about->firmware, sizeof about->firmware);
    at = rc_put_bytes(at, (const uint8_t *)about->git_hash, sizeof about->git_hash);
    return (size_t)(at - out);
}

size_t rc_status_encode(const rc_about *about, const rc_identity *identity, const rc_condition *condition,
                        const rc_counters *counters, uint8_t *out) {
    uint8_t *at = rc_put8(out, RC_LINK_STATUS);
    at = rc_put32(at, about->boot_id);
    at = rc_put32(at, about->boot_counter);
    at = rc_put8(at, about->reset_reason);
    at = rc_put(at, condition->uptime_us, 8);
    at = put_identity(at, identity);
    at = rc_put8(at, condition->flags);
    at = rc_put32(at, counters->sent);
    at = rc_put32(at, counters->received);
    at = rc_put32(at, counters->replaced);
    at = rc_put32(at, counters->send_failed);
    at = rc_put32(at, counters->dropped_foreign);
    at = rc_put32(at, counters->dropped_malformed);
    at = rc_put32(at, counters->dropped_duplicate);
    at = rc_put32(at, counters->dropped_usb);
    return (size_t)(at - out);
}

size_t rc_heard_encode(uint64_t radio_time_us, int8_t rssi_dbm, const uint8_t *frame, size_t n,
                       uint8_t *out) {
    if (n > RC_MAX_FRAME)
        return 0;
    uint8_t *at = rc_put8(out, RC_LINK_HEARD);
    at = rc_put(at, radio_time_us, 8);
    at = rc_put8(at, (uint8_t)rssi_dbm);
    at = rc_put_bytes(at, frame, n);
    return (size_t)(at - out);
}

size_t rc_sent_encode(uint64_t radio_time_us, uint8_t kind, uint32_t sequence, bool sent, uint8_t *out) {
    uint8_t *at = rc_put8(out, RC_LINK_SENT);
    at = rc_put(at, radio_time_us, 8);
    at = rc_put8(at, kind);
    at = rc_put32(at, sequence);
    at = rc_put8(at, sent);
    return (size_t)(at - out);
}
