/* In place of mbedTLS, so that a sealed frame can be told from a plain one. It hides nothing; what the real
 * one does is tested in test_hal_cipher.py. */
#include <stdlib.h>
#include <string.h>

#include "fake.h"
#include "mbedtls/ccm.h"

enum { MASK = 0xa5 };

void mbedtls_ccm_init(mbedtls_ccm_context *context) {
    context->state = NULL;
}

void mbedtls_ccm_free(mbedtls_ccm_context *context) {
    (void)context;
}

int mbedtls_ccm_setkey(mbedtls_ccm_context *context, mbedtls_cipher_id_t cipher, const unsigned char *key,
                       unsigned int bits) {
    (void)key;
    context->state = fake_take_memory(300);
    return cipher == MBEDTLS_CIPHER_ID_AES && bits == 128 ? 0 : -1;
}

int mbedtls_ccm_encrypt_and_tag(mbedtls_ccm_context *context, size_t length, const unsigned char *nonce,
                                size_t nonce_length, const unsigned char *ad, size_t ad_length,
                                const unsigned char *input, unsigned char *output, unsigned char *tag,
                                size_t tag_length) {
    (void)nonce;
    (void)nonce_length;
    (void)ad;
    (void)ad_length;
    for (size_t i = 0; i < length; i++)
        output[i] = input[i] ^ MASK;
    memset(tag, MASK, tag_length);
    return context->state != NULL ? 0 : -1;
}

int mbedtls_ccm_auth_decrypt(mbedtls_ccm_context *context, size_t length, const unsigned char *nonce,
                             size_t nonce_length, const unsigned char *ad, size_t ad_length,
                             const unsigned char *input, unsigned char *output, const unsigned char *tag,
                             size_t tag_length) {
    (void)nonce;
    (void)nonce_length;
    (void)ad;
    (void)ad_length;
    for (size_t i = 0; i < length; i++)
        output[i] = input[i] ^ MASK;
    for (size_t i = 0; i < tag_length; i++)
        if (tag[i] != MASK)
            return MBEDTLS_ERR_CCM_AUTH_FAILED;
    return context->state != NULL ? 0 : -1;
}
