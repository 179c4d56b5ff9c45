/* What the status LED shows: a pattern that a plain LED can show too, and a colour. Knows no pin. */
#ifndef LAMP_H
#define LAMP_H

#include <stdbool.h>
#include <stdint.h>

#include "link.h"

/* The first that applies. */
typedef enum {
    LAMP_STOPPED,    /* a STOP is latched */
    LAMP_UNSAFE,     /* a key, but the boot counter cannot be stored: silent */
    LAMP_PASSIVE,    /* another radio has our id */
    LAMP_LISTENS,    /* no identity */
    LAMP_OPEN_ALONE, /* no key; fleet time is agreed with nobody yet */
    LAMP_SEALED_ALONE,
    LAMP_OPEN,  /* no key; in the fleet */
    LAMP_SEALED /* all is well */
} lamp_state;

enum { LAMP_STEP_US = 100000, LAMP_STEPS = 20 }; /* a pattern lasts 2 s */

typedef struct {
    bool on;
    uint8_t red, green, blue; /* zeros while it is off */
} lamp_light;

/* flags: RC_FLAG_*; robot: of the identity. */
lamp_state lamp_state_of(uint16_t flags, uint8_t robot);
lamp_light lamp_at(lamp_state state, uint64_t now_us);

#endif
