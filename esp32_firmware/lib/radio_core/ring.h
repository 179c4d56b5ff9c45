/* Framed messages that wait for the host. Whole messages only, in order; what does not fit is refused. */
#ifndef RC_RING_H
#define RC_RING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { RC_RING_BYTES = 16384 }; /* about 60 of the longest messages */

typedef struct {
    size_t head, used; /* head: the oldest byte */
    uint8_t bytes[RC_RING_BYTES];
} rc_ring;

/* message: ends with 0x00 and has no other. False: no room, nothing was taken. */
bool rc_ring_put(rc_ring *ring, const uint8_t *message, size_t n);

/* As many whole messages as fit into out; their length. */
size_t rc_ring_take(rc_ring *ring, uint8_t *out, size_t cap);

#endif
