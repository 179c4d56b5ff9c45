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
        *at++ = (uint8_t)(value >> (8 * i));
    return at;
}

static inline uint8_t *rc_put8(uint8_t *at, uint8_t value) {
    *at = value;
    return at + 1;
}

static inline uint8_t *rc_put16(uint8_t *at, uint16_t value) {
    return rc_put(at, value, 2);
}

static inline uint8_t *rc_put_i16(uint8_t *at, int16_t value) {
    return rc_put16(at, (uint16_t)value);
}

static inline uint8_t *rc_put32(uint8_t *at, uint32_t value) {
    return rc_put(at, value, 4);
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
    return (uint16_t)rc_take(at, 2);
}

static inline int16_t rc_take_i16(const uint8_t **at) {
    uint16_t raw = rc_take16(at);
    return (int16_t)(raw < 0x8000 ? raw : raw - 0x10000);
}

static inline uint32_t rc_take32(const uint8_t **at) {
    return (uint32_t)rc_take(at, 4);
}

static inline void rc_take_bytes(const uint8_t **at, uint8_t *bytes, size_t n) {
    memcpy(bytes, *at, n);
    *at += n;
}

/* False when bits behind the last crumb are set. */
static inline bool rc_take_crumbs(const uint8_t **at, uint8_t *values, size_t count) {
    size_t bytes = (count + 3) / 4;
    for (size_t i = 0; i < count; i++)
        values[i] = ((*at)[i / 4] >> (2 * (i % 4))) & 3u;
    bool clean = count % 4 == 0 || (*at)[bytes - 1] >> (2 * (count % 4)) == 0;
    *at += bytes;
    return clean;
}

#endif
