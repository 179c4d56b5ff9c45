#include "lamp.h"

typedef struct {
    uint32_t steps; /* bit k: on in step k */
    uint8_t red, green, blue;
} pattern;

static const pattern PATTERNS[] = {
    [LAMP_STOPPED] = {0x55555, 32, 0, 0},      /* fast: 5 Hz */
    [LAMP_UNSAFE] = {0x00015, 32, 0, 0},       /* three flashes */
    [LAMP_PASSIVE] = {0x00005, 24, 0, 24},     /* two flashes */
    [LAMP_LISTENS] = {0x00001, 0, 0, 32},      /* one flash */
    [LAMP_OPEN_ALONE] = {0x07c1f, 24, 16, 0},  /* slow: 1 Hz */
    [LAMP_SEALED_ALONE] = {0x07c1f, 0, 24, 0}, /* slow: 1 Hz */
    [LAMP_OPEN] = {0xffff8, 24, 16, 0},        /* on, with a gap */
    [LAMP_SEALED] = {0xfffff, 0, 24, 0},       /* on */
};

lamp_state lamp_state_of(uint16_t flags, uint8_t robot) {
    bool open = flags & RC_FLAG_OPEN;
    if (flags & RC_FLAG_STOPPED)
        return LAMP_STOPPED;
    if (flags & RC_FLAG_UNSAFE)
        return LAMP_UNSAFE;
    if (flags & RC_FLAG_PASSIVE)
        return LAMP_PASSIVE;
    if (robot == RC_NO_ROBOT)
        return LAMP_LISTENS;
    if (flags & RC_FLAG_AGREED)
        return open ? LAMP_OPEN : LAMP_SEALED;
    return open ? LAMP_OPEN_ALONE : LAMP_SEALED_ALONE;
}

lamp_light lamp_at(lamp_state state, uint64_t now_us) {
    const pattern *shown = &PATTERNS[state];
    if ((shown->steps >> (now_us / LAMP_STEP_US % LAMP_STEPS) & 1) == 0)
        return (lamp_light){0};
    return (lamp_light){.on = true, .red = shown->red, .green = shown->green, .blue = shown->blue};
}
