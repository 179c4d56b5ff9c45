/* Rows are handled as bytes, as RELAY carries them. The bodies given are valid: nothing is checked twice. */
#include "relay_table.h"

#include "bytes.h"
#include "relay_row.h"

enum { RELAY_M_AT = 0, RELAY_N_AT = 1, RELAY_HELD_AT = 2 };
enum { ROW_ROBOT_AT = 0, ROW_AGE_AT = 1 };
enum { CERTAIN = 255 };
/* Losses are means over about 32 rounds; that of another's link is looked at in one round of four. */
enum { OUR_SHIFT = 5, LINK_SHIFT = 3, LINK_PARTS = 4 };
enum { BLOCK = 16 }; /* robots at a time, for compilers that have vectors; miss is 0 behind n */

_Static_assert(RC_MAX_ROBOTS % BLOCK == 0, "whole blocks");

static uint64_t bit(unsigned k) {
    return (uint64_t)1 << k;
}

static bool has(uint64_t bits, unsigned k) {
    return bits >> k & 1;
}

static uint64_t below(unsigned k) {
    return k < RC_MAX_ROBOTS ? bit(k) - 1 : UINT64_MAX;
}

/* ---- what is known of the robots ---------------------------------------------------------------------- */

static bool is_live(const rc_relay_table *table, unsigned i) {
    return has(table->seen, i) && table->round - table->seen_round[i] < RC_LIVE_ROUNDS;
}

static void see(rc_relay_table *table, unsigned i) {
    table->seen |= bit(i);
    table->seen_round[i] = table->round;
}

/* An exponential mean. It comes as close to 0 and to 1 as 1/255 can show. */
static void sample(uint16_t *loss, bool heard, unsigned shift) {
    unsigned now = *loss;
    *loss = (uint16_t)(now - (now >> shift) + (heard ? 0 : UINT16_MAX >> shift));
}

static uint8_t in_255(uint16_t loss) {
    return (uint8_t)(loss >> 8);
}

/* Who is no mate any more lacks nothing. */
static void dismiss(rc_relay_table *table, unsigned i) {
    if (!has(table->mates, i))
        return;
    table->mates &= ~bit(i);
    for (unsigned k = 0; k < table->n; k++)
        table->miss[k][i] = 0;
}

/* All that is known of what it lacks is the loss of its links. */
static void expect_losses(rc_relay_table *table, unsigned i) {
    table->mates |= bit(i);
    const unsigned n = table->n;
    for (unsigned k = 0; k < n; k++)
        table->miss[k][i] = k == i ? 0 : in_255(table->loss[k][i]);
}

/* ---- rows --------------------------------------------------------------------------------------------- */

/* Rounds down, so it reaches 0. */
static void scale_block(uint8_t *restrict miss, const uint16_t *restrict loss) {
    for (unsigned i = 0; i < BLOCK; i++)
        miss[i] = (uint8_t)((uint32_t)miss[i] * loss[i] >> 16);
}

/* Row k went on the air from s: who lacked it has missed this one too. */
static void count_as_sent(rc_relay_table *table, unsigned k, unsigned s) {
    const unsigned n = table->n;
    for (unsigned i = 0; i < n; i += BLOCK)
        scale_block(table->miss[k] + i, table->loss[s] + i);
}

static size_t row_bytes(const rc_relay_table *table) {
    return (size_t)RC_RELAY_ROW_BYTES + table->m;
}

/* The first row of a round that is held stays. */
static void hold_state(rc_relay_table *table, unsigned robot, const uint8_t *state) {
    if (has(table->held, robot))
        return;
    table->held |= bit(robot);
    rc_relay_row_put(table->rows[robot], (uint8_t)robot, state);
}

/* ---- rounds ------------------------------------------------------------------------------------------- */

void rc_relay_init(rc_relay_table *table, uint8_t self) {
    memset(table, 0, sizeof *table);
    table->self = self;
    for (unsigned k = 0; k < RC_MAX_ROBOTS; k++) {
        table->loss_to_us[k] = RC_LOSS_START << 8;
        for (unsigned i = 0; i < RC_MAX_ROBOTS; i++)
            table->loss[k][i] = RC_LOSS_START << 8;
    }
}

static void end_round(rc_relay_table *table) {
    for (unsigned k = 0; k < RC_MAX_ROBOTS; k++)
        if (k != table->self && is_live(table, k))
            sample(&table->loss_to_us[k], has(table->direct, k), OUR_SHIFT);
}

void rc_relay_begin(rc_relay_table *table, uint32_t round) {
    end_round(table);
    bool follows = round == table->round + 1;
    table->held_before = follows ? table->held : 0;
    table->direct_before = follows ? table->direct : 0;
    table->held = 0;
    table->direct = 0;
    table->round = round;
    for (unsigned i = 0; i < table->n; i++) {
        if (!is_live(table, i))
            dismiss(table, i);
        else if (has(table->mates, i))
            expect_losses(table, i);
    }
}

static bool agrees(const rc_relay_table *table, const uint8_t *state, size_t n) {
    return rc_state_n(state) == table->n && rc_state_m(state) == table->m &&
           rc_state_fleet_digest(state, n) == table->fleet_digest;
}

void rc_relay_own(rc_relay_table *table, uint32_t round, const uint8_t *body, size_t n) {
    if (round != table->round)
        return;
    if (!agrees(table, body, n)) {
        for (unsigned i = 0; i < table->n; i++)
            dismiss(table, i);
        table->n = rc_state_n(body);
        table->m = rc_state_m(body);
        table->fleet_digest = rc_state_fleet_digest(body, n);
        table->held = 0;
        table->held_before = 0;
    }
    if (table->self >= table->n)
        return;
    see(table, table->self);
    hold_state(table, table->self, body);
}

