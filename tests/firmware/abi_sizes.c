/* Prints what the compiler made of the structs that cross the binding: name, size, offset of a last field. */
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
    SHOW(rc_cipher, open);
    SHOW(rc_schedule, slots);
    SHOW(rc_turn, latest_us);
    SHOW(rc_identity, channel);
    SHOW(rc_hello, schedule);
    SHOW(rc_send, length);
    SHOW(rc_provision, unix_s);
    SHOW(rc_command, reason);
    SHOW(rc_about, git_hash);
    SHOW(rc_counters, usb_bad_checksums);
    SHOW(rc_condition, duplicate);
    SHOW(rc_peer_report, flags);
    SHOW(rc_fleet_time, jumps);
    SHOW(rc_relay_table, rows);
    SHOW(rc_peer, second_us);
    SHOW(rc_stop_latch, changed);
    SHOW(rc_operator, boot);
    SHOW(rc_memory, stop_resumed);
    SHOW(rc_config, cipher);
    return 0;
}
