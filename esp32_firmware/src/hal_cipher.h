/* The radio core's cipher on the chip: AES-128-CCM of mbedTLS, for the one task that owns the radio. */
#ifndef HAL_CIPHER_H
#define HAL_CIPHER_H

#include "seal.h"

/* Fills in the port. mbedTLS allocates the state of AES (about 300 bytes) when a key is set, and nothing for
 * a frame. A key is set when a frame needs another than the frame before it. */
void hal_cipher_init(rc_cipher *cipher);

/* Sets the key ahead of the first frame, so that no heap is used after the start. False: mbedTLS refused; the
 * radio will try again with each frame. */
bool hal_cipher_use(const uint8_t *key);

#endif
