/* What hal_cipher.c takes from the heap; link with -Wl,--wrap=malloc,--wrap=calloc. Prints allocations by
 * occasion. */
#include <stdio.h>
#include <stdlib.h>

#include "hal_cipher.h"

static unsigned allocations;
void *__real_malloc(size_t n);
void *__real_calloc(size_t count, size_t n);
void *__wrap_malloc(size_t n);
void *__wrap_calloc(size_t count, size_t n);

void *__wrap_malloc(size_t n) {
    allocations++;
    return __real_malloc(n);
}

void *__wrap_calloc(size_t count, size_t n) {
    allocations++;
    return __real_calloc(count, n);
}

static void show(const char *occasion, bool as_expected) {
    printf("%s: %u%s\n", occasion, allocations, as_expected ? "" : " (wrong)");
    allocations = 0;
}

int main(void) {
    uint8_t key[RC_KEY_BYTES] = {1}, other[RC_KEY_BYTES] = {2}, nonce[RC_NONCE_BYTES] = {0};
    uint8_t header[RC_HEADER_BYTES] = {0}, body[RC_MAX_BODY] = {3};
    uint8_t sealed[RC_MAX_BODY + RC_TAG_BYTES], plain[RC_MAX_BODY];
    rc_cipher cipher;
    hal_cipher_init(&cipher);
    show("start", true);
    show("key", hal_cipher_use(key));
    bool good = true, refused = true;
    for (int i = 0; i < 1000; i++) {
        nonce[0] = (uint8_t)i;
        good &= cipher.seal(cipher.context, key, nonce, header, body, sizeof body, sealed);
        good &= cipher.open(cipher.context, key, nonce, header, sealed, sizeof sealed, plain);
        sealed[i % (int)sizeof sealed] ^= 1;
        refused &= !cipher.open(cipher.context, key, nonce, header, sealed, sizeof sealed, plain);
    }
    show("3000 frames", good && refused);
    show("no key twice", hal_cipher_use(key));
    show("another key", cipher.seal(cipher.context, other, nonce, header, body, sizeof body, sealed));
    return 0;
}
