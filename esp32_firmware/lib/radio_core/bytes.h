/* Little-endian integers and 2-bit fields ("crumbs", lowest bits first) in byte strings.
 *
 * Callers check lengths first; nothing here does. */
#ifndef RC_BYTES_H
#define RC_BYTES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* Writers return the position behind what they wrote. */
static inline uint8_t *rc_put(uint8_t *at, uint64_t value, size_t bytes) {
    for (size_t i = 0; i < bytes; i++)
        at[i] = (uint8_t)(value >> (8 * i));
    return at + bytes;
}

static inline uint8_t *rc_put8(uint8_t *at, uint8_t value) {
    *at = value;
    return at + 1;
}

static inline uint8_t *rc_put16(uint8_t *at, uint16_t value) {
    at[0] = (uint8_t)value;
    at[1] = (uint8_t)(value >> 8);
    return at + 2;
}

static inline uint8_t *rc_put_i16(uint8_t *at, int16_t value) {
    return rc_put16(at, (uint16_t)value);
}

static inline uint8_t *rc_put24(uint8_t *at, uint32_t value) {
    return rc_put8(rc_put16(at, (uint16_t)value), (uint8_t)(value >> 16));
}

static inline uint8_t *rc_put32(uint8_t *at, uint32_t value) {
    return rc_put16(rc_put16(at, (uint16_t)value), (uint16_t)(value >> 16));
}

static inline uint8_t *rc_put48(uint8_t *at, uint64_t value) {
    return rc_put16(rc_put32(at, (uint32_t)value), (uint16_t)(value >> 32));
}

static inline uint8_t *rc_put64(uint8_t *at, uint64_t value) {
    return rc_put32(rc_put32(at, (uint32_t)value), (uint32_t)(value >> 32));
}

static inline uint8_t *rc_put_bytes(uint8_t *at, const uint8_t *bytes, size_t n) {
    memcpy(at, bytes, n);
    return at + n;
}

static inline uint8_t *rc_put_crumbs(uint8_t *at, const uint8_t *values, size_t count) {
    for (size_t i = 0; i < count; i += 4) {
        unsigned byte = 0;
        for (size_t k = i; k < count && k < i + 4; k++)
            byte |= (values[k] & 3u) << (2 * (k - i));
        *at++ = (uint8_t)byte;
    }
    return at;
}

/* Readers advance *at. */
static inline uint64_t rc_take(const uint8_t **at, size_t bytes) {
    uint64_t value = 0;
    for (size_t i = 0; i < bytes; i++)
        value |= (uint64_t)(*at)[i] << (8 * i);
    *at += bytes;
    return value;
}

static inline uint8_t rc_take8(const uint8_t **at) {
    return *(*at)++;
}

static inline uint16_t rc_take16(const uint8_t **at) {
    const uint8_t *from = *at;
    *at += 2;
    return (uint16_t)(from[0] | from[1] << 8);
}

static inline int16_t rc_take_i16(const uint8_t **at) {
    uint16_t raw = rc_take16(at);
    return (int16_t)(raw < 0x8000 ? raw : raw - 0x10000);
}

static inline uint32_t rc_take24(const uint8_t **at) {
    uint32_t low = rc_take16(at);
    return low | (uint32_t)rc_take8(at) << 16;
}

static inline uint32_t rc_take32(const uint8_t **at) {
    uint32_t low = rc_take16(at);
    return low | (uint32_t)rc_take16(at) << 16;
}

static inline uint64_t rc_take48(const uint8_t **at) {
    uint64_t low = rc_take32(at);
    return low | (uint64_t)rc_take16(at) << 32;
}

static inline uint64_t rc_take64(const uint8_t **at) {
    uint64_t low = rc_take32(at);
    return low | (uint64_t)rc_take32(at) << 32;
}

/* A bitmap of 1 .. 64 bits. Eight bytes are read, whatever they are. */
static inline uint64_t rc_take_bits(const uint8_t **at, unsigned bits) {
    const uint8_t *from = *at;
    *at += (bits + 7) / 8;
    return rc_take64(&from) & UINT64_MAX >> (64 - bits);
}

static inline void rc_take_bytes(const uint8_t **at, uint8_t *bytes, size_t n) {
    memcpy(bytes, *at, n);
    *at += n;
}

/* `count` bits or crumbs of `width` bits fill their bytes from below: is the rest of the last byte zero? */
static inline bool rc_rest_is_zero(const uint8_t *from, size_t count, unsigned width) {
    size_t bits = count * width;
    return bits % 8 == 0 || from[bits / 8] >> (bits % 8) == 0;
}

static inline void rc_take_crumbs(const uint8_t **at, uint8_t *values, size_t count) {
    for (size_t i = 0; i < count; i++)
        values[i] = ((*at)[i / 4] >> (2 * (i % 4))) & 3u;
    *at += (count + 3) / 4;
}

#endif
