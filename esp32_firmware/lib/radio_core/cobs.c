#include "cobs.h"

#include "bytes.h"
#include "crc32.h"

_Static_assert(RC_LINK_MAX_PAYLOAD + 4 < 2 * 254, "RC_LINK_MAX_STUFFED has room for two code bytes");

enum { FULL_BLOCK = 255, CRC_BYTES = 4 };

/* A block that is longer than its code byte can say; a message has room for one at most. */
typedef struct {
    uint8_t *code; /* NULL: none */
    uint8_t *next; /* what follows it: a code byte or the end */
} long_block;

/* The block from `code` ends before `next`, where the next code byte goes. */
static inline uint8_t *close_block(uint8_t *code, uint8_t *next, long_block *too_long) {
    if (next - code >= FULL_BLOCK)
        *too_long = (long_block){code, next};
    *code = (uint8_t)(next - code);
    return next;
}

/* The highest bit of each of the eight bytes that is 0x00. */
static inline uint64_t zeros_in(const uint8_t *eight) {
    const uint64_t low = 0x7f7f7f7f7f7f7f7fu;
    uint64_t bytes = rc_take64(&eight);
    return ~(((bytes & low) + low) | bytes | low);
}

static inline unsigned first_of(uint64_t zeros) {
    return (unsigned)__builtin_ctzll(zeros) >> 3;
}

/* Code bytes for the 0x00 among eight bytes; the place of the last one, which stays open. */
static inline uint8_t *close_blocks(uint8_t *code, uint8_t *eight, uint64_t zeros, long_block *too_long) {
    size_t open = first_of(zeros);
    close_block(code, eight + open, too_long);
    if (zeros == 0x8080808080808080u) { /* all of them, as in the STATE of a robot without a claim */
        memset(eight, 1, 7);
        return eight + 7;
    }
    while ((zeros &= zeros - 1) != 0) {
        size_t next = first_of(zeros);
        eight[open] = (uint8_t)(next - open);
        open = next;
    }
    return eight + open;
}

/* A full block and a new one take the place of a long one. */
static uint8_t *cut(long_block block, uint8_t *end) {
    uint8_t *code = block.code + FULL_BLOCK;
    memmove(code + 1, code, (size_t)(end - code));
    *block.code = FULL_BLOCK;
    *code = (uint8_t)(block.next + 1 - code);
    return end + 1;
}

/* In place: the n plain bytes are at bytes[1]; bytes[0] and one place behind them are free. The length. Each
 * 0x00 makes way for the code byte of the block behind it. */
static size_t stuff(uint8_t *bytes, size_t n) {
    uint8_t *code = bytes, *at = bytes + 1, *end = at + n, *eights_end = at + n / 8 * 8;
    long_block too_long = {NULL, NULL};
    for (; at < eights_end; at += 8) {
        uint64_t zeros = zeros_in(at);
        if (zeros != 0)
            code = close_blocks(code, at, zeros, &too_long);
    }
    for (; at < end; at++)
        if (*at == 0)
            code = close_block(code, at, &too_long);
    close_block(code, end, &too_long);
    /* A full last block needs no empty one behind it. */
    if (too_long.code != NULL && too_long.code + FULL_BLOCK != end)
        end = cut(too_long, end);
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
