#include "radio_core.h"

#include <string.h>

#include "bytes.h"

size_t rc_size(void) {
    return sizeof(rc_radio);
}

void rc_init(rc_radio *rc, const rc_config *config) {
    memset(rc, 0, sizeof *rc);
    rc->config = *config;
    if (!rc_identity_valid(&config->identity))
        rc->config.identity =
            (rc_identity){.robot = RC_NO_ROBOT, .fleet = config->identity.fleet, .channel = 1};
}

rc_identity rc_identity_of(const rc_radio *rc) {
    return rc->config.identity;
}

rc_counters rc_counters_of(const rc_radio *rc) {
    rc_counters counters = rc->counters;
    counters.usb_skipped_bytes = rc->from_host.skipped_bytes;
    counters.usb_bad_checksums = rc->from_host.bad_checksums;
    return counters;
}

void rc_lost(rc_radio *rc, uint32_t messages) {
    rc->counters.dropped_usb += messages;
}

/* ---- to the host -------------------------------------------------------------------------------------- */

static void tell_host(rc_radio *rc, const uint8_t *payload, size_t n) {
    uint8_t framed[RC_LINK_MAX_ENCODED];
    size_t length = rc_cobs_encode(payload, n, framed);
    if (!rc_ring_put(&rc->to_host, framed, length))
        rc->counters.dropped_usb++;
}

size_t rc_usb_tx(rc_radio *rc, uint8_t *out, size_t cap) {
    return rc_ring_take(&rc->to_host, out, cap);
}

static void send_status(rc_radio *rc, uint64_t now_us) {
    uint8_t payload[RC_LINK_MAX_PAYLOAD];
    rc_condition condition = {.uptime_us = now_us, .flags = RC_FLAG_OPEN};
    tell_host(rc, payload,
              rc_status_encode(&rc->config.about, &rc->config.identity, &condition, &rc->counters, payload));
}

/* ---- from the host ------------------------------------------------------------------------------------ */

/* A radio without a robot id takes fleet and channel from whoever asks, and the id if one is named. */
static void on_hello(rc_radio *rc, const rc_hello *hello) {
    if (hello->link_version == RC_LINK_VERSION && rc->config.identity.robot == RC_NO_ROBOT)
        rc->config.identity = hello->identity;
    uint8_t payload[RC_LINK_MAX_PAYLOAD];
    tell_host(rc, payload, rc_reply_encode(&rc->config.about, &rc->config.identity, payload));
}

static void on_send(rc_radio *rc, const rc_send *send) {
    if (rc->config.identity.robot == RC_NO_ROBOT) {
        rc->counters.send_failed++;
        return;
    }
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

static void on_message(rc_radio *rc, const uint8_t *payload, size_t n) {
    rc_hello hello;
    rc_send send;
    if (rc_hello_decode(payload, n, &hello))
        on_hello(rc, &hello);
    else if (rc_send_decode(payload, n, &send) && rc_body_valid(send.kind, send.body, send.length))
        on_send(rc, &send);
    else
        rc->counters.dropped_usb++;
}

void rc_usb_rx(rc_radio *rc, uint64_t now_us, const uint8_t *bytes, size_t n) {
    (void)now_us; /* nothing the host says is timed yet */
    for (size_t i = 0; i < n; i++) {
        int length = rc_cobs_push(&rc->from_host, bytes[i]);
        if (length >= 0)
            on_message(rc, rc->from_host.buffer, (size_t)length);
    }
}

/* ---- from the air ------------------------------------------------------------------------------------- */

static bool foreign(const rc_radio *rc, const uint8_t *frame, size_t n) {
    return n >= 2 && (frame[0] >> 4 != RC_PROTOCOL_VERSION || frame[1] != rc->config.identity.fleet);
}

void rc_air_rx(rc_radio *rc, uint64_t now_us, int8_t rssi_dbm, const uint8_t *frame, size_t n) {
    if (foreign(rc, frame, n)) {
        rc->counters.dropped_foreign++;
        return;
    }
    rc_header header;
    if (!rc_frame_valid(frame, n) || !rc_header_decode(frame, n, &header)) {
        rc->counters.dropped_malformed++;
        return;
    }
    if (!rc_peer_fresh(&rc->peers[header.sender], header.boot, header.sequence)) {
        rc->counters.dropped_duplicate++;
        return;
    }
    rc->counters.received++;
    uint8_t payload[RC_LINK_MAX_PAYLOAD];
    tell_host(rc, payload, rc_heard_encode(now_us, rssi_dbm, frame, n, payload));
}

/* ---- to the air --------------------------------------------------------------------------------------- */

size_t rc_air_tx(rc_radio *rc, uint64_t now_us, uint8_t *out) {
    rc_body body;
    if (rc->flight.up || rc->config.identity.robot == RC_NO_ROBOT || !rc_outbox_take(&rc->outbox, &body))
        return 0;
    rc->sequence = (rc->sequence + 1) & 0xffffffu;
    rc->flight = (rc_flight){.up = true, .kind = body.kind, .sequence = rc->sequence, .since_us = now_us};
    rc_header header = {
        .kind = body.kind,
        .fleet = rc->config.identity.fleet,
        .sender = rc->config.identity.robot,
        .boot = rc->config.about.boot_counter,
        .sequence = rc->sequence,
        .fleet_time_us = now_us & 0xffffffffffffu, /* own clock, until the fleet agrees on a time */
    };
    uint8_t *at = out + rc_header_encode(&header, out);
    at = rc_put_bytes(at, body.bytes, body.length);
    return (size_t)(at - out);
}

static void land(rc_radio *rc, uint64_t now_us, bool ok) {
    rc->flight.up = false;
    if (ok)
        rc->counters.sent++;
    else
        rc->counters.send_failed++;
    uint8_t payload[RC_LINK_MAX_PAYLOAD];
    tell_host(rc, payload, rc_sent_encode(now_us, rc->flight.kind, rc->flight.sequence, ok, payload));
}

/* A call after the timeout finds nothing in flight, or is taken for the next frame: at worst two overlap. */
void rc_air_done(rc_radio *rc, uint64_t now_us, bool ok) {
    if (rc->flight.up)
        land(rc, now_us, ok);
}

void rc_tick(rc_radio *rc, uint64_t now_us) {
    if (rc->flight.up && now_us >= rc->flight.since_us + RC_IN_FLIGHT_TIMEOUT_US)
        land(rc, now_us, false);
    if (now_us >= rc->next_status_us) {
        send_status(rc, now_us);
        rc->next_status_us = now_us + RC_STATUS_PERIOD_US - now_us % RC_STATUS_PERIOD_US;
    }
}
