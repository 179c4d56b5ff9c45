#include "link.h"

#include "bytes.h"
#include "cobs.h"

enum { SEND_HEAD_BYTES = 2, COMMAND_BYTES = 5, ASK_PEERS_BYTES = 1, MAX_HEARD = RC_MAX_FRAME - RC_TAG_BYTES };

_Static_assert((int)RC_HEARD_HEAD_BYTES + (int)MAX_HEARD == (int)RC_LINK_MAX_PAYLOAD, "the longest message");
_Static_assert((int)SEND_HEAD_BYTES + (int)RC_MAX_BODY <= (int)RC_LINK_MAX_PAYLOAD, "a body fits the link");
_Static_assert((int)RC_STATUS_BYTES <= (int)RC_LINK_MAX_PAYLOAD, "a status fits the link");
_Static_assert((int)RC_REPLY_BYTES <= (int)RC_LINK_MAX_PAYLOAD, "a reply to hello fits the link");

bool rc_identity_valid(const rc_identity *identity) {
    return (identity->robot < RC_MAX_ROBOTS || identity->robot == RC_NO_ROBOT) && identity->channel >= 1 &&
           identity->channel <= RC_MAX_CHANNEL;
}

bool rc_rate_valid(uint8_t rate_mbps) {
    return rate_mbps == 6 || rate_mbps == 12 || rate_mbps == 24;
}

/* ---- from the host ------------------------------------------------------------------------------------ */

static rc_identity take_identity(const uint8_t **at) {
    rc_identity identity;
    identity.robot = rc_take8(at);
    identity.fleet = rc_take8(at);
    identity.channel = rc_take8(at);
    return identity;
}

bool rc_hello_decode(const uint8_t *payload, size_t n, rc_hello *hello) {
    if (n != RC_HELLO_BYTES || payload[0] != RC_LINK_HELLO)
        return false;
    const uint8_t *at = payload + 1;
    hello->link_version = rc_take8(&at);
    hello->identity = take_identity(&at);
    hello->schedule.round_ms = rc_take16(&at);
    hello->schedule.slots = rc_take8(&at);
    return rc_identity_valid(&hello->identity) && rc_schedule_valid(&hello->schedule);
}

bool rc_send_decode(const uint8_t *payload, size_t n, rc_send *send) {
    if (n <= SEND_HEAD_BYTES || n > SEND_HEAD_BYTES + RC_MAX_BODY || payload[0] != RC_LINK_SEND)
        return false;
    send->kind = payload[1];
    send->body = payload + SEND_HEAD_BYTES;
    send->length = n - SEND_HEAD_BYTES;
    return send->kind == RC_STATE || send->kind == RC_TASKS;
}

/* No key is all zeros: such a one is a mistake, an erased flash or an empty file. OPEN has nothing else. */
static bool key_valid(uint8_t keyed, const uint8_t *key) {
    unsigned bits = 0;
    for (size_t i = 0; i < RC_KEY_BYTES; i++)
        bits |= key[i];
    return keyed <= 1 && (keyed == 1) == (bits != 0);
}

bool rc_provision_decode(const uint8_t *payload, size_t n, rc_provision *provision) {
    if (n != RC_PROVISION_BYTES || payload[0] != RC_LINK_PROVISION)
        return false;
    const uint8_t *at = payload + 1;
    provision->link_version = rc_take8(&at);
    provision->identity = take_identity(&at);
    provision->rate_mbps = rc_take8(&at);
    provision->keyed = rc_take8(&at);
    rc_take_bytes(&at, provision->key, RC_KEY_BYTES);
    provision->unix_s = rc_take32(&at);
    return rc_identity_valid(&provision->identity) && rc_rate_valid(provision->rate_mbps) &&
           key_valid(provision->keyed, provision->key);
}

bool rc_command_decode(const uint8_t *payload, size_t n, rc_command *command) {
    if (n != COMMAND_BYTES || payload[0] != RC_LINK_COMMAND)
        return false;
    const uint8_t *at = payload + 1;
    command->kind = rc_take8(&at);
    command->counter = rc_take16(&at);
    command->reason = rc_take8(&at);
    return command->kind == RC_RESUME || (command->kind == RC_STOP && command->counter == 0);
}

bool rc_ask_peers_decode(const uint8_t *payload, size_t n) {
    return n == ASK_PEERS_BYTES && payload[0] == RC_LINK_ASK_PEERS;
}

/* ---- for the host ------------------------------------------------------------------------------------- */

static uint8_t *put_identity(uint8_t *at, const rc_identity *identity) {
    at = rc_put8(at, identity->robot);
    at = rc_put8(at, identity->fleet);
    return rc_put8(at, identity->channel);
}

static uint8_t *put_schedule(uint8_t *at, const rc_schedule *schedule) {
    at = rc_put16(at, schedule->round_ms);
    return rc_put8(at, schedule->slots);
}

static uint8_t *put_firmware(uint8_t *at, const rc_about *about) {
    at = rc_put_bytes(at, (const uint8_t *)about->firmware, sizeof about->firmware);
    return rc_put_bytes(at, (const uint8_t *)about->git_hash, sizeof about->git_hash);
}

