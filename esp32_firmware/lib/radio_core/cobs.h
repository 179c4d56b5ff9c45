/* Frames on the USB link: payload + CRC-32 (little-endian), COBS, 0x00 (Cheshire and Baker 1999).
 *
 * Strict: only what rc_cobs_encode writes is decoded; every other byte is counted as skipped.
 * The same rules in Python: host/hippomat_core/wire/cobs.py. */
#ifndef RC_COBS_H
#define RC_COBS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* cdef: begin */
enum {
    RC_LINK_MAX_PAYLOAD = 260,                     /* a heard frame with its times and RSSI */
    RC_LINK_MAX_STUFFED = RC_LINK_MAX_PAYLOAD + 6, /* CRC, one code byte per 254; without the 0x00 */
    RC_LINK_MAX_ENCODED = RC_LINK_MAX_STUFFED + 1
};

typedef struct {
    uint32_t skipped_bytes; /* noise, broken frames and lone delimiters */
    uint32_t bad_checksums;
    uint16_t held;
    bool overlong;
    uint8_t buffer[RC_LINK_MAX_STUFFED];
} rc_cobs_decoder;

/* Writes the frame, 0x00 included, to out[RC_LINK_MAX_ENCODED]; its length, 0 if the payload is too long. */
size_t rc_cobs_encode(const uint8_t *payload, size_t n, uint8_t *out);

/* The same in place: the payload is at frame[1], frame holds RC_LINK_MAX_ENCODED bytes. */
size_t rc_cobs_close(uint8_t *frame, size_t n);

/* Takes one byte of a zeroed decoder's stream. Returns the length of the payload that this byte completed,
 * then at decoder->buffer until the next call; -1 for none. */
int rc_cobs_push(rc_cobs_decoder *decoder, uint8_t byte);
/* cdef: end */

#endif
