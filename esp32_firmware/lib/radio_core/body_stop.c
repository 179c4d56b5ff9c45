/* The body of STOP and RESUME. */
#include "bytes.h"
#include "frame.h"

size_t rc_stop_encode(const rc_stop *stop, uint8_t *out) {
    uint8_t *at = rc_put16(out, stop->counter);
    at = rc_put8(at, stop->origin);
    at = rc_put8(at, stop->reason);
    return (size_t)(at - out);
}

bool rc_stop_decode(const uint8_t *body, size_t n, rc_stop *stop) {
    if (n != RC_STOP_BYTES)
        return false;
    const uint8_t *at = body;
    stop->counter = rc_take16(&at);
    stop->origin = rc_take8(&at);
    stop->reason = rc_take8(&at);
    return true;
}
