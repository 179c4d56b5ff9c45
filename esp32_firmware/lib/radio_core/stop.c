#include "stop.h"

#include "schedule.h"

enum { ANSWER_US = 100000 }; /* how long one is told of a RESUME that it missed */

void rc_stop_init(rc_stop_latch *latch, uint32_t salt, uint16_t counter, uint16_t resumed) {
    *latch = (rc_stop_latch){.salt = salt, .counter = counter, .resumed = resumed};
}

bool rc_stop_latched(const rc_stop_latch *latch) {
    return latch->counter > latch->resumed;
}

static uint32_t noise(rc_stop_latch *latch, uint32_t span_us) {
    return rc_noise(latch->salt, latch->sends++) % span_us;
}

static void flood(rc_stop_latch *latch, uint64_t now_us, uint8_t origin, uint8_t reason) {
    latch->flooding = true;
    latch->kind = rc_stop_latched(latch) ? RC_STOP : RC_RESUME;
    latch->origin = origin;
    latch->reason = reason;
    latch->left = RC_FLOOD_TIMES;
    latch->next_us = now_us;
    latch->until_us = now_us + RC_STOP_LAST_US;
    latch->shown = 0;
}

/* Of all who heard one frame at once: not at the same instant. */
static void forward(rc_stop_latch *latch, uint64_t now_us, uint8_t origin, uint8_t reason) {
    flood(latch, now_us, origin, reason);
    latch->next_us = now_us + noise(latch, RC_FLOOD_APART_US);
}

static void set(rc_stop_latch *latch, uint16_t counter, uint16_t resumed) {
    latch->changed = latch->changed || latch->counter != counter || latch->resumed != resumed;
    latch->counter = counter;
    latch->resumed = resumed;
}

/* A counter above all that is known. Not the next one: two parts of a fleet that cannot hear each other would
 * call two STOPs by one counter, and the RESUME of one would lift the other when they meet. */
static void set_above(rc_stop_latch *latch, uint16_t known, uint16_t resumed) {
    uint32_t above = known + 1u + noise(latch, RC_STOP_STEP);
    set(latch, above < RC_LAST_STOP ? (uint16_t)above : RC_LAST_STOP, resumed);
}

void rc_stop_raise(rc_stop_latch *latch, uint64_t now_us, uint8_t origin, uint8_t reason) {
    set_above(latch, latch->counter, latch->resumed);
    flood(latch, now_us, origin, reason);
}

bool rc_stop_resume(rc_stop_latch *latch, uint64_t now_us, uint16_t counter, uint8_t origin, uint8_t reason) {
    if (!rc_stop_latched(latch) || counter != latch->counter || counter == RC_LAST_STOP)
        return false;
    set(latch, counter, counter);
    flood(latch, now_us, origin, reason);
    return true;
}

/* Somebody has resumed the STOP of this counter. True: that is news here. */
static bool learn_resumed(rc_stop_latch *latch, uint16_t counter) {
    if (counter <= latch->resumed || counter < latch->counter || counter == RC_LAST_STOP)
        return false;
    if (rc_stop_latched(latch) && counter > latch->counter)
        set_above(latch, counter, counter);
    else
        set(latch, counter, counter);
    return true;
}

/* Whoever still sends a STOP that was resumed has missed the RESUME: say it once. */
static void answer(rc_stop_latch *latch, uint64_t now_us) {
    if (latch->flooding)
        return;
    flood(latch, now_us, latch->origin, latch->reason);
    latch->left = 1;
    latch->next_us = now_us + RC_FLOOD_MIN_US + noise(latch, RC_FLOOD_SPAN_US);
    latch->until_us = now_us + ANSWER_US;
}

void rc_stop_heard(rc_stop_latch *latch, uint64_t now_us, uint8_t kind, const rc_stop *stop) {
    if (stop->counter == 0)
        return;
    if (kind == RC_RESUME) {
        if (learn_resumed(latch, stop->counter))
            forward(latch, now_us, stop->origin, stop->reason);
    } else if (stop->counter > latch->resumed && stop->counter > latch->counter) {
        set(latch, stop->counter, latch->resumed);
        forward(latch, now_us, stop->origin, stop->reason);
    } else if (stop->counter <= latch->resumed) {
        answer(latch, now_us);
    }
}

/* Someone does not show what everybody should: tell it again, slowly. */
static void remind(rc_stop_latch *latch, uint64_t now_us) {
    if (latch->flooding)
        return;
    uint64_t shown = latch->shown;
    flood(latch, now_us, latch->origin, latch->reason);
    latch->next_us = now_us + RC_FLOOD_MIN_US + noise(latch, RC_FLOOD_SPAN_US);
    latch->left = 0;
    latch->shown = shown;
}

void rc_stop_shown(rc_stop_latch *latch, uint64_t now_us, uint8_t robot, bool stopped, uint16_t counter) {
    if (stopped && counter > latch->counter && counter > latch->resumed) {
        set(latch, counter, latch->resumed);
        forward(latch, now_us, robot, latch->reason);
    } else if (!stopped && learn_resumed(latch, counter) && rc_stop_latched(latch)) {
        forward(latch, now_us, latch->origin, latch->reason);
    }
    if (latch->counter == 0 || robot >= RC_MAX_ROBOTS)
        return;
    uint64_t bit = (uint64_t)1 << robot;
    bool latched = rc_stop_latched(latch);
    if (latched ? stopped && counter >= latch->counter : !stopped) {
        latch->shown |= bit;
    } else {
        latch->shown &= ~bit;
        remind(latch, now_us);
    }
}

bool rc_stop_next(rc_stop_latch *latch, uint64_t now_us, uint32_t round_us, uint64_t live, uint8_t *kind,
                  rc_stop *stop) {
    if (!latch->flooding || now_us < latch->next_us)
        return false;
    bool all_show = live != 0 && (live & ~latch->shown) == 0;
    if (latch->left == 0 && (all_show || now_us >= latch->until_us)) {
        latch->flooding = false;
        return false;
    }
    latch->kind = rc_stop_latched(latch) ? RC_STOP : RC_RESUME;
    *kind = latch->kind;
    *stop = (rc_stop){
        .counter = rc_stop_latched(latch) ? latch->counter : latch->resumed,
        .origin = latch->origin,
        .reason = latch->reason,
    };
    if (latch->left > 0)
        latch->left--;
    latch->next_us = now_us + (latch->left > 0 ? RC_FLOOD_MIN_US + noise(latch, RC_FLOOD_SPAN_US)
                                               : round_us + noise(latch, round_us));
    return true;
}

uint64_t rc_stop_due_us(const rc_stop_latch *latch) {
    return latch->flooding ? latch->next_us : UINT64_MAX;
}
