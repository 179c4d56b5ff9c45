/* Rows of a round, who may lack which, and which five to pass on (rows by need; facts: two phases of it complete
 * the snapshot of 30 robots at 30 % loss).
 *
 * miss[i][k]: probability that robot i lacks row k of this round, in 1/255; starts at the loss of the link k -> i as
 * the bitmaps of i show it, becomes 0 or 1 by a bitmap of i, and is multiplied by the loss of the link s -> i when s
 * passes row k on. Rows of another fleet digest than ours, or another N or M, are not kept. Knows no clock and no
 * slot: rounds are numbers. */
#ifndef RC_RELAY_TABLE_H
#define RC_RELAY_TABLE_H

#include "frame.h"

/* cdef: begin */
enum {
    RC_NEED_MIN = 5,     /* 0.02 in 1/255: a smaller column sum is nobody's need */
    RC_LOSS_START = 77,  /* 0.3 in 1/255: an unknown link */
    RC_LIVE_ROUNDS = 30  /* a robot unheard for so long needs nothing */
};

typedef struct {
    uint8_t self; /* RC_OPERATOR: holds rows, passes none on */
    uint8_t n, m; /* of our own last STATE; 0: none yet, nothing is kept */
    uint32_t fleet_digest;
    uint32_t round;
    uint64_t held;                              /* bit k: row k of `round` is held */
    uint64_t direct, direct_before;             /* heard from its owner, in `round` and in the round before */
    uint32_t seen_round[RC_MAX_ROBOTS];         /* in which robot i was last heard, directly */
    bool seen[RC_MAX_ROBOTS];
    uint8_t loss[RC_MAX_ROBOTS][RC_MAX_ROBOTS]; /* [i][k] of the link k -> i, 1/255 */
    uint8_t miss[RC_MAX_ROBOTS][RC_MAX_ROBOTS]; /* [i][k], 1/255 */
    uint8_t rows[RC_MAX_ROBOTS][RC_RELAY_ROW_BYTES + RC_MAX_TASK_SLOTS]; /* as RELAY carries them, age 0 */
} rc_relay_table;

void rc_relay_init(rc_relay_table *table, uint8_t self);
/* A new round begins: nothing is held. Calls for other rounds than `round` are ignored by all below. */
void rc_relay_begin(rc_relay_table *table, uint32_t round);
/* Our own STATE goes on the air; body: valid, n bytes. N, M and the digest of the fleet are taken from it. */
void rc_relay_own(rc_relay_table *table, uint32_t round, const uint8_t *body, size_t n);
/* Bodies must be valid. round: of the frame's fleet time. phase 0: sent in slot order, so that bits of `heard` below
 * the sender's id are about this round, those above about the last. */
void rc_relay_heard_state(rc_relay_table *table, uint32_t round, uint8_t sender, const uint8_t *body, size_t n);
void rc_relay_heard_relay(rc_relay_table *table, uint32_t round, uint8_t sender, const uint8_t *body, size_t n);
/* What STATE says in `heard` at the moment it is sent: this round for ids below ours, the last for those above. */
uint64_t rc_relay_heard_bits(const rc_relay_table *table);
/* The body of a RELAY with the rows that are needed most, counted as sent; 0: nobody needs any.
 * body holds RC_MAX_BODY. */
size_t rc_relay_fill(rc_relay_table *table, uint8_t *body);
/* Loss of the link from k to us, 1/255, as heard ourselves. */
uint8_t rc_relay_loss_to_us(const rc_relay_table *table, uint8_t k);
/* cdef: end */

#endif
