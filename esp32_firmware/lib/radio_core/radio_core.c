/* Start, memory, time and status of a radio; radio_host.c, radio_hear.c and radio_send.c have its sides. */
#include "radio_core.h"

#include <string.h>

#include "radio_parts.h"

enum { EMPTY_ROUND_MS = 100, EMPTY_SLOTS = 5, EMPTY_RATE_MBPS = 6 };

size_t rc_size(void) {
    return sizeof(rc_radio);
}

void rc_memory_init(rc_memory *memory) {
    *memory = (rc_memory){
        .identity = {.robot = RC_NO_ROBOT, .fleet = 1, .channel = 1},
        .schedule = {.round_ms = EMPTY_ROUND_MS, .slots = EMPTY_SLOTS},
        .rate_mbps = EMPTY_RATE_MBPS,
    };
}

static void repair(rc_memory *memory) {
    rc_memory empty;
    rc_memory_init(&empty);
    if (!rc_identity_valid(&memory->identity))
        memory->identity = empty.identity;
    if (!rc_schedule_valid(&memory->schedule))
        memory->schedule = empty.schedule;
    if (!rc_rate_valid(memory->rate_mbps))
        memory->rate_mbps = empty.rate_mbps;
    memory->keyed = memory->keyed != 0;
    memory->provisioned = memory->provisioned != 0;
    if (memory->stop_resumed > memory->stop_counter)
        memory->stop_counter = memory->stop_resumed;
}

static uint32_t salt_of(const rc_about *about) {
    uint32_t salt = about->boot_id;
    for (size_t i = 0; i < RC_MAC_BYTES; i++)
        salt = rc_noise(salt, about->mac[i]);
    return salt;
}

static void recall_peers(rc_radio *rc) {
    const rc_memory *memory = &rc->config.memory;
    for (size_t i = 0; i < RC_MAX_ROBOTS; i++)
        rc->peers[i].boot = memory->peer_boots[i];
    for (size_t i = 0; i < RC_OPERATORS; i++) {
        rc->operators[i].boot = memory->operators[i].boot;
        memcpy(rc->operators[i].mac, memory->operators[i].mac, RC_MAC_BYTES);
    }
}

void rc_init(rc_radio *rc, uint64_t now_us, const rc_config *config) {
    memset(rc, 0, sizeof *rc);
    rc->config = *config;
    repair(&rc->config.memory);
    const rc_memory *memory = &rc->config.memory;
    rc->salt = salt_of(&config->about);
    rc->boot_ready = config->boot_kept || !memory->keyed;
    rc->sequence = config->sequence & RC_MAX_SEQUENCE;
    rc->next_status_us = now_us;
    rc->listen_until_us = now_us + RC_LISTEN_ROUNDS * (uint64_t)rc_round_us(rc);
    rc->tuned = memory->identity.channel;
    rc_stop_init(&rc->stop, rc->salt, memory->stop_counter, memory->stop_resumed);
    recall_peers(rc);
    rc_fleet_time_init(&rc->time, now_us);
    rc_relay_init(&rc->relay, memory->identity.robot);
}

/* ---- what outlives a reboot --------------------------------------------------------------------------- */

const rc_memory *rc_memory_of(const rc_radio *rc) {
    return &rc->config.memory;
}

unsigned rc_dirty(const rc_radio *rc) {
    return rc->dirty;
}

static void answer_provisioning(rc_radio *rc) {
    uint8_t frame[RC_LINK_MAX_ENCODED];
    rc_tell_host(rc, frame,
                 rc_provisioned_encode(!rc->keep_failed, rc->config.memory.boot_counter, frame + 1));
    rc->provisioning = false;
    rc->restart = true;
}

