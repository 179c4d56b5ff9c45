#include "fleet_time.h"

enum {
    PREAMBLE_US = 20,
    SYMBOL_US = 4,
    EXTENSION_US = 6,    /* OFDM at 2.4 GHz */
    OVERHEAD_BYTES = 43, /* 24 MAC, 15 vendor action frame, 4 FCS */
    SERVICE_TAIL_BITS = 22,
    QUIET_ROUNDS = 10, /* so many without a sample: alone */
    STEADY_ROUNDS = 3, /* so many since a jump: settled */
    SLOWEST = 1000     /* time goes back by at most the round over this */
};

static const uint64_t STAMP_LIMIT_US = (uint64_t)1 << 48;
static const uint64_t JUMP_LIMIT_US = (uint64_t)1 << 47;

uint32_t rc_airtime_us(size_t n, uint8_t rate_mbps) {
    uint32_t bits = SERVICE_TAIL_BITS + 8 * (OVERHEAD_BYTES + (uint32_t)n);
    uint32_t symbol_bits = SYMBOL_US * (uint32_t)rate_mbps;
    return PREAMBLE_US + SYMBOL_US * ((bits + symbol_bits - 1) / symbol_bits) + EXTENSION_US;
}

void rc_fleet_time_init(rc_fleet_time *time, uint64_t own_us) {
    *time = (rc_fleet_time){.base_own_us = own_us, .base_fleet_us = own_us, .quiet_rounds = QUIET_ROUNDS};
}

static uint64_t since_base(const rc_fleet_time *time, uint64_t own_us) {
    return own_us > time->base_own_us ? own_us - time->base_own_us : 0;
}

/* What the fleet's clock shows at the end of the span; never 0 unless there is no span. */
static uint64_t slewed_span(const rc_fleet_time *time) {
    return (uint64_t)((int64_t)time->slew_span_us + time->slew_us);
}

uint64_t rc_fleet_time_at(const rc_fleet_time *time, uint64_t own_us) {
    uint64_t own = since_base(time, own_us), span = time->slew_span_us;
    if (own >= span)
        return time->base_fleet_us + (own - span) + slewed_span(time);
    return time->base_fleet_us + own * slewed_span(time) / span;
}

uint64_t rc_fleet_time_when(const rc_fleet_time *time, uint64_t fleet_us) {
    if (fleet_us <= time->base_fleet_us)
        return time->base_own_us;
    uint64_t fleet = fleet_us - time->base_fleet_us, slewed = slewed_span(time);
    if (fleet >= slewed)
        return time->base_own_us + time->slew_span_us + (fleet - slewed);
    return time->base_own_us + (fleet * time->slew_span_us + slewed - 1) / slewed;
}

/* Fleet time as if all of the slew were through. */
static int64_t settled_us(const rc_fleet_time *time, uint64_t own_us) {
    return (int64_t)(time->base_fleet_us + since_base(time, own_us)) + time->slew_us;
}

static void begin_span(rc_fleet_time *time, uint64_t own_us, uint64_t fleet_us, int32_t slew_us,
                       uint32_t span_us) {
    time->base_own_us = own_us;
    time->base_fleet_us = fleet_us;
    time->slew_us = slew_us;
    time->slew_span_us = span_us;
}

static void forget_samples(rc_fleet_time *time) {
    time->count = 0;
    time->next = 0;
}

static rc_time_verdict jump(rc_fleet_time *time, uint64_t own_us, uint64_t fleet_us) {
    if (fleet_us >= JUMP_LIMIT_US)
        return RC_TIME_IGNORED;
    begin_span(time, own_us, fleet_us, 0, 0);
    forget_samples(time); /* of the clock before */
    time->steady_rounds = 0;
    time->jumps++;
    return RC_TIME_JUMPED;
}

rc_time_verdict rc_fleet_time_heard(rc_fleet_time *time, uint64_t own_us, uint64_t stamp_us,
                                    uint32_t way_us) {
    if (stamp_us >= STAMP_LIMIT_US)
        return RC_TIME_IGNORED;
    uint64_t theirs_us = stamp_us + way_us;
    /* A slew under way is not to be ordered twice. */
    int64_t ahead_us = (int64_t)theirs_us - settled_us(time, own_us);
    if (ahead_us > RC_JUMP_US)
        return jump(time, own_us, theirs_us);
    if (ahead_us < -RC_JUMP_US)
        return RC_TIME_IGNORED;
    time->samples[time->next] = (int16_t)ahead_us;
    time->next = (uint16_t)((time->next + 1) % RC_TIME_SAMPLES);
    if (time->count < RC_TIME_SAMPLES)
        time->count++;
    return RC_TIME_SAMPLED;
}

/* Of the samples and one 0, our own clock. Of two in the middle their mean, rounded towards 0. */
static int32_t median_us(const rc_fleet_time *time) {
    int16_t sorted[RC_TIME_SAMPLES + 1] = {0};
    size_t count = 1;
    for (; count <= time->count; count++) {
        size_t at = count;
        for (; at > 0 && sorted[at - 1] > time->samples[count - 1]; at--)
            sorted[at] = sorted[at - 1];
        sorted[at] = time->samples[count - 1];
    }
    return (sorted[(count - 1) / 2] + sorted[count / 2]) / 2;
}

static int32_t clip(int64_t value, int32_t least, int32_t most) {
    return (int32_t)(value < least ? least : value > most ? most : value);
}

static uint32_t one_more(uint32_t count) {
    return count < UINT32_MAX ? count + 1 : count;
}

void rc_fleet_time_end_round(rc_fleet_time *time, uint64_t own_us, uint32_t round_us) {
    uint64_t fleet_us = rc_fleet_time_at(time, own_us);
    int64_t slew_us = settled_us(time, own_us) - (int64_t)fleet_us; /* what is left of the last */
    time->quiet_rounds = one_more(time->quiet_rounds);
    time->steady_rounds = one_more(time->steady_rounds);
    if (time->count > 0) {
        time->median_us = median_us(time);
        time->quiet_rounds = 0;
        slew_us += time->median_us / 2;
    }
    int32_t back_us = clip(round_us / SLOWEST, 0, RC_MAX_SLEW_US);
    uint32_t span_us = (uint32_t)clip(round_us, 0, INT32_MAX); /* its square is below 2^64 */
    begin_span(time, own_us, fleet_us, clip(slew_us, -back_us, RC_MAX_SLEW_US), span_us);
    forget_samples(time);
}

bool rc_fleet_time_agreed(const rc_fleet_time *time) {
    return time->quiet_rounds < QUIET_ROUNDS && time->steady_rounds >= STEADY_ROUNDS &&
           time->median_us >= -RC_AGREED_US && time->median_us <= RC_AGREED_US;
}
