/* A push button that means something only when it is held: once per press, whatever its contact does. */
#ifndef BUTTON_H
#define BUTTON_H

#include <stdbool.h>
#include <stdint.h>

enum { BUTTON_HOLD_US = 1000000, BUTTON_BOUNCE_US = 20000 };

typedef struct {
    bool level; /* as last seen: pressed */
    uint64_t since_us;
    bool down; /* as believed, once the level was the same for BUTTON_BOUNCE_US */
    uint64_t down_since_us;
    bool armed; /* was seen up since it last counted; a contact that is stuck since boot never counts */
} button;

/* For each look at the pin, a zeroed button first. True: held for BUTTON_HOLD_US now. */
bool button_held(button *b, uint64_t now_us, bool pressed);

#endif