/* ---- what is heard ------------------------------------------------------------------------------------ */

/* The first n robots: bit clear -> miss of robot i is certain, bit set -> it is 0. */
static void learn_rows(rc_relay_table *table, unsigned i, uint64_t bits, unsigned n) {
    for (unsigned k = 0; k < n; k++, bits >>= 1)
        table->miss[k][i] = bits & 1 ? 0 : CERTAIN;
}

/* A bit that is not set says something of the link only where the row is known to have been sent. A part of
 * the links each time, as that is the dearest part of hearing a STATE. */
static void learn_links(rc_relay_table *table, unsigned sender, uint64_t heard) {
    uint64_t sent = (table->held & below(sender)) | (table->held_before & ~below(sender));
    for (unsigned k = table->round % LINK_PARTS; k < table->n; k += LINK_PARTS)
        if (k != sender && has(sent, k))
            sample(&table->loss[k][sender], has(heard, k), LINK_SHIFT);
}

/* This row goes out late, behind bitmaps that could not show it: nobody lacks it more than the link loses. */
static void learn_late(rc_relay_table *table, unsigned sender) {
    for (unsigned i = 0; i < table->n; i++) {
        uint8_t loss = in_255(table->loss[sender][i]);
        if (table->miss[sender][i] > loss)
            table->miss[sender][i] = loss;
    }
}

void rc_relay_heard_state(rc_relay_table *table, uint32_t round, uint8_t sender, const uint8_t *body,
                          size_t n) {
    if (round != table->round || sender >= RC_MAX_ROBOTS || sender == table->self ||
        has(table->direct, sender))
        return;
    table->direct |= bit(sender);
    see(table, sender);
    if (sender >= table->n || !agrees(table, body, n)) {
        dismiss(table, sender);
        return;
    }
    if (!has(table->mates, sender))
        expect_losses(table, sender);
    uint64_t heard = rc_state_heard(body);
    learn_links(table, sender, heard);
    learn_rows(table, sender, heard, sender);
    if (table->direct & ~below(sender + 1u))
        learn_late(table, sender);
    hold_state(table, sender, body);
}

void rc_relay_heard_relay(rc_relay_table *table, uint32_t round, uint8_t sender, const uint8_t *body,
                          size_t n) {
    if (round != table->round || sender >= table->n || !has(table->mates, sender) ||
        body[RELAY_M_AT] != table->m || body[RELAY_N_AT] != table->n)
        return;
    const uint8_t *at = body + RELAY_HELD_AT;
    learn_rows(table, sender, rc_take_bits(&at, table->n) | bit(sender), table->n);
    for (; at < body + n; at += row_bytes(table)) {
        unsigned robot = at[ROW_ROBOT_AT];
        if (at[ROW_AGE_AT] != 0)
            continue;
        count_as_sent(table, robot, sender);
        if (robot == table->self || has(table->held, robot))
            continue;
        table->held |= bit(robot);
        rc_put_bytes(table->rows[robot], at, row_bytes(table));
    }
}

uint64_t rc_relay_heard_bits(const rc_relay_table *table) {
    uint64_t this_round = below(table->self);
    return (table->direct & this_round) | (table->direct_before & ~this_round);
}

uint8_t rc_relay_loss_to_us(const rc_relay_table *table, uint8_t k) {
    return k < RC_MAX_ROBOTS ? in_255(table->loss_to_us[k]) : 0;
}

/* ---- what is passed on -------------------------------------------------------------------------------- */

/* 0: nobody needs the row, or we do not hold it. */
static uint32_t need_of(const rc_relay_table *table, unsigned k) {
    if (!has(table->held, k))
        return 0;
    uint32_t sum = 0, squares = 0;
    for (unsigned i = 0; i < table->n; i++) {
        uint32_t miss = table->miss[k][i];
        sum += miss;
        squares += miss * miss;
    }
    return sum < RC_NEED_MIN ? 0 : squares;
}

/* Ties: cyclic from our own id, so that not all pass on the same. */
static unsigned neediest(const rc_relay_table *table, const uint32_t *needs) {
    unsigned best = table->self;
    for (unsigned k = best + 1; k < table->n; k++)
        if (needs[k] > needs[best])
            best = k;
    for (unsigned k = 0; k < table->self; k++)
        if (needs[k] > needs[best])
            best = k;
    return best;
}

/* The rows behind `at` in `room` bytes; where they end. */
static uint8_t *put_rows(rc_relay_table *table, uint8_t *at, size_t room) {
    uint32_t needs[RC_MAX_ROBOTS];
    for (unsigned k = 0; k < table->n; k++)
        needs[k] = need_of(table, k);
    for (; room >= row_bytes(table); room -= row_bytes(table)) {
        unsigned k = neediest(table, needs);
        if (needs[k] == 0)
            break;
        needs[k] = 0;
        count_as_sent(table, k, table->self);
        at = rc_put_bytes(at, table->rows[k], row_bytes(table));
    }
    return at;
}

size_t rc_relay_fill(rc_relay_table *table, uint8_t *body) {
    if (table->self >= table->n || !is_live(table, table->self))
        return 0;
    uint8_t *rows = rc_put8(body, table->m);
    rows = rc_put8(rows, table->n);
    rows = rc_put(rows, table->held, (table->n + 7u) / 8);
    uint8_t *end = put_rows(table, rows, RC_MAX_BODY - (size_t)(rows - body));
    return end == rows ? 0 : (size_t)(end - body);
}