void rc_kept(rc_radio *rc, unsigned parts, bool ok) {
    rc->dirty &= ~parts;
    if (rc->provisioning) {
        rc->keep_failed = rc->keep_failed || !ok;
        if (rc->dirty == 0)
            answer_provisioning(rc);
        return;
    }
    if (!ok) /* tried again with the next status; who has no identity stored is asked for it again by its host
              */
        rc->unkept |= parts & ~(unsigned)RC_KEEP_IDENTITY;
    if (parts & RC_KEEP_BOOT)
        rc->boot_ready = ok || !rc->config.memory.keyed;
}

bool rc_wants_restart(const rc_radio *rc) {
    return rc->restart && rc->to_host.used == 0;
}

void rc_channel_is(rc_radio *rc, uint8_t channel) {
    rc->tuned = channel;
}

/* ---- STOP --------------------------------------------------------------------------------------------- */

void rc_note_stop(rc_radio *rc, uint64_t now_us) {
    if (!rc->stop.changed)
        return;
    rc->stop.changed = false;
    rc->config.memory.stop_counter = rc->stop.counter;
    rc->config.memory.stop_resumed = rc->stop.resumed;
    rc->dirty |= RC_KEEP_STOP;
    rc_tell_status(rc, now_us);
}

void rc_button(rc_radio *rc, uint64_t now_us) {
    rc_stop_raise(&rc->stop, now_us, rc->config.memory.identity.robot, RC_STOP_BY_BUTTON);
    rc_note_stop(rc, now_us);
}

/* ---- status ------------------------------------------------------------------------------------------- */

rc_identity rc_identity_in_use(const rc_radio *rc) {
    rc_identity identity = rc->config.memory.identity;
    identity.channel = rc->tuned;
    return identity;
}

uint64_t rc_alive(const rc_radio *rc, uint64_t now_us) {
    uint64_t alive = 0;
    for (size_t i = 0; i < RC_MAX_ROBOTS; i++)
        alive |= (uint64_t)rc_peer_alive(&rc->peers[i], now_us) << i;
    return alive;
}

static uint16_t flags_of(const rc_radio *rc) {
    const rc_memory *memory = &rc->config.memory;
    unsigned flags = memory->keyed ? 0 : RC_FLAG_OPEN;
    flags |= rc_fleet_time_agreed(&rc->time) ? RC_FLAG_AGREED : 0;
    flags |= rc->passive ? RC_FLAG_PASSIVE : 0;
    flags |= rc_stop_latched(&rc->stop) ? RC_FLAG_STOPPED : 0;
    flags |= rc->boot_ready ? 0 : RC_FLAG_UNSAFE;
    flags |= memory->provisioned || rc_is_robot(rc) ? RC_FLAG_PROVISIONED : 0;
    return (uint16_t)flags;
}

