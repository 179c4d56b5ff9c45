#include "seal.h"

#include "bytes.h"

void rc_nonce(const uint8_t *mac, uint32_t boot, uint32_t sequence, uint8_t *nonce) {
    uint8_t *at = rc_put_bytes(nonce, mac, RC_MAC_BYTES);
    at = rc_put32(at, boot);
    rc_put24(at, sequence);
}

/* False: the frame does not begin with the header of a sealed one. */
static bool nonce_of(const uint8_t *mac, const uint8_t *frame, size_t n, uint8_t *nonce) {
    rc_header header;
    if (!rc_header_decode(frame, n, &header) || !header.sealed)
        return false;
    rc_nonce(mac, header.boot, header.sequence, nonce);
    return true;
}

size_t rc_seal(const rc_cipher *cipher, const uint8_t *key, const uint8_t *mac, uint8_t *frame, size_t n) {
    uint8_t nonce[RC_NONCE_BYTES];
    uint8_t body[RC_MAX_BODY]; /* so that no port needs to work in place */
    if (cipher->seal == NULL || n > RC_HEADER_BYTES + RC_MAX_BODY || !nonce_of(mac, frame, n, nonce))
        return 0;
    size_t length = n - RC_HEADER_BYTES;
    memcpy(body, frame + RC_HEADER_BYTES, length);
    if (!cipher->seal(cipher->context, key, nonce, frame, body, length, frame + RC_HEADER_BYTES))
        return 0;
    return n + RC_TAG_BYTES;
}

size_t rc_unseal(const rc_cipher *cipher, const uint8_t *key, const uint8_t *mac, const uint8_t *frame,
                 size_t n, uint8_t *plain) {
    uint8_t nonce[RC_NONCE_BYTES];
    if (cipher->open == NULL || n < RC_HEADER_BYTES + RC_TAG_BYTES || n > RC_MAX_FRAME ||
        !nonce_of(mac, frame, n, nonce))
        return 0;
    if (!cipher->open(cipher->context, key, nonce, frame, frame + RC_HEADER_BYTES, n - RC_HEADER_BYTES,
                      plain + RC_HEADER_BYTES))
        return 0;
    memcpy(plain, frame, RC_HEADER_BYTES);
    return n - RC_TAG_BYTES;
}
