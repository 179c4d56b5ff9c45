/* What one frame costs the radio core, for `valgrind --tool=callgrind --toggle-collect=measured`.
 *
 * One scenario a run, named by the first argument; a fleet of 30 robots and 30 tasks.
 * tests/firmware/instructions.py runs them all and compares with figures.json. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "radio_core.h"

enum { ROBOTS = 30, TASKS = 30, SELF = 7, ROUND_US = 100000, SLOT_US = 1040 };

static rc_radio radio;
static uint64_t now_us;
static uint8_t frame[RC_MAX_FRAME];
static size_t length;

/* All that is counted happens in here. */
__attribute__((noinline)) void measured(void (*action)(void)) {
    action();
}

static void start(void) {
    rc_config config = {.about = {.boot_id = 1, .mac = {2, 0, 0, 0, 0, SELF}}, .boot_kept = true};
    rc_memory_init(&config.memory);
    config.memory.identity.robot = SELF;
    config.memory.schedule.slots = ROBOTS;
    config.memory.boot_counter = 1;
    rc_init(&radio, 0, &config);
}

static uint8_t cost_of(uint8_t robot, size_t task) {
    return (uint8_t)(1 + (robot * 7 + task * 5) % 255);
}

static size_t state_body(uint8_t robot, uint8_t *body) {
    rc_state state = {
        .n = ROBOTS, .m = TASKS, .fleet_digest = 1, .heard = 0x15555555, .claim.slot = RC_NO_SLOT};
    for (size_t j = 0; j < TASKS; j++)
        state.costs[j] = cost_of(robot, j);
    return rc_state_encode(&state, body);
}

static void header(uint8_t kind, uint8_t sender, uint32_t sequence) {
    rc_header h = {
        .kind = kind, .fleet = 1, .sender = sender, .boot = 1, .sequence = sequence, .fleet_time_us = now_us};
    rc_header_encode(&h, frame);
}

static void drain(void) {
    uint8_t out[4096];
    while (rc_usb_tx(&radio, out, sizeof out) > 0)
        continue;
}

static void host_sends_state(void) {
    uint8_t payload[RC_LINK_MAX_PAYLOAD] = {RC_LINK_SEND, RC_STATE}, framed[RC_LINK_MAX_ENCODED];
    size_t n = state_body(SELF, payload + 2);
    rc_usb_rx(&radio, now_us, framed, rc_cobs_encode(payload, n + 2, framed));
}

static void receive(void) {
    uint8_t mac[RC_MAC_BYTES] = {2, 0, 0, 0, 0, frame[2]};
    rc_air_rx(&radio, now_us, -50, mac, frame, length);
}

static void transmit(void) {
    length = rc_air_tx(&radio, now_us, frame);
}

static void tick(void) {
    rc_tick(&radio, now_us);
}

static void hear_state(uint8_t robot, uint32_t sequence) {
    length = RC_HEADER_BYTES + state_body(robot, frame + RC_HEADER_BYTES);
    header(RC_STATE, robot, sequence);
    receive();
}

/* Some rounds of a fleet that hears two thirds of itself, up to our slot of `phase` in the last of them. */
static void play(uint32_t phase) {
    start();
    for (uint32_t round = 0; round < 20; round++) {
        for (uint8_t robot = 0; robot < ROBOTS; robot++) {
            now_us = round * (uint64_t)ROUND_US + robot * SLOT_US;
            tick();
            if (robot == SELF && (round < 19 || phase > 0))
                host_sends_state(), transmit(), rc_air_done(&radio, now_us, true);
            else if (robot != SELF && (robot + round) % 3 != 0)
                hear_state(robot, round + 1);
            drain();
        }
    }
    now_us = 19 * (uint64_t)ROUND_US + (phase * ROBOTS + SELF) * SLOT_US + 10;
    tick();
    drain();
}

static void receive_relay(void) {
    rc_relay relay = {.n = ROBOTS, .m = TASKS, .count = 5, .held = 0x3fffffff};
    for (uint8_t i = 0; i < relay.count; i++) {
        relay.rows[i] =
            (rc_relay_row){.robot = (uint8_t)(i * 3), .slot = i, .tag = 1, .x_cm = 300, .y_cm = -40};
        for (size_t j = 0; j < TASKS; j++)
            relay.rows[i].costs[j] = cost_of(i, j);
    }
    length = RC_HEADER_BYTES + rc_relay_encode(&relay, frame + RC_HEADER_BYTES);
    header(RC_RELAY, 12, 900);
    measured(receive);
}

int main(int count, char **names) {
    const char *name = count > 1 ? names[1] : "";
    if (strcmp(name, "receive_state") == 0) {
        play(1);
        length = RC_HEADER_BYTES + state_body(20, frame + RC_HEADER_BYTES);
        header(RC_STATE, 20, 900);
        measured(receive);
    } else if (strcmp(name, "receive_relay") == 0) {
        play(1);
        receive_relay();
    } else if (strcmp(name, "receive_foreign") == 0) {
        play(1);
        length = RC_HEADER_BYTES + state_body(20, frame + RC_HEADER_BYTES);
        header(RC_STATE, 20, 900);
        frame[1] = 2;
        measured(receive);
    } else if (strcmp(name, "send_state") == 0) {
        play(0);
        host_sends_state();
        measured(transmit);
    } else if (strcmp(name, "send_relay") == 0) {
        play(1);
        measured(transmit);
    } else if (strcmp(name, "tick") == 0) {
        play(1);
        measured(tick);
    } else {
        fprintf(stderr, "unknown scenario '%s'\n", name);
        return 1;
    }
    printf("%zu %u\n", length, rc_counters_of(&radio).received);
    return 0;
}
