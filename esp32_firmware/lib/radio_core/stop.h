/* The STOP latch of a radio, and the flood that carries it (facts: everybody within 7 ms at 50 % loss).
 *
 * A STOP has a counter; of two the larger counts. RESUME names the counter that it answers and lifts every
 * STOP up to it, never a later one. Whoever learns of either sends it on: 20 times every 5 to 15 ms, then
 * once per round until every live robot's STATE shows it, at most RC_STOP_LAST_US. A STOP that was raised
 * here and turns out to have been resumed before (the raiser had not heard the fleet yet) is raised again
 * above it. */
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
    RC_STOP_LAST_US = 60000000,
    RC_LAST_STOP = 65535 /* is never resumed: no later STOP could be told from it */
};

typedef struct {
    uint16_t counter, resumed; /* both outlive a reboot */
    bool flooding;
    uint8_t kind; /* of the flood: RC_STOP or RC_RESUME */
    uint8_t origin, reason;
    uint8_t left;               /* fast repetitions to come */
    bool raised_here;           /* and not yet known to count for anybody else */
    uint64_t next_us, until_us; /* own time */
    uint32_t sends;             /* numbers the pauses */
    uint64_t shown;             /* robots whose STATE shows what is flooded */
    bool changed;               /* counter or resumed, since whoever stores them cleared it */
} rc_stop_latch;

bool rc_stop_latched(const rc_stop_latch *latch);
/* A host's command or the button. False: a RESUME for a counter that is not latched here. */
bool rc_stop_raise(rc_stop_latch *latch, uint64_t now_us, uint8_t origin, uint8_t reason);
bool rc_stop_resume(rc_stop_latch *latch, uint64_t now_us, uint16_t counter, uint8_t origin, uint8_t reason);
/* A STOP or RESUME from the air. True: it changed something here, so the host must know it. */
bool rc_stop_heard(rc_stop_latch *latch, uint64_t now_us, uint8_t kind, const rc_stop *stop);
/* A STATE: what its robot shows. */
void rc_stop_shown(rc_stop_latch *latch, uint64_t now_us, uint8_t robot, bool stopped, uint16_t counter);
/* What is to be sent now: true, kind and body, and the pause until the next begins. live: robots to wait for.
 */
bool rc_stop_next(rc_stop_latch *latch, uint64_t now_us, uint32_t round_us, uint32_t salt, uint64_t live,
                  uint8_t *kind, rc_stop *stop);
/* When rc_stop_next has work again; UINT64_MAX: nothing to flood. */
uint64_t rc_stop_due_us(const rc_stop_latch *latch);
/* cdef: end */

#endif