rc_condition rc_condition_of(const rc_radio *rc, uint64_t now_us) {
    rc_condition condition = {
        .uptime_us = now_us,
        .fleet_time_us = rc_fleet_time_at(&rc->time, now_us),
        .flags = flags_of(rc),
        .stop_counter = rc->stop.counter,
        .stop_resumed = rc->stop.resumed,
        .alive = rc_alive(rc, now_us),
    };
    for (size_t i = 0; i < RC_MAX_ROBOTS; i++) {
        const rc_peer *peer = &rc->peers[i];
        condition.rebooted |= (uint64_t)peer->rebooted << i;
        condition.babbling |= (uint64_t)(peer->babbling && rc_peer_alive(peer, now_us)) << i;
        condition.duplicate |= (uint64_t)peer->duplicate << i;
    }
    if (rc->passive && rc_is_robot(rc))
        condition.duplicate |= (uint64_t)1 << rc->config.memory.identity.robot;
    return condition;
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

void rc_tell_status(rc_radio *rc, uint64_t now_us) {
    const rc_memory *memory = &rc->config.memory;
    uint8_t frame[RC_LINK_MAX_ENCODED];
    rc_condition condition = rc_condition_of(rc, now_us);
    rc_identity identity = rc_identity_in_use(rc);
    size_t n = rc_status_encode(&rc->config.about, memory->boot_counter, &identity, &memory->schedule,
                                memory->rate_mbps, &condition, &rc->counters, frame + 1);
    if (!rc_tell_host(rc, frame, n))
        return;
    for (size_t i = 0; i < RC_MAX_ROBOTS; i++)
        rc->peers[i].rebooted = false;
}

/* ---- time --------------------------------------------------------------------------------------------- */

static void tell_round(rc_radio *rc, uint64_t now_us) {
    uint8_t frame[RC_LINK_MAX_ENCODED];
    uint64_t fleet_us = rc_fleet_time_at(&rc->time, now_us);
    size_t n = rc_round_encode(rc->round, fleet_us, now_us, rc->relay.held, rc_fleet_time_agreed(&rc->time),
                               frame + 1);
    rc_tell_host(rc, frame, n);
    rc->round_told = true;
}

void rc_follow_rounds(rc_radio *rc, uint64_t now_us) {
    const rc_schedule *schedule = &rc->config.memory.schedule;
    uint64_t fleet_us = rc_fleet_time_at(&rc->time, now_us);
    uint32_t round = rc_round_of(schedule, fleet_us);
    if (round != rc->round) {
        if (!rc->round_told && round == rc->round + 1)
            tell_round(rc, now_us);
        rc_fleet_time_end_round(&rc->time, now_us, rc_round_us(rc));
        rc->round = round;
        rc->round_told = false;
        rc_relay_begin(&rc->relay, round);
    }
    if (!rc->round_told && fleet_us >= rc_round_start_us(schedule, round) + rc_observed_us(schedule))
        tell_round(rc, now_us);
}

void rc_tick(rc_radio *rc, uint64_t now_us) {
    if (rc->flight.up && now_us >= rc->flight.since_us + RC_IN_FLIGHT_TIMEOUT_US)
        rc_air_done(rc, now_us, false);
    rc_follow_rounds(rc, now_us);
    if (now_us >= rc->next_status_us) {
        rc_tell_status(rc, now_us);
        rc->dirty |= rc->unkept;
        rc->unkept = 0;
        rc->next_status_us = now_us + RC_STATUS_PERIOD_US - now_us % RC_STATUS_PERIOD_US;
    }
}

static uint64_t earlier(uint64_t a, uint64_t b) {
    return a < b ? a : b;
}

/* In fleet time: the round observed, the next one, and our next turn to send. */
static uint64_t next_fleet_us(const rc_radio *rc, uint64_t fleet_us) {
    const rc_memory *memory = &rc->config.memory;
    uint64_t start_us = rc_round_start_us(&memory->schedule, rc->round);
    uint64_t next_us = start_us + rc_round_us(rc);
    if (!rc->round_told)
        next_us = earlier(next_us, start_us + rc_observed_us(&memory->schedule));
    if (!rc_is_robot(rc) || rc->passive)
        return next_us;
    rc_turn turn = rc_own_turn(rc, fleet_us);
    if (turn.start_us <= fleet_us) /* open now: whatever comes in meanwhile is a call of its own */
        turn = rc_own_turn(rc, turn.latest_us + 1);
    return earlier(next_us, turn.start_us);
}

uint64_t rc_next_us(const rc_radio *rc, uint64_t now_us) {
    uint64_t fleet_us = rc_fleet_time_at(&rc->time, now_us);
    uint64_t next_us = rc_fleet_time_when(&rc->time, next_fleet_us(rc, fleet_us));
    next_us = earlier(next_us, rc->next_status_us);
    if (rc->flight.up)
        next_us = earlier(next_us, rc->flight.since_us + RC_IN_FLIGHT_TIMEOUT_US);
    else if (rc_may_send(rc))
        next_us = earlier(next_us, rc_stop_due_us(&rc->stop));
    return next_us > now_us ? next_us : now_us;
}
