#include "button.h"

static void settle(button *b) {
    if (b->level && !b->down)
        b->down_since_us = b->since_us;
    b->down = b->level;
    b->armed = b->armed || !b->down;
}

bool button_held(button *b, uint64_t now_us, bool pressed) {
    if (pressed != b->level) {
        b->level = pressed;
        b->since_us = now_us;
    }
    if (now_us - b->since_us >= BUTTON_BOUNCE_US)
        settle(b);
    if (!b->down || !b->armed || now_us - b->down_since_us < BUTTON_HOLD_US)
        return false;
    b->armed = false;
    return true;
}
