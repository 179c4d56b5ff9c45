/* CRC-32 as in zlib (polynomial 0xEDB88320, reflected, inverted). */
#ifndef RC_CRC32_H
#define RC_CRC32_H

#include <stddef.h>
#include <stdint.h>

uint32_t rc_crc32(const uint8_t *bytes, size_t n);

#endif
