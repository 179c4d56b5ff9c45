/* What is sent, in which turn. What is heard is in radio_hear.c. */
#include "radio_parts.h"

/* A sequence number is used once in a boot. When they run out the next boot counter begins, once it is
 * stored. */
static void begin_next_boot(rc_radio *rc) {
    rc->boot_ready = false;
    if (rc->config.memory.boot_counter == UINT32_MAX)
        return; /* there is none: unsafe from now on */
    rc->sequence = 0;
    rc->config.memory.boot_counter++;
    rc->dirty |= RC_KEEP_BOOT;
}

/* Header, and the seal where there is a key; frame already holds the body. 0: cannot be sent. */
static size_t finish(rc_radio *rc, uint64_t now_us, uint8_t kind, uint8_t *frame, size_t body_bytes) {
    const rc_config *config = &rc->config;
    /* Under a doubled id nobody is believed: STOP goes out as an operator's. */
    uint8_t sender = rc->passive ? RC_OPERATOR : config->memory.identity.robot;
    rc->sequence++;
    rc_header header = {
        .kind = kind,
        .sealed = config->memory.keyed,
        .fleet = config->memory.identity.fleet,
        .sender = sender,
        .boot = config->memory.boot_counter,
        .sequence = rc->sequence,
        .fleet_time_us = rc_fleet_time_at(&rc->time, now_us),
    };
    size_t n = rc_header_encode(&header, frame);
    n = n > 0 ? n + body_bytes : 0;
    if (n > 0 && config->memory.keyed)
        n = rc_seal(&config->cipher, config->memory.key, config->about.mac, frame, n);
    if (n == 0) {
        rc->counters.send_failed++;
        return 0;
    }
    rc->flight = (rc_flight){.up = true, .kind = kind, .sequence = rc->sequence, .since_us = now_us};
    return n;
}

static size_t take_stop(rc_radio *rc, uint64_t now_us, uint8_t *kind, uint8_t *body) {
    rc_stop stop;
    if (!rc_stop_next(&rc->stop, now_us, rc_round_us(rc), rc_alive(rc, now_us), kind, &stop))
        return 0;
    return rc_stop_encode(&stop, body);
}

static size_t take_state(rc_radio *rc, uint64_t now_us, uint8_t *kind, uint8_t *body) {
    uint64_t round = (uint64_t)rc->round + 1;
    size_t n = rc->state_round == round ? 0 : rc_outbox_take_state(&rc->outbox, body);
    if (n == 0)
        return 0;
    /* A vote must not travel longer than its host reckons with (DELAY_ROUNDS in fleet/timing.py). */
    if (now_us - rc->state_since_us > RC_STATE_ROUNDS * (uint64_t)rc_round_us(rc)) {
        rc->counters.send_failed++;
        return 0;
    }
    rc->state_round = round;
    *kind = RC_STATE;
    rc_state_put_heard(body, rc_relay_heard_bits(&rc->relay));
    rc_relay_own(&rc->relay, rc->round, body, n);
    return n;
}

static size_t take_tasks(rc_radio *rc, uint64_t now_us, uint8_t *kind, uint8_t *body) {
    *kind = RC_TASKS;
    rc->tasks_since_us = now_us;
    return rc_outbox_take_tasks(&rc->outbox, body);
}

static size_t take_relay(rc_radio *rc, uint8_t *kind, uint8_t *body) {
    size_t n = rc_relay_fill(&rc->relay, body);
    *kind = RC_RELAY;
    rc->counters.relays += n > 0;
    return n;
}

/* What goes out in our turn: STATE first, late ones instead of a relay; TASKS that wait longer than a round
 * go in RELAY-2, else where nobody needs a row. */
static size_t take_for_turn(rc_radio *rc, uint64_t now_us, uint8_t phase, uint8_t *kind, uint8_t *body) {
    size_t n = take_state(rc, now_us, kind, body);
    if (n > 0 || phase == 0)
        return n;
    bool patient = phase == 1 || now_us - rc->tasks_since_us < rc_round_us(rc);
    if (!patient)
        n = take_tasks(rc, now_us, kind, body);
    if (n == 0)
        n = take_relay(rc, kind, body);
    return n > 0 ? n : take_tasks(rc, now_us, kind, body);
}

rc_turn rc_own_turn(const rc_radio *rc, uint64_t fleet_us) {
    const rc_memory *memory = &rc->config.memory;
    rc_turn turn = rc_next_turn(&memory->schedule, memory->identity.robot, rc->salt, fleet_us);
    uint32_t index = turn.round * RC_PHASES + turn.phase;
    uint64_t start_us = turn.start_us + rc_noise(~rc->salt, index) % RC_APART_US;
    turn.start_us = start_us < turn.latest_us ? start_us : turn.latest_us;
    return turn;
}

static size_t take_in_turn(rc_radio *rc, uint64_t now_us, uint8_t *kind, uint8_t *body) {
    uint64_t fleet_us = rc_fleet_time_at(&rc->time, now_us);
    rc_turn turn = rc_own_turn(rc, fleet_us);
    uint64_t name = (uint64_t)turn.round * RC_PHASES + turn.phase + 1;
    if (fleet_us < turn.start_us || turn.round != rc->round || name == rc->turn_used)
        return 0;
    size_t n = take_for_turn(rc, now_us, turn.phase, kind, body);
    if (n > 0)
        rc->turn_used = name;
    return n;
}

static size_t take_body(rc_radio *rc, uint64_t now_us, uint8_t *kind, uint8_t *body) {
    size_t n = take_stop(rc, now_us, kind, body);
    if (n > 0)
        return n;
    if (!rc_is_robot(rc)) /* an operator has no slot */
        return take_tasks(rc, now_us, kind, body);
    if (rc->passive || now_us < rc->listen_until_us)
        return 0;
    return take_in_turn(rc, now_us, kind, body);
}

size_t rc_air_tx(rc_radio *rc, uint64_t now_us, uint8_t *out) {
    if (rc->flight.up || !rc_may_send(rc))
        return 0;
    if (rc->sequence == RC_MAX_SEQUENCE) {
        begin_next_boot(rc);
        return 0;
    }
    uint8_t kind = 0;
    size_t n = take_body(rc, now_us, &kind, out + RC_HEADER_BYTES);
    return n > 0 ? finish(rc, now_us, kind, out, n) : 0;
}

/* A call after the timeout finds nothing in flight, or is taken for the next frame: at worst two overlap. */
void rc_air_done(rc_radio *rc, uint64_t now_us, bool ok) {
    if (!rc->flight.up)
        return;
    rc->flight.up = false;
    if (ok)
        rc->counters.sent++;
    else
        rc->counters.send_failed++;
    uint8_t frame[RC_LINK_MAX_ENCODED];
    rc_tell_host(rc, frame, rc_sent_encode(now_us, rc->flight.kind, rc->flight.sequence, ok, frame + 1));
}
