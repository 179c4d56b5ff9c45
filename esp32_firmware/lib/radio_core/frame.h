/* The air frames: one layout, byte tables in README.md. Header, then a body whose kind the header names.
 *
 * Strict: a body decodes only if encoding what it said gives the same bytes, and no struct encodes that would
 * not decode. The same rules in Python: host/hippomat_core/wire/codec.py; tests hold both to the same bytes.
 * A changed byte bumps RC_PROTOCOL_VERSION. The part between the cdef marks is also read by the Python
 * binding.
 */
#ifndef RC_FRAME_H
#define RC_FRAME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* cdef: begin */
enum {
    RC_PROTOCOL_VERSION = 2,
    RC_MAX_FRAME = 250, /* ESP-NOW v1 drops or truncates longer ones */
    RC_HEADER_BYTES = 16,
    RC_TAG_BYTES = 8, /* AES-128-CCM: kept free, absent while the fleet is OPEN */
    RC_SEALED = 8,    /* bit of byte 0: the body is encrypted and a tag follows it */
    RC_MAX_BODY = RC_MAX_FRAME - RC_HEADER_BYTES - RC_TAG_BYTES,
    RC_MAX_ROBOTS = 64,
    RC_MAX_SEQUENCE = 0xffffff,
    RC_OPERATOR = 255, /* sender of an operator's radio: TASKS, STOP and RESUME only */
    RC_MAX_TASK_SLOTS = 80,
    RC_NO_SLOT = 255,
    RC_MAX_STATUS = 5,
    RC_ALL_FLAGS = 31,
    RC_MAX_TAG = 3,
    RC_MAX_INTENT_STEPS = 12,
    RC_MAX_MOVE = 26,
    RC_RELAY_ROW_BYTES = 14, /* without the costs */
    RC_MAX_RELAY_ROWS = 14,  /* at M = 1 */
    RC_TASK_ROW_BYTES = 10,
    RC_MAX_TASK_ROWS = 22,
    RC_STATE_FIXED_BYTES = 50,
    RC_STOP_BYTES = 4
};

enum { RC_STATE = 1, RC_RELAY = 2, RC_TASKS = 3, RC_STOP = 4, RC_RESUME = 5 };

typedef struct {
    uint8_t kind;
    uint8_t sealed; /* 0 or 1 */
    uint8_t fleet;
    uint8_t sender; /* robot id, or RC_OPERATOR */
    uint32_t boot;
    uint32_t sequence;      /* 24 bits */
    uint64_t fleet_time_us; /* 48 bits */
} rc_header;

typedef struct {
    uint8_t slot; /* RC_NO_SLOT: no claim, all else 0 */
    uint16_t generation;
    uint8_t cost;
    uint16_t round;
    uint8_t confirmed;
    uint8_t tag;
    int16_t x_cm, y_cm, z_cm;
    uint16_t eta_ds;
} rc_claim;

typedef struct {
    uint8_t status, flags;
    int16_t x_cm, y_cm, z_cm;
    uint8_t yaw_256, speed_2cmps;
    rc_claim claim;
    uint8_t n, m;
    uint8_t costs[RC_MAX_TASK_SLOTS];       /* m */
    uint8_t task_states[RC_MAX_TASK_SLOTS]; /* m, 2 bits each */
    uint16_t intent_ix, intent_iy;
    uint8_t intent_iz;
    uint8_t intent_count;
    uint8_t intent_steps[RC_MAX_INTENT_STEPS]; /* intent_count, 5 bits each */
    uint64_t heard;                            /* n bits */
    uint8_t endorsed[RC_MAX_ROBOTS];           /* n, 2 bits each */
    uint32_t fleet_digest, generations_digest;
    uint16_t stop_counter;
} rc_state;

typedef struct {
    uint8_t robot, age, status, slot; /* age: in rounds, against the round of the frame's fleet time */
    uint16_t generation;
    uint8_t cost, confirmed, tag, localized, stopped;
    int16_t x_cm, y_cm, z_cm;
    uint8_t eta_s;
    uint8_t costs[RC_MAX_TASK_SLOTS]; /* m */
} rc_relay_row;

