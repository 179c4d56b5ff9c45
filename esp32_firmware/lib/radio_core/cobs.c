#include "cobs.h"

#include "bytes.h"
#include "crc32.h"

_Static_assert(RC_LINK_MAX_PAYLOAD + 4 < 2 * 254, "RC_LINK_MAX_STUFFED has room for two code bytes");

enum { FULL_BLOCK = 255, CRC_BYTES = 4 };

typedef struct {
    uint8_t *code; /* where the open block's code byte goes */
    uint8_t *full; /* a block that is longer than its code byte can say; a message has room for one at most */
    size_t full_length;
} stuffing;

/* The open block ends before `next`, where the next code byte goes. */
static inline void close_block(stuffing *s, uint8_t *next) {
    size_t length = (size_t)(next - s->code);
    if (length >= FULL_BLOCK) {
        s->full = s->code;
        s->full_length = length;
    }
    *s->code = (uint8_t)length;
    s->code = next;
}

/* The highest bit of each of the eight bytes that is 0x00. */
static inline uint64_t zeros_in(const uint8_t *bytes) {
    const uint64_t low = 0x7f7f7f7f7f7f7f7fu;
    uint64_t eight = rc_take64(&bytes);
    return ~(((eight & low) + low) | eight | low);
}

/* In place: the n plain bytes are at bytes[1]; bytes[0] and one place behind them are free. The length. Each
 * 0x00 makes way for the code byte of the block behind it. */
static size_t stuff(uint8_t *bytes, size_t n) {
    stuffing s = {.code = bytes};
    uint8_t *at = bytes + 1, *end = at + n;
    for (; end - at >= 8; at += 8)
        for (uint64_t zeros = zeros_in(at); zeros != 0; zeros &= zeros - 1)
            close_block(&s, at + (unsigned)__builtin_ctzll(zeros) / 8);
    for (; at < end; at++)
        if (*at == 0)
            close_block(&s, at);
    close_block(&s, end);
    /* A full last block needs no empty one behind it. */
    if (s.full != NULL && s.full + FULL_BLOCK != end) {
        uint8_t *cut = s.full + FULL_BLOCK;
        memmove(cut + 1, cut, (size_t)(end - cut));
        end++;
        *s.full = FULL_BLOCK;
        *cut = (uint8_t)(s.full_length - FULL_BLOCK + 1);
    }
    return (size_t)(end - bytes);
}

size_t rc_cobs_encode(const uint8_t *payload, size_t n, uint8_t *out) {
    if (n > RC_LINK_MAX_PAYLOAD)
        return 0;
    memcpy(out + 1, payload, n);
    rc_put32(out + 1 + n, rc_crc32(payload, n));
    size_t length = stuff(out, n + CRC_BYTES);
    out[length] = 0;
    return length + 1;
}

/* In place; the length, or -1 for bytes that stuff() does not write. Never meets 0x00: it ends the frame. */
static int unstuff(uint8_t *bytes, size_t n) {
    size_t in = 0, out = 0;
    unsigned code = 0;
    while (in < n) {
        unsigned previous = code;
        code = bytes[in];
        if (in + code > n)
            return -1;
        if (previous != 0 && previous != FULL_BLOCK)
            bytes[out++] = 0;
        memmove(bytes + out, bytes + in + 1, code - 1);
        out += code - 1;
        in += code;
        if (in == n && code == 1 && previous == FULL_BLOCK)
            return -1;
    }
    return n ? (int)out : -1;
}

static int end_of_frame(rc_cobs_decoder *d) {
    size_t held = d->held;
    int plain = d->overlong ? -1 : unstuff(d->buffer, held);
    d->held = 0;
    d->overlong = false;
    if (plain >= CRC_BYTES && plain <= RC_LINK_MAX_PAYLOAD + CRC_BYTES) {
        int n = plain - CRC_BYTES;
        const uint8_t *crc = d->buffer + n;
        if (rc_crc32(d->buffer, (size_t)n) == rc_take32(&crc))
            return n;
        d->bad_checksums++;
    }
    d->skipped_bytes += (uint32_t)held + 1;
    return -1;
}

int rc_cobs_push(rc_cobs_decoder *d, uint8_t byte) {
    if (byte == 0)
        return end_of_frame(d);
    if (d->overlong) {
        d->skipped_bytes++;
    } else if (d->held == RC_LINK_MAX_STUFFED) {
        d->skipped_bytes += RC_LINK_MAX_STUFFED + 1u;
        d->overlong = true;
        d->held = 0;
    } else {
        d->buffer[d->held++] = byte;
    }
    return -1;
}
