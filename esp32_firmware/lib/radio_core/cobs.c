#include "cobs.h"

#include "bytes.h"
#include "crc32.h"

enum { FULL_BLOCK = 255, CRC_BYTES = 4, MOST_BYTES = RC_LINK_MAX_PAYLOAD + CRC_BYTES };
/* So many bytes without 0x00 fill a block. Wherever they begin in a message, those from MIDDLE_AT to
 * MIDDLE_END are among them. */
enum { FULL_ROW = FULL_BLOCK - 1, MIDDLE_AT = MOST_BYTES - FULL_ROW, MIDDLE_END = FULL_ROW };

_Static_assert(MOST_BYTES < 2 * FULL_ROW, "RC_LINK_MAX_STUFFED has room for two code bytes");

/* Exact: a borrow begins in a 0x00 only. */
static inline bool has_zero(const uint8_t *eight) {
    const uint64_t ones = 0x0101010101010101u;
    uint64_t bytes = rc_take64(&eight);
    return ((bytes - ones) & ~bytes & ones << 7) != 0;
}

/* Quick: the first 0x00 of the middle decides. */
static bool may_fill_a_block(const uint8_t *plain, size_t n) {
    if (n < FULL_ROW)
        return false;
    for (size_t at = MIDDLE_AT; at + 8 <= MIDDLE_END; at += 8)
        if (has_zero(plain + at))
            return false;
    return true;
}

/* Behind a full block that is not the last a 0x00 is put in, which becomes the code byte of the next one. The
 * new length. */
static size_t part_full_block(uint8_t *plain, size_t n) {
    size_t row = 0;
    for (size_t i = 0; i < n; i++) {
        if (row == FULL_ROW) {
            memmove(plain + i + 1, plain + i, n - i);
            plain[i] = 0;
            return n + 1;
        }
        row = plain[i] == 0 ? 0 : row + 1;
    }
    return n;
}

/* A 0x00 ends the block from `code` and makes way for the code byte of the next. The block that is open then.
 */
static inline uint8_t *close_at(uint8_t *code, uint8_t *at) {
    if (*at != 0)
        return code;
    *code = (uint8_t)(at - code);
    return at;
}

/* Written out: this is the dearest part of a message. */
static inline uint8_t *close_in_eight(uint8_t *code, uint8_t *at) {
    if (!has_zero(at))
        return code;
    code = close_at(code, at);
    code = close_at(code, at + 1);
    code = close_at(code, at + 2);
    code = close_at(code, at + 3);
    code = close_at(code, at + 4);
    code = close_at(code, at + 5);
    code = close_at(code, at + 6);
    return close_at(code, at + 7);
}

/* In place: the n plain bytes are at frame[1]; frame[0] and two places behind them are free. */
static size_t stuff(uint8_t *frame, size_t n) {
    if (may_fill_a_block(frame + 1, n))
        n = part_full_block(frame + 1, n);
    uint8_t *code = frame, *at = frame + 1, *end = at + n, *eights_end = at + n / 8 * 8;
    if (n & 8) {
        code = close_in_eight(code, at);
        at += 8;
    }
    for (; at < eights_end; at += 16) {
        code = close_in_eight(code, at);
        code = close_in_eight(code, at + 8);
    }
    *end = 0; /* of the frame; it closes the last block as others do */
    for (; at <= end; at++)
        code = close_at(code, at);
    return n + 2;
}

size_t rc_cobs_close(uint8_t *frame, size_t n) {
    if (n > RC_LINK_MAX_PAYLOAD)
        return 0;
    rc_put32(frame + 1 + n, rc_crc32(frame + 1, n));
    return stuff(frame, n + CRC_BYTES);
}

size_t rc_cobs_encode(const uint8_t *payload, size_t n, uint8_t *out) {
    if (n > RC_LINK_MAX_PAYLOAD)
        return 0;
    memcpy(out + 1, payload, n);
    return rc_cobs_close(out, n);
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
