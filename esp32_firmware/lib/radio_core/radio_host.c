/* The side of the host: messages from USB, and the ring of messages for it. */
#include <string.h>

#include "radio_parts.h"

/* What the radio itself has to say (rounds, STOP, status) still finds room when frames heard do not. */
enum { RESERVE_BYTES = 1024 };

bool rc_tell_host(rc_radio *rc, uint8_t *frame, size_t n) {
    bool crowded = frame[1] == RC_LINK_HEARD && rc->to_host.used > RC_RING_BYTES - RESERVE_BYTES;
    if (!crowded && rc_ring_put(&rc->to_host, frame, rc_cobs_close(frame, n)))
        return true;
    rc->counters.dropped_usb++;
    return false;
}

size_t rc_usb_tx(rc_radio *rc, uint8_t *out, size_t cap) {
    return rc_ring_take(&rc->to_host, out, cap);
}

static void answer_hello(rc_radio *rc, uint64_t now_us) {
    const rc_memory *memory = &rc->config.memory;
    uint8_t frame[RC_LINK_MAX_ENCODED];
    rc_identity identity = rc_identity_in_use(rc);
    size_t n = rc_reply_encode(&rc->config.about, memory->boot_counter, &identity, &memory->schedule,
                               memory->rate_mbps, rc_condition_of(rc, now_us).flags, frame + 1);
    rc_tell_host(rc, frame, n);
}

/* A radio that nobody provisioned takes fleet and channel from whoever asks, and the robot id if one is
 * named. */
static void adopt_identity(rc_radio *rc, const rc_identity *identity) {
    rc_memory *memory = &rc->config.memory;
    if (rc_is_robot(rc) || memory->provisioned || memory->keyed)
        return;
    memory->identity = *identity;
    rc->tuned = identity->channel;
    rc_relay_init(&rc->relay, identity->robot);
    if (rc_is_robot(rc))
        rc->dirty |= RC_KEEP_IDENTITY;
}

/* The host's configuration is the fleet's; the fleet digest shows where one differs. */
static void adopt_schedule(rc_radio *rc, uint64_t now_us, const rc_schedule *schedule) {
    rc_memory *memory = &rc->config.memory;
    if (memory->schedule.round_ms == schedule->round_ms && memory->schedule.slots == schedule->slots)
        return;
    memory->schedule = *schedule;
    if (now_us < rc->listen_until_us) /* three rounds, of these */
        rc->listen_until_us = now_us + RC_LISTEN_ROUNDS * (uint64_t)rc_round_us(rc);
    if (rc_is_robot(rc))
        rc->dirty |= RC_KEEP_IDENTITY;
}

static void on_provision(rc_radio *rc, const rc_provision *given) {
    rc_memory *memory = &rc->config.memory;
    if (given->link_version != RC_LINK_VERSION || rc->provisioning || rc->restart)
        return;
    bool other = memory->identity.fleet != given->identity.fleet || memory->keyed != given->keyed ||
                 memcmp(memory->key, given->key, RC_KEY_BYTES) != 0;
    if (other) { /* what was heard of another fleet says nothing about this one */
        memset(memory->peer_boots, 0, sizeof memory->peer_boots);
        memset(memory->operators, 0, sizeof memory->operators);
        memory->stop_counter = memory->stop_resumed = 0;
    }
    memory->identity = given->identity;
    memory->rate_mbps = given->rate_mbps;
    memory->provisioned = 1;
    memory->keyed = given->keyed;
    memcpy(memory->key, given->key, RC_KEY_BYTES);
    if (memory->boot_counter < given->unix_s)
        memory->boot_counter = given->unix_s;
    rc->keep_failed = false;
    rc->provisioning = true; /* nothing more is sent: the counter in use is not this one */
    rc->dirty |= RC_KEEP_IDENTITY | RC_KEEP_BOOT | RC_KEEP_PEERS | RC_KEEP_STOP;
}