typedef struct {
    uint8_t n, m, count;
    uint64_t held; /* n bits: rows of this round that the sender holds, its own included */
    rc_relay_row rows[RC_MAX_RELAY_ROWS];
} rc_relay;

typedef struct {
    uint8_t slot;
    uint16_t generation;
    uint8_t state;
    int16_t x_cm, y_cm, z_cm;
} rc_task;

typedef struct {
    uint8_t count;
    rc_task slots[RC_MAX_TASK_ROWS];
} rc_tasks;

typedef struct {
    uint16_t counter;
    uint8_t origin, reason;
} rc_stop;

/* Encoders return the length, 0 for a value that must not be sent (`out` then means nothing); `out` holds
 * RC_MAX_BODY bytes (RC_HEADER_BYTES for a header). Decoders return false for bytes that no encoder writes.
 */
size_t rc_header_encode(const rc_header *header, uint8_t *out);
bool rc_header_decode(const uint8_t *frame, size_t n, rc_header *header);
size_t rc_state_encode(const rc_state *state, uint8_t *out);
bool rc_state_decode(const uint8_t *body, size_t n, rc_state *state);
/* Writes `heard` into a valid body. */
void rc_state_put_heard(uint8_t *body, uint64_t heard);
size_t rc_relay_encode(const rc_relay *relay, uint8_t *out);
bool rc_relay_decode(const uint8_t *body, size_t n, rc_relay *relay);
size_t rc_tasks_encode(const rc_tasks *tasks, uint8_t *out);
bool rc_tasks_decode(const uint8_t *body, size_t n, rc_tasks *tasks);
size_t rc_stop_encode(const rc_stop *stop, uint8_t *out);
bool rc_stop_decode(const uint8_t *body, size_t n, rc_stop *stop);

/* Would the body's decoder take these bytes? Cheaper than decoding them. */
bool rc_state_valid(const uint8_t *body, size_t n);
bool rc_relay_valid(const uint8_t *body, size_t n);
bool rc_tasks_valid(const uint8_t *body, size_t n);
bool rc_body_valid(uint8_t kind, const uint8_t *body, size_t n);
/* Header and plain body; the sealed bit says that the body was opened. */
bool rc_frame_valid(const uint8_t *frame, size_t n);
/* cdef: end */

/* STATE: fixed part, M costs, 2 bits per task, 1 + 2 bits per robot. */
#define RC_STATE_BYTES(n, m)                                                                                 \
    (RC_STATE_FIXED_BYTES + (m) + (2 * (m) + 7) / 8 + ((n) + 7) / 8 + (2 * (n) + 7) / 8)
/* RELAY: M, N, 1 bit per robot, rows. */
#define RC_RELAY_BYTES(rows, n, m) (2 + ((n) + 7) / 8 + (rows) * (RC_RELAY_ROW_BYTES + (m)))

_Static_assert(RC_STATE_BYTES(RC_MAX_ROBOTS, RC_MAX_TASK_SLOTS) <= RC_MAX_BODY, "STATE, ESP-NOW v1");
_Static_assert(RC_RELAY_BYTES(5, 32, 30) == RC_MAX_BODY, "RELAY, five rows at N = 32, M = 30, ESP-NOW v1");
_Static_assert(RC_RELAY_BYTES(2, RC_MAX_ROBOTS, RC_MAX_TASK_SLOTS) <= RC_MAX_BODY,
               "RELAY, two of the longest");
_Static_assert(RC_RELAY_BYTES(RC_MAX_RELAY_ROWS, RC_MAX_ROBOTS, 1) <= RC_MAX_BODY, "RELAY, most rows");
_Static_assert(RC_RELAY_BYTES(RC_MAX_RELAY_ROWS + 1, 1, 1) > RC_MAX_BODY, "RELAY, no more rows than these");
_Static_assert(RC_MAX_TASK_ROWS == RC_MAX_BODY / RC_TASK_ROW_BYTES, "TASKS, ESP-NOW v1");
_Static_assert(RC_STOP_BYTES <= RC_MAX_BODY, "STOP and RESUME");
_Static_assert(RC_MAX_TASK_SLOTS < RC_NO_SLOT, "a slot is never RC_NO_SLOT");

#endif
