#pragma once
#include <stddef.h>
#define MBEDTLS_ERR_CCM_AUTH_FAILED -0x000F
typedef enum { MBEDTLS_CIPHER_ID_NONE, MBEDTLS_CIPHER_ID_NULL, MBEDTLS_CIPHER_ID_AES } mbedtls_cipher_id_t;
typedef struct {
    void *state;
} mbedtls_ccm_context;
void mbedtls_ccm_init(mbedtls_ccm_context *context);
void mbedtls_ccm_free(mbedtls_ccm_context *context);
int mbedtls_ccm_setkey(mbedtls_ccm_context *context, mbedtls_cipher_id_t cipher, const unsigned char *key,
                       unsigned int bits);
int mbedtls_ccm_encrypt_and_tag(mbedtls_ccm_context *context, size_t length, const unsigned char *nonce,
                                size_t nonce_length, const unsigned char *ad, size_t ad_length,
                                const unsigned char *input, unsigned char *output, unsigned char *tag,
                                size_t tag_length);
int mbedtls_ccm_auth_decrypt(mbedtls_ccm_context *context, size_t length, const unsigned char *nonce,
                             size_t nonce_length, const unsigned char *ad, size_t ad_length,
                             const unsigned char *input, unsigned char *output, const unsigned char *tag,
                             size_t tag_length);
