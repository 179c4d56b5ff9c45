/* Who may send when: rounds of fleet time, three phases each (STATE, RELAY-1, RELAY-2), one slot a robot.
 *
 * A round begins at a multiple of its length. The phases follow each other from its begin; what is left of
 * the round belongs to the hosts, which decide in it on what was observed. Knows no clock and no frame. Ids
 * that have no slot (64 dongles, a roster set too small) take a fresh pseudo-random one each time, never id
 * modulo slots: some pairs would then never hear each other (measured). */
#ifndef RC_SCHEDULE_H
#define RC_SCHEDULE_H

#include <stdbool.h>
#include <stdint.h>

/* cdef: begin */
enum {
    RC_PHASES = 3,
    RC_SLOT_MIN_US = 1040, /* the longest frame at 6 Mbit/s, back-off and 0.3 ms of disagreement either way */
    RC_SLOT_MAX_US = 2080,
    RC_SLOT_LATEST_US = 500, /* a frame may start this long after its slot did */
    RC_ROUND_MIN_MS = 50,
    RC_ROUND_MAX_MS = 1000
};

/* The hosts' configuration: all robots of a fleet have the same (it is in the fleet digest). */
typedef struct {
    uint16_t round_ms;
    uint8_t slots; /* roster size: ids 0 .. slots - 1 have a slot of their own */
} rc_schedule;

typedef struct {
    uint32_t round;
    uint8_t phase;
    uint64_t start_us, latest_us; /* fleet time, both inclusive; latest = start + RC_SLOT_LATEST_US */
} rc_turn;

bool rc_schedule_valid(const rc_schedule *schedule);
/* Of a valid schedule, as all below. A quarter of the round is kept for the hosts where the slots allow it.
 */
uint32_t rc_slot_us(const rc_schedule *schedule);
/* From the begin of a round to the end of its last slot. */
uint32_t rc_observed_us(const rc_schedule *schedule);
uint32_t rc_round_of(const rc_schedule *schedule, uint64_t fleet_us);
uint64_t rc_round_start_us(const rc_schedule *schedule, uint32_t round);
/* The first turn of `robot` with latest_us >= fleet_us. salt: of this radio, for ids without a slot; theirs
 * begins up to RC_SLOT_LATEST_US after the slot that it fell into, and lies within that slot. */
rc_turn rc_next_turn(const rc_schedule *schedule, uint8_t robot, uint32_t salt, uint64_t fleet_us);
/* Deterministic noise: splitmix32 of both. */
uint32_t rc_noise(uint32_t salt, uint32_t index);
/* cdef: end */

#endif