size_t rc_reply_encode(const rc_about *about, uint32_t boot_counter, const rc_identity *identity,
                       const rc_schedule *schedule, uint8_t rate_mbps, uint16_t flags, uint8_t *out) {
    uint8_t *at = rc_put8(out, RC_LINK_HELLO_REPLY);
    at = rc_put8(at, RC_LINK_VERSION);
    at = rc_put8(at, RC_PROTOCOL_VERSION);
    at = rc_put32(at, about->boot_id);
    at = rc_put32(at, boot_counter);
    at = rc_put8(at, about->reset_reason);
    at = rc_put_bytes(at, about->mac, RC_MAC_BYTES);
    at = put_identity(at, identity);
    at = rc_put8(at, rate_mbps);
    at = rc_put16(at, flags);
    at = put_schedule(at, schedule);
    at = put_firmware(at, about);
    return (size_t)(at - out);
}

static uint8_t *put_condition(uint8_t *at, const rc_condition *condition) {
    at = rc_put64(at, condition->fleet_time_us);
    at = rc_put16(at, condition->stop_counter);
    at = rc_put16(at, condition->stop_resumed);
    at = rc_put64(at, condition->alive);
    at = rc_put64(at, condition->rebooted);
    at = rc_put64(at, condition->babbling);
    return rc_put64(at, condition->duplicate);
}

static uint8_t *put_counters(uint8_t *at, const rc_counters *counters) {
    at = rc_put32(at, counters->sent);
    at = rc_put32(at, counters->received);
    at = rc_put32(at, counters->relays);
    at = rc_put32(at, counters->replaced);
    at = rc_put32(at, counters->send_failed);
    at = rc_put32(at, counters->dropped_foreign);
    at = rc_put32(at, counters->dropped_malformed);
    at = rc_put32(at, counters->dropped_seal);
    at = rc_put32(at, counters->dropped_forged);
    at = rc_put32(at, counters->dropped_replayed);
    at = rc_put32(at, counters->dropped_impostor);
    at = rc_put32(at, counters->dropped_babble);
    return rc_put32(at, counters->dropped_usb);
}

size_t rc_status_encode(const rc_about *about, uint32_t boot_counter, const rc_identity *identity,
                        const rc_schedule *schedule, uint8_t rate_mbps, const rc_condition *condition,
                        const rc_counters *counters, uint8_t *out) {
    uint8_t *at = rc_put8(out, RC_LINK_STATUS);
    at = rc_put32(at, about->boot_id);
    at = rc_put32(at, boot_counter);
    at = rc_put8(at, about->reset_reason);
    at = rc_put64(at, condition->uptime_us);
    at = put_identity(at, identity);
    at = rc_put8(at, rate_mbps);
    at = rc_put16(at, condition->flags);
    at = put_schedule(at, schedule);
    at = put_condition(at, condition);
    at = put_counters(at, counters);
    at = put_firmware(at, about);
    return (size_t)(at - out);
}

size_t rc_heard_encode(uint64_t radio_time_us, uint64_t fleet_time_us, int8_t rssi_dbm, const uint8_t *frame,
                       size_t n, uint8_t *out) {
    if (n < RC_HEADER_BYTES || n > MAX_HEARD)
        return 0;
    uint8_t *at = rc_put8(out, RC_LINK_HEARD);
    at = rc_put64(at, radio_time_us);
    at = rc_put64(at, fleet_time_us);
    at = rc_put8(at, (uint8_t)rssi_dbm);
    at = rc_put_bytes(at, frame, n);
    return (size_t)(at - out);
}

size_t rc_sent_encode(uint64_t radio_time_us, uint8_t kind, uint32_t sequence, bool sent, uint8_t *out) {
    uint8_t *at = rc_put8(out, RC_LINK_SENT);
    at = rc_put64(at, radio_time_us);
    at = rc_put8(at, kind);
    at = rc_put32(at, sequence);
    at = rc_put8(at, sent);
    return (size_t)(at - out);
}

size_t rc_provisioned_encode(bool stored, uint32_t boot_counter, uint8_t *out) {
    uint8_t *at = rc_put8(out, RC_LINK_PROVISIONED);
    at = rc_put8(at, stored);
    at = rc_put32(at, boot_counter);
    return (size_t)(at - out);
}

size_t rc_peer_encode(const rc_peer_report *peer, uint8_t *out) {
    uint8_t *at = rc_put8(out, RC_LINK_PEER);
    at = rc_put8(at, peer->robot);
    at = rc_put_bytes(at, peer->mac, RC_MAC_BYTES);
    at = rc_put32(at, peer->boot);
    at = rc_put32(at, peer->sequence);
    at = rc_put8(at, (uint8_t)peer->rssi_dbm);
    at = rc_put32(at, peer->age_ms);
    at = rc_put32(at, peer->received);
    at = rc_put8(at, peer->loss);
    at = rc_put8(at, peer->flags);
    return (size_t)(at - out);
}

size_t rc_round_encode(uint32_t round, uint64_t fleet_time_us, uint64_t radio_time_us, uint64_t held,
                       bool agreed, uint8_t *out) {
    uint8_t *at = rc_put8(out, RC_LINK_ROUND);
    at = rc_put32(at, round);
    at = rc_put64(at, fleet_time_us);
    at = rc_put64(at, radio_time_us);
    at = rc_put64(at, held);
    at = rc_put8(at, agreed);
    return (size_t)(at - out);
}
