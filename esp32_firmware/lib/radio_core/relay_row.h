/* What RELAY carries of a STATE: one robot's row, as bytes. STATE bodies are valid; byte tables: README.md.
 */
#ifndef RC_RELAY_ROW_H
#define RC_RELAY_ROW_H

#include "frame.h"

uint8_t rc_state_n(const uint8_t *state);
uint8_t rc_state_m(const uint8_t *state);
uint64_t rc_state_heard(const uint8_t *state);
uint32_t rc_state_fleet_digest(const uint8_t *state, size_t length);
/* RC_RELAY_ROW_BYTES + M bytes, age 0. The ETA is rounded to seconds; 255 are 255 or more. */
void rc_relay_row_put(uint8_t *row, uint8_t robot, const uint8_t *state);

#endif
