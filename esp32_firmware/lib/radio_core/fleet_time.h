/* A common time without a master: each radio follows the median of what it hears (facts: 0.3 ms agreement).
 *
 * d = sender's stamp + frame's way - own fleet time, as it will be when the present slew is through.
 * d > 1 ms: jump forward. d < -1 ms: ignore. Otherwise once per round slew by half of the median of the d
 * heard in it and 0, spread over the next round, so that time never steps back: forward at most 0.5 ms, back
 * at most a thousandth of the round (ten times what a crystal is off), because a late frame looks like a
 * sender that is behind, and in a fleet of three two of them make a median. A false stamp in the future takes
 * the whole fleet with it: pass authentic frames only where there is a key. No stamp makes it jump to 2^47 us
 * (4.4 years) or beyond, the middle of what a frame can say. Knows no frame: the caller says when one was
 * heard and how long it was. */
#ifndef RC_FLEET_TIME_H
#define RC_FLEET_TIME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* cdef: begin */
enum {
    RC_JUMP_US = 1000,
    RC_MAX_SLEW_US = 500,    /* of a round; back no more than a thousandth of it */
    RC_LISTEN_ROUNDS = 3,    /* after a boot, before the first frame is sent */
    RC_FRAME_DELAY_US = 110, /* channel access and callback, without airtime; mean, see README */
    RC_TIME_SAMPLES = 128,
    RC_AGREED_US = 500
};

typedef struct {
    uint64_t base_own_us, base_fleet_us;
    int32_t slew_us; /* of the time since base_own_us, spread over slew_span_us */
    uint32_t slew_span_us;
    uint16_t count; /* samples of this round; later ones beyond RC_TIME_SAMPLES replace the oldest */
    uint16_t next;
    int16_t samples[RC_TIME_SAMPLES];
    int32_t median_us;      /* of the last round that had samples */
    uint32_t quiet_rounds;  /* since one had */
    uint32_t steady_rounds; /* since the last jump */
    uint32_t jumps;
} rc_fleet_time;

typedef enum { RC_TIME_SAMPLED, RC_TIME_JUMPED, RC_TIME_IGNORED } rc_time_verdict;

/* Airtime of a broadcast of n payload bytes, OFDM at rate_mbps (6, 12, 24). */
uint32_t rc_airtime_us(size_t n, uint8_t rate_mbps);

/* Fleet time begins at own_us, the radio's own clock (monotonic since its boot). */
void rc_fleet_time_init(rc_fleet_time *time, uint64_t own_us);
/* own_us not before the last call's. Never decreases. */
uint64_t rc_fleet_time_at(const rc_fleet_time *time, uint64_t own_us);
/* The own time at which fleet_us is reached, rounded up; own_us of the base if that is past. */
uint64_t rc_fleet_time_when(const rc_fleet_time *time, uint64_t fleet_us);
rc_time_verdict rc_fleet_time_heard(rc_fleet_time *time, uint64_t own_us, uint64_t stamp_us, uint32_t way_us);
/* Once per round. */
void rc_fleet_time_end_round(rc_fleet_time *time, uint64_t own_us, uint32_t round_us);
/* Somebody was heard in the last ten rounds, the median is small and nothing jumped for three rounds. */
bool rc_fleet_time_agreed(const rc_fleet_time *time);
/* cdef: end */

#endif
