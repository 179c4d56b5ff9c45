#include "stop.h"

#include "schedule.h"

enum { ANSWER_US = 100000 }; /* how long one is told of a RESUME that it missed */

bool rc_stop_latched(const rc_stop_latch *latch) {
    return latch->counter > latch->resumed;
}

static void flood(rc_stop_latch *latch, uint64_t now_us, uint8_t kind, uint8_t origin, uint8_t reason) {
    latch->flooding = true;
    latch->kind = kind;
    latch->origin = origin;
    latch->reason = reason;
    latch->left = RC_FLOOD_TIMES;
    latch->next_us = now_us;
    latch->until_us = now_us + RC_STOP_LAST_US;
    latch->shown = 0;
}

static void set(rc_stop_latch *latch, uint16_t counter, uint16_t resumed) {
    latch->changed = latch->changed || latch->counter != counter || latch->resumed != resumed;
    latch->counter = counter;
    latch->resumed = resumed;
}

/* A counter above all that was resumed; the last one stays. */
static void raise_above(rc_stop_latch *latch, uint16_t resumed) {
    uint16_t above = resumed < RC_LAST_STOP ? (uint16_t)(resumed + 1) : RC_LAST_STOP;
    set(latch, latch->counter > above ? latch->counter : above, resumed);
}

bool rc_stop_raise(rc_stop_latch *latch, uint64_t now_us, uint8_t origin, uint8_t reason) {
    if (!rc_stop_latched(latch))
        raise_above(latch, latch->resumed);
    latch->raised_here = true;
    flood(latch, now_us, RC_STOP, origin, reason);
    return true;
}

bool rc_stop_resume(rc_stop_latch *latch, uint64_t now_us, uint16_t counter, uint8_t origin, uint8_t reason) {
    if (!rc_stop_latched(latch) || counter != latch->counter || counter == RC_LAST_STOP)
        return false;
    set(latch, latch->counter, counter);
    latch->raised_here = false;
    flood(latch, now_us, RC_RESUME, origin, reason);
    return true;
}

/* Our STOP had a counter that the fleet resumed before: raise it again, above. */
static void raise_again(rc_stop_latch *latch, uint64_t now_us, uint16_t resumed) {
    raise_above(latch, resumed);
    flood(latch, now_us, RC_STOP, latch->origin, latch->reason);
}

/* Whoever still sends a STOP that was resumed has missed the RESUME: say it once. */
static void answer(rc_stop_latch *latch, uint64_t now_us) {
    if (latch->flooding)
        return;
    flood(latch, now_us, RC_RESUME, latch->origin, latch->reason);
    latch->left = 1;
    latch->next_us = now_us + RC_FLOOD_MIN_US;
    latch->until_us = now_us + ANSWER_US;
}

static bool heard_stop(rc_stop_latch *latch, uint64_t now_us, const rc_stop *stop) {
    if (stop->counter <= latch->resumed) {
        answer(latch, now_us);
        return false;
    }
    if (stop->counter == latch->counter)
        latch->raised_here = false; /* it counts for others, too */
    if (stop->counter <= latch->counter)
        return false;
    set(latch, stop->counter, latch->resumed);
    latch->raised_here = false;
    flood(latch, now_us, RC_STOP, stop->origin, stop->reason);
    return true;
}

static bool heard_resume(rc_stop_latch *latch, uint64_t now_us, const rc_stop *stop) {
    if (stop->counter == RC_LAST_STOP || stop->counter <= latch->resumed)
        return false;
    if (latch->raised_here && stop->counter >= latch->counter) {
        raise_again(latch, now_us, stop->counter);
        return true;
    }
    set(latch, latch->counter > stop->counter ? latch->counter : stop->counter, stop->counter);
    if (!rc_stop_latched(latch)) /* a later STOP goes on */
        flood(latch, now_us, RC_RESUME, stop->origin, stop->reason);
    return true;
}

bool rc_stop_heard(rc_stop_latch *latch, uint64_t now_us, uint8_t kind, const rc_stop *stop) {
    return kind == RC_STOP ? heard_stop(latch, now_us, stop) : heard_resume(latch, now_us, stop);
}

void rc_stop_shown(rc_stop_latch *latch, uint64_t now_us, uint8_t robot, bool stopped, uint16_t counter) {
    if (stopped && counter > latch->counter) {
        set(latch, counter, latch->resumed);
    } else if (!stopped && counter >= latch->counter && counter > latch->resumed && counter < RC_LAST_STOP) {
        if (latch->raised_here)
            raise_again(latch, now_us, counter);
        else
            set(latch, counter, counter);
    }
    bool shows = latch->kind == RC_STOP ? stopped && counter >= latch->counter : !stopped;
    if (shows && robot < RC_MAX_ROBOTS)
        latch->shown |= (uint64_t)1 << robot;
    if (stopped && counter == latch->counter)
        latch->raised_here = false;
}

bool rc_stop_next(rc_stop_latch *latch, uint64_t now_us, uint32_t round_us, uint32_t salt, uint64_t live,
                  uint8_t *kind, rc_stop *stop) {
    if (!latch->flooding || now_us < latch->next_us)
        return false;
    if (latch->left == 0 && ((live & ~latch->shown) == 0 || now_us >= latch->until_us)) {
        latch->flooding = false;
        return false;
    }
    *kind = latch->kind;
    *stop = (rc_stop){
        .counter = latch->kind == RC_STOP ? latch->counter : latch->resumed,
        .origin = latch->origin,
        .reason = latch->reason,
    };
    if (latch->left > 0)
        latch->left--;
    uint32_t noise = rc_noise(salt, latch->sends++);
    latch->next_us =
        now_us + (latch->left > 0 ? RC_FLOOD_MIN_US + noise % RC_FLOOD_SPAN_US : round_us + noise % round_us);
    return true;
}

uint64_t rc_stop_due_us(const rc_stop_latch *latch) {
    return latch->flooding ? latch->next_us : UINT64_MAX;
}
