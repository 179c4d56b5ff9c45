/* The parts of a radio's memory as bytes for the flash: a version, then the values, little-endian.
 *
 * Each part stands alone: one that is missing, of another version or damaged leaves what the memory held. */
#ifndef KEEP_H
#define KEEP_H

#include "radio_core.h"

enum { KEEP_MAX_BYTES = 1 + 4 * RC_MAX_ROBOTS + RC_OPERATORS * (RC_MAC_BYTES + 4) };

/* part: RC_KEEP_IDENTITY, RC_KEEP_PEERS or RC_KEEP_STOP. The length; out holds KEEP_MAX_BYTES. */
size_t keep_encode(const rc_memory *memory, unsigned part, uint8_t *out);
bool keep_decode(rc_memory *memory, unsigned part, const uint8_t *bytes, size_t n);

#endif
