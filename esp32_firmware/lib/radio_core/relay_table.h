/* Rows of a round, who may lack which, and which five to pass on (rows by need; facts: two phases of it
 * complete the snapshot of 30 robots at 30 % loss).
 *
 * miss[k][i]: probability that robot i lacks row k of this round, in 1/255. It starts at the loss of the link
 * k -> i as the bitmaps of i show it, becomes 0 or 1 by a bitmap of i, and is multiplied by the loss of the
 * link s -> i when s passes row k on. Passed on are the rows with the largest sum of squares over i: who
 * surely lacks a row counts more than several who may (at 50 % loss that leaves a quarter fewer robots
 * incomplete than plain sums). Only robots heard of late whose last STATE had our fleet digest, N and M have
 * rows, lack rows, or pass rows on to us. Knows no clock and no slot: rounds are numbers. */
#ifndef RC_RELAY_TABLE_H
#define RC_RELAY_TABLE_H

#include "frame.h"

/* cdef: begin */
enum {
    RC_NEED_MIN = 5,    /* 0.02 in 1/255: where the column of miss sums to less, nobody needs the row */
    RC_LOSS_START = 77, /* 0.3 in 1/255: an unknown link */
    RC_LIVE_ROUNDS = 30 /* a robot whose STATE was not heard for so long needs nothing */
};

typedef struct {
    uint8_t self; /* RC_OPERATOR: hears, but holds no row and passes none on */
    uint8_t n, m; /* of our own last STATE; 0: none yet, nothing is kept */
    uint32_t fleet_digest;
    uint32_t round;
    uint64_t held, held_before;     /* bit k: row k of `round` is held; of the round before was */
    uint64_t direct, direct_before; /* STATE heard from its owner, in `round` and in the round before */
    uint64_t mates; /* others heard of late that agree in digest, N and M: who may lack rows */
    uint64_t seen;  /* seen_round is set */
    uint32_t seen_round[RC_MAX_ROBOTS];          /* of the last STATE of robot i; our own when it was sent */
    uint16_t loss_to_us[RC_MAX_ROBOTS];          /* [k] of the link k -> us, 1/65536 */
    uint16_t loss[RC_MAX_ROBOTS][RC_MAX_ROBOTS]; /* [k][i] of the link k -> i, 1/65536 */
    uint8_t miss[RC_MAX_ROBOTS][RC_MAX_ROBOTS];  /* [k][i], 1/255; 0 for all but mates */
    uint8_t rows[RC_MAX_ROBOTS][RC_RELAY_ROW_BYTES + RC_MAX_TASK_SLOTS]; /* as RELAY carries them, age 0 */
} rc_relay_table;

void rc_relay_init(rc_relay_table *table, uint8_t self);
/* A new round begins: nothing is held. Calls for other rounds than `round` are ignored by all below. */
void rc_relay_begin(rc_relay_table *table, uint32_t round);
/* Our own STATE goes on the air; body: valid, n bytes. N, M and the digest of the fleet are taken from it. */
void rc_relay_own(rc_relay_table *table, uint32_t round, const uint8_t *body, size_t n);
/* Bodies must be valid. round: of the frame's fleet time. STATEs are sent in slot order, so that bits of
 * `heard` below the sender's id are about this round, those above about the last; one that comes later than
 * that is known by its row, not by the bits. Of two STATEs in a round the first counts. */
void rc_relay_heard_state(rc_relay_table *table, uint32_t round, uint8_t sender, const uint8_t *body,
                          size_t n);
void rc_relay_heard_relay(rc_relay_table *table, uint32_t round, uint8_t sender, const uint8_t *body,
                          size_t n);
/* What STATE says in `heard` at the moment it is sent: this round for ids below ours, the last for those
 * above. */
uint64_t rc_relay_heard_bits(const rc_relay_table *table);
/* The body of a RELAY with the rows that are needed most, counted as sent; 0: nobody needs any, or would
 * believe us (no STATE of ours for RC_LIVE_ROUNDS). body holds RC_MAX_BODY. */
size_t rc_relay_fill(rc_relay_table *table, uint8_t *body);
/* Loss of the link from k to us, 1/255, as heard ourselves: of the STATEs of the rounds in which k was alive.
 */
uint8_t rc_relay_loss_to_us(const rc_relay_table *table, uint8_t k);
/* cdef: end */

#endif
