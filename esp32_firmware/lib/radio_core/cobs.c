#include "cobs.h"

#include "bytes.h"
#include "crc32.h"

_Static_assert(RC_LINK_MAX_PAYLOAD + 4 < 2 * 254, "RC_LINK_MAX_STUFFED has room for two code bytes");

enum { FULL_BLOCK = 255, CRC_BYTES = 4 };

typedef struct {
    uint8_t *code; /* where the open block's code byte goes */
    uint8_t *at;
} stuffer;

static void stuff(stuffer *s, const uint8_t *bytes, size_t n) {
    for (size_t i = 0; i < n; i++) {
        /* A full block is closed only when more follows, so that none is left empty at the end. */
        if (s->at - s->code == FULL_BLOCK) {
            *s->code = FULL_BLOCK;
            s->code = s->at++;
        }
        if (bytes[i] == 0) {
            *s->code = (uint8_t)(s->at - s->code);
            s->code = s->at++;
        } else {
            *s->at++ = bytes[i];
        }
    }
}

size_t rc_cobs_encode(const uint8_t *payload, size_t n, uint8_t *out) {
    if (n > RC_LINK_MAX_PAYLOAD)
        return 0;
    uint8_t crc[CRC_BYTES];
    rc_put32(crc, rc_crc32(payload, n));
    stuffer s = {.code = out, .at = out + 1};
    stuff(&s, payload, n);
    stuff(&s, crc, CRC_BYTES);
    *s.code = (uint8_t)(s.at - s.code);
    *s.at++ = 0;
    return (size_t)(s.at - out);
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
