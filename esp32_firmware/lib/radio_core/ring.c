#include "ring.h"

#include <string.h>

bool rc_ring_put(rc_ring *ring, const uint8_t *message, size_t n) {
    if (n > RC_RING_BYTES - ring->used)
        return false;
    size_t tail = (ring->head + ring->used) % RC_RING_BYTES;
    size_t first = n < RC_RING_BYTES - tail ? n : RC_RING_BYTES - tail;
    memcpy(ring->bytes + tail, message, first);
    if (first < n)
        memcpy(ring->bytes, message + first, n - first);
    ring->used += n;
    return true;
}

size_t rc_ring_take(rc_ring *ring, uint8_t *out, size_t cap) {
    size_t whole = 0; /* bytes up to the last 0x00 that fits */
    for (size_t i = 0; i < ring->used && i < cap; i++) {
        out[i] = ring->bytes[(ring->head + i) % RC_RING_BYTES];
        if (out[i] == 0)
            whole = i + 1;
    }
    ring->head = (ring->head + whole) % RC_RING_BYTES;
    ring->used -= whole;
    return whole;
}
