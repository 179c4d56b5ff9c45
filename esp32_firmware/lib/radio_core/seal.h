/* Authenticated encryption of the air frames: AES-128-CCM with an 8-byte tag (RFC 3610), behind a port.
 *
 * Decides the nonce and what is covered; the cipher itself is mbedTLS on the chip and `cryptography` on a PC.
 * The header is associated data, the body is encrypted, the tag follows it. Nonce: MAC (6), boot counter (4),
 * sequence number (3), little-endian: never used twice, because a boot counter is stored before it is used.
 */
#ifndef RC_SEAL_H
#define RC_SEAL_H

#include "frame.h"

/* cdef: begin */
enum { RC_KEY_BYTES = 16, RC_NONCE_BYTES = 13, RC_MAC_BYTES = 6 };

/* Both return false when the cipher refuses. seal: out holds n + RC_TAG_BYTES. open: n counts the tag, out
 * holds n - RC_TAG_BYTES and means nothing unless true came back. What is read and `out` never overlap. */
typedef bool (*rc_seal_port)(void *context, const uint8_t *key, const uint8_t *nonce, const uint8_t *header,
                             const uint8_t *body, size_t n, uint8_t *out);
typedef bool (*rc_open_port)(void *context, const uint8_t *key, const uint8_t *nonce, const uint8_t *header,
                             const uint8_t *sealed, size_t n, uint8_t *out);

typedef struct {
    void *context;
    rc_seal_port seal;
    rc_open_port open;
} rc_cipher;

void rc_nonce(const uint8_t *mac, uint32_t boot, uint32_t sequence, uint8_t *nonce);

/* frame: header and body, n bytes; it becomes header, encrypted body and tag, in place (RC_MAX_FRAME bytes).
 * The new length; 0 when the cipher refuses or there is no room: the frame then means nothing. The header's
 * sealed bit must be set. */
size_t rc_seal(const rc_cipher *cipher, const uint8_t *key, const uint8_t *mac, uint8_t *frame, size_t n);

/* The inverse, into plain[RC_MAX_FRAME]: header (sealed bit as received) and body, without the tag.
 * 0: forged, or too short to be sealed. */
size_t rc_unseal(const rc_cipher *cipher, const uint8_t *key, const uint8_t *mac, const uint8_t *frame,
                 size_t n, uint8_t *plain);
/* cdef: end */

#endif
