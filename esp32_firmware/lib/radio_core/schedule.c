#include "schedule.h"

#include "frame.h"

static uint32_t round_us(const rc_schedule *schedule) {
    return schedule->round_ms * 1000u;
}

bool rc_schedule_valid(const rc_schedule *schedule) {
    return schedule->round_ms >= RC_ROUND_MIN_MS && schedule->round_ms <= RC_ROUND_MAX_MS &&
           schedule->slots >= 1 && schedule->slots <= RC_MAX_ROBOTS &&
           rc_observed_us(schedule) <= round_us(schedule);
}

uint32_t rc_slot_us(const rc_schedule *schedule) {
    uint32_t share_us = round_us(schedule) / ((RC_PHASES + 1) * (uint32_t)schedule->slots);
    if (share_us < RC_SLOT_MIN_US)
        return RC_SLOT_MIN_US;
    return share_us < RC_SLOT_MAX_US ? share_us : RC_SLOT_MAX_US;
}

uint32_t rc_observed_us(const rc_schedule *schedule) {
    return RC_PHASES * schedule->slots * rc_slot_us(schedule);
}

uint32_t rc_round_of(const rc_schedule *schedule, uint64_t fleet_us) {
    return (uint32_t)(fleet_us / round_us(schedule));
}

uint64_t rc_round_start_us(const rc_schedule *schedule, uint32_t round) {
    return (uint64_t)round * round_us(schedule);
}

/* The turn number `index`, counted from the begin of fleet time. Radios of the same salt differ by their id.
 */
static rc_turn turn_at(const rc_schedule *schedule, uint8_t robot, uint32_t salt, uint64_t index) {
    uint64_t round = index / RC_PHASES;
    uint32_t phase = (uint32_t)(index % RC_PHASES), slot = robot, late_us = 0;
    if (robot >= schedule->slots) {
        uint32_t noise = rc_noise(rc_noise(salt, robot), (uint32_t)index);
        slot = noise % schedule->slots;
        late_us = (noise >> 16) % (RC_SLOT_LATEST_US + 1);
    }
    uint64_t slot_start_us =
        round * round_us(schedule) + (phase * schedule->slots + slot) * (uint64_t)rc_slot_us(schedule);
    uint64_t start_us = slot_start_us + late_us;
    return (rc_turn){(uint32_t)round, (uint8_t)phase, start_us, start_us + RC_SLOT_LATEST_US};
}

rc_turn rc_next_turn(const rc_schedule *schedule, uint8_t robot, uint32_t salt, uint64_t fleet_us) {
    uint64_t index = fleet_us / round_us(schedule) * RC_PHASES;
    rc_turn turn = turn_at(schedule, robot, salt, index);
    while (turn.latest_us < fleet_us) /* at most three times: a turn lies within its phase and round */
        turn = turn_at(schedule, robot, salt, ++index);
    return turn;
}

static uint32_t mixed(uint32_t x) {
    x = (x ^ x >> 16) * 0x85ebca6bu;
    x = (x ^ x >> 13) * 0xc2b2ae35u;
    return x ^ x >> 16;
}

/* SplitMix (Steele et al. 2014) in 32 bits: the index-th step from a mixed begin, mixed. */
uint32_t rc_noise(uint32_t salt, uint32_t index) {
    return mixed(mixed(salt) + (index + 1) * 0x9e3779b9u);
}
