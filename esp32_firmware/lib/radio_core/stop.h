/* The STOP latch of a radio, and the flood that carries it (facts: everybody within 7 ms at 50 % loss).
 *
 * A STOP has a counter; of two the larger counts. RESUME names the counter that it answers and lifts exactly
 * that STOP. In doubt the fleet stands: a latched radio that learns of a RESUME for a later counter than its
 * own has not been part of what happened since, or its STOP was raised by somebody who had not; it raises its
 * STOP again, above. Whoever learns of either sends it on: 20 times every 5 to 15 ms, then every one to two
 * rounds while somebody's STATE does not show it, and where nobody is heard for RC_STOP_LAST_US. */
#ifndef RC_STOP_LATCH_H
#define RC_STOP_LATCH_H

#include "frame.h"

/* cdef: begin */
/* rc_stop.reason; others are the host's */
enum { RC_STOP_BY_COMMAND = 0, RC_STOP_BY_BUTTON = 1 };

enum {
    RC_FLOOD_TIMES = 20,
    RC_FLOOD_MIN_US = 5000,
    RC_FLOOD_SPAN_US = 10000,
    RC_FLOOD_APART_US = 2000, /* those who forward one frame begin within this */
    RC_STOP_LAST_US = 60000000,
    RC_STOP_STEP = 16,   /* a new STOP's counter is 1 .. RC_STOP_STEP above the last */
    RC_LAST_STOP = 65535 /* is never resumed: no later STOP could be told from it */
};

typedef struct {
    uint32_t salt;             /* of this radio's pauses */
    uint16_t counter, resumed; /* both outlive a reboot */
    bool flooding;
    uint8_t kind; /* of the flood: RC_STOP or RC_RESUME */
    uint8_t origin, reason;
    uint8_t left;               /* fast repetitions to come */
    uint64_t next_us, until_us; /* own time */
    uint32_t sends;             /* numbers the pauses */
    uint64_t shown;             /* robots whose STATE shows what is flooded */
    bool changed;               /* counter or resumed, since whoever stores them cleared it */
} rc_stop_latch;

void rc_stop_init(rc_stop_latch *latch, uint32_t salt, uint16_t counter, uint16_t resumed);
bool rc_stop_latched(const rc_stop_latch *latch);
/* A host's command or the button; in a fleet that is stopped already a new STOP, which needs its own RESUME.
 */
void rc_stop_raise(rc_stop_latch *latch, uint64_t now_us, uint8_t origin, uint8_t reason);
/* False: a RESUME for a counter that is not latched here. */
bool rc_stop_resume(rc_stop_latch *latch, uint64_t now_us, uint16_t counter, uint8_t origin, uint8_t reason);
/* A STOP or RESUME from the air. */
void rc_stop_heard(rc_stop_latch *latch, uint64_t now_us, uint8_t kind, const rc_stop *stop);
/* A STATE: what its robot shows. */
void rc_stop_shown(rc_stop_latch *latch, uint64_t now_us, uint8_t robot, bool stopped, uint16_t counter);
/* What is to be sent now: true, kind and body, and the pause until the next begins. live: robots to wait for.
 */
bool rc_stop_next(rc_stop_latch *latch, uint64_t now_us, uint32_t round_us, uint64_t live, uint8_t *kind,
                  rc_stop *stop);
/* When rc_stop_next has work again; UINT64_MAX: nothing to flood. */
uint64_t rc_stop_due_us(const rc_stop_latch *latch);
/* cdef: end */

#endif
