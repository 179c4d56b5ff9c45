/* Prints what the compiler made of the structs that cross the binding: name, size, then offset of each last
 * field. */
#include <stdio.h>

#include "radio_core.h"

#define SHOW(type, last) printf(#type " %zu %zu\n", sizeof(type), offsetof(type, last))

int main(void) {
    SHOW(rc_header, fleet_time_us);
    SHOW(rc_claim, eta_ds);
    SHOW(rc_state, stop_counter);
    SHOW(rc_relay_row, costs);
    SHOW(rc_relay, rows);
    SHOW(rc_task, z_cm);
    SHOW(rc_tasks, slots);
    SHOW(rc_stop, reason);
    SHOW(rc_cobs_decoder, buffer);
    SHOW(rc_identity, channel);
    SHOW(rc_hello, identity);
    SHOW(rc_send, length);
    SHOW(rc_about, git_hash);
    SHOW(rc_counters, usb_bad_checksums);
    SHOW(rc_condition, flags);
    SHOW(rc_config, identity);
    return 0;
}