static void on_send(rc_radio *rc, uint64_t now_us, const rc_send *send) {
    if (send->kind == RC_STATE && (!rc_is_robot(rc) || rc->passive)) {
        rc->counters.send_failed++;
        return;
    }
    if (send->kind == RC_STATE)
        rc->state_since_us = now_us;
    if (send->kind == RC_TASKS && rc->outbox.count == 0)
        rc->tasks_since_us = now_us;
    switch (rc_outbox_put(&rc->outbox, send->kind, send->body, send->length)) {
    case RC_QUEUED:
        break;
    case RC_REPLACED:
        rc->counters.replaced++;
        break;
    case RC_LOST:
        rc->counters.send_failed++;
        break;
    }
}

static void on_command(rc_radio *rc, uint64_t now_us, const rc_command *command) {
    if (command->kind == RC_STOP)
        rc_stop_raise(&rc->stop, now_us, RC_OPERATOR, command->reason);
    else if (!rc_stop_resume(&rc->stop, now_us, command->counter, RC_OPERATOR, command->reason))
        rc->counters.send_failed++;
    rc_note_stop(rc, now_us);
}

static void report_peer(rc_radio *rc, uint64_t now_us, uint8_t robot, const rc_peer *peer) {
    if (!peer->known)
        return;
    uint64_t age_ms = (now_us - peer->heard_us) / 1000;
    rc_peer_report report = {
        .robot = robot,
        .boot = peer->boot,
        .sequence = peer->sequence,
        .rssi_dbm = peer->rssi_dbm,
        .age_ms = age_ms < UINT32_MAX ? (uint32_t)age_ms : UINT32_MAX,
        .received = peer->received,
        .loss = robot < RC_MAX_ROBOTS ? rc_relay_loss_to_us(&rc->relay, robot) : 0,
        .flags = (uint8_t)(rc_peer_alive(peer, now_us) | peer->babbling << 1 | peer->duplicate << 2),
    };
    memcpy(report.mac, peer->mac, RC_MAC_BYTES);
    uint8_t frame[RC_LINK_MAX_ENCODED];
    rc_tell_host(rc, frame, rc_peer_encode(&report, frame + 1));
}

static void report_peers(rc_radio *rc, uint64_t now_us) {
    for (uint8_t i = 0; i < RC_MAX_ROBOTS; i++)
        report_peer(rc, now_us, i, &rc->peers[i]);
    for (size_t i = 0; i < RC_OPERATORS; i++)
        report_peer(rc, now_us, RC_OPERATOR, &rc->operators[i]);
    rc_tell_status(rc, now_us); /* closes the list */
}

static void on_hello(rc_radio *rc, uint64_t now_us, const rc_hello *hello) {
    if (hello->link_version == RC_LINK_VERSION) {
        adopt_identity(rc, &hello->identity);
        adopt_schedule(rc, now_us, &hello->schedule);
    }
    answer_hello(rc, now_us);
}

static void on_message(rc_radio *rc, uint64_t now_us, const uint8_t *payload, size_t n) {
    union {
        rc_hello hello;
        rc_send send;
        rc_provision provision;
        rc_command command;
    } m;
    if (n >= 2 && payload[0] == RC_LINK_HELLO && payload[1] != RC_LINK_VERSION)
        answer_hello(rc, now_us); /* of another version, whatever else it says */
    else if (rc_hello_decode(payload, n, &m.hello))
        on_hello(rc, now_us, &m.hello);
    else if (rc_send_decode(payload, n, &m.send) && rc_body_valid(m.send.kind, m.send.body, m.send.length))
        on_send(rc, now_us, &m.send);
    else if (rc_provision_decode(payload, n, &m.provision))
        on_provision(rc, &m.provision);
    else if (rc_command_decode(payload, n, &m.command))
        on_command(rc, now_us, &m.command);
    else if (rc_ask_peers_decode(payload, n))
        report_peers(rc, now_us);
    else
        rc->counters.dropped_usb++;
}

void rc_usb_rx(rc_radio *rc, uint64_t now_us, const uint8_t *bytes, size_t n) {
    for (size_t i = 0; i < n; i++) {
        int length = rc_cobs_push(&rc->from_host, bytes[i]);
        if (length >= 0)
            on_message(rc, now_us, rc->from_host.buffer, (size_t)length);
    }
}
