#include "hal_cipher.h"

#include <string.h>

#include "mbedtls/ccm.h"

static mbedtls_ccm_context ccm;
static uint8_t key_in_use[RC_KEY_BYTES];
static bool ready; /* ccm holds key_in_use */

static void forget(void) {
    mbedtls_ccm_free(&ccm);
    mbedtls_ccm_init(&ccm);
    ready = false;
}

bool hal_cipher_use(const uint8_t *key) {
    if (ready && memcmp(key, key_in_use, sizeof key_in_use) == 0)
        return true;
    forget();
    memcpy(key_in_use, key, sizeof key_in_use);
    ready = mbedtls_ccm_setkey(&ccm, MBEDTLS_CIPHER_ID_AES, key, 8 * RC_KEY_BYTES) == 0;
    return ready;
}

/* mbedTLS 3.6 keeps the state of a frame that broke off: the next one begins anew. A wrong tag breaks nothing
 * off. */
static bool finished(int error) {
    if (error != 0 && error != MBEDTLS_ERR_CCM_AUTH_FAILED)
        forget();
    return error == 0;
}

static bool ccm_seal(void *context, const uint8_t *key, const uint8_t *nonce, const uint8_t *header,
                     const uint8_t *body, size_t n, uint8_t *out) {
    (void)context;
    return hal_cipher_use(key) &&
           finished(mbedtls_ccm_encrypt_and_tag(&ccm, n, nonce, RC_NONCE_BYTES, header, RC_HEADER_BYTES, body,
                                                out, out + n, RC_TAG_BYTES));
}

static bool ccm_open(void *context, const uint8_t *key, const uint8_t *nonce, const uint8_t *header,
                     const uint8_t *sealed, size_t n, uint8_t *out) {
    (void)context;
    size_t length = n - RC_TAG_BYTES;
    return n >= RC_TAG_BYTES && hal_cipher_use(key) &&
           finished(mbedtls_ccm_auth_decrypt(&ccm, length, nonce, RC_NONCE_BYTES, header, RC_HEADER_BYTES,
                                             sealed, out, sealed + length, RC_TAG_BYTES));
}

void hal_cipher_init(rc_cipher *cipher) {
    *cipher = (rc_cipher){.context = NULL, .seal = ccm_seal, .open = ccm_open};
}
