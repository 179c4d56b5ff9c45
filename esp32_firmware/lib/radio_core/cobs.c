#include "cobs.h"

#include "bytes.h"
#include "crc32.h"

_Static_assert(RC_LINK_MAX_PAYLOAD + 4 < 2 * 254, "RC_LINK_MAX_STUFFED has room for two code bytes");

enum { FULL_BLOCK = 255, CRC_BYTES = 4 };

/* In place: the n plain bytes are at bytes[1]; bytes[0] and two places behind them are free. The length. */
static size_t stuff(uint8_t *bytes, size_t n) {
    size_t code = 0, end = 1 + n; /* code: where the open block's code byte goes */
    for (size_t i = 1; i < end; i++) {
        if (i - code == FULL_BLOCK) { /* closed only when more follows: none is left empty at the end */
            memmove(bytes + i + 1, bytes + i, end - i);
            end++;
            bytes[code] = FULL_BLOCK;
            code = i++;
        }
        if (bytes[i] == 0) {
            bytes[code] = (uint8_t)(i - code);
            code = i;
        }
    }
    bytes[code] = (uint8_t)(end - code);
    return end;
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
