/* Many radios and the least of a host for each, driven through a stretch of simulated time in one call.
 *
 * For benchmarks and tests of whole fleets on a PC, where a call per reception from Python would take longer
 * than the reception; no part of the firmware. Times are the world's, in microseconds; each radio has its own
 * clock. A stretch must be shorter than a frame's airtime: then nothing that is sent in it can be heard in
 * it. */
#ifndef FLEET_DRIVER_H
#define FLEET_DRIVER_H

#include "radio_core.h"

/* cdef: begin */
enum { FD_STATIONS = 64, FD_INBOX = 96, FD_ROUNDS = 512 };

typedef struct {
    int64_t at_us;
    int8_t rssi_dbm;
    uint8_t sender, length; /* sender: a station */
    uint8_t frame[RC_MAX_FRAME];
} fd_arrival;

typedef struct {
    rc_radio *radio; /* NULL: off */
    uint8_t mac[RC_MAC_BYTES];
    int64_t boot_us;
    double rate;                       /* own microseconds per microsecond */
    uint64_t fleet_us;                 /* after its last event */
    uint32_t steps_back;               /* of fleet time, since the fleet began */
    int64_t stopped_us;                /* when its STOP was latched; INT64_MAX: none is */
    int64_t tick_us, left_us, host_us; /* when each is due; INT64_MAX: not */
    bool host_up;
    uint8_t robot, n, m; /* what its host says in STATE */
    uint32_t states;     /* sent by its host */
    uint16_t waiting;
    fd_arrival inbox[FD_INBOX]; /* by time */
} fd_station;

typedef struct {
    uint8_t station, length;
    int64_t at_us;
    uint8_t frame[RC_MAX_FRAME];
} fd_send;

/* What a host was told at the end of a round's observation. */
typedef struct {
    uint8_t station, agreed;
    uint8_t wrong; /* rows held of this round that are not what their robot sent */
    uint32_t round;
    uint64_t held;
    int64_t at_us;
} fd_round;

typedef struct {
    uint32_t answer_min_us, answer_span_us; /* how long a host takes from a Round to its STATE */
    fd_station stations[FD_STATIONS];
    uint16_t send_count, round_count; /* the caller empties both lists */
    fd_send sends[FD_STATIONS];
    fd_round rounds[FD_ROUNDS];
    uint32_t overruns; /* arrivals, sends or rounds that found no room: a mistake of the caller */
} fd_fleet;

void fd_init(fd_fleet *fleet);
/* radio: initialised at own time 0 = boot_us; NULL: the station is off from now on. */
void fd_boot(fd_fleet *fleet, uint8_t station, rc_radio *radio, int64_t boot_us, double rate);
/* The station's host answers each round with the STATE of that robot. */
void fd_host(fd_fleet *fleet, uint8_t station, uint8_t robot, uint8_t n, uint8_t m);
/* A transmission of `sender` ended and will reach `count` receivers. */
void fd_ended(fd_fleet *fleet, uint8_t sender, int64_t at_us, const uint8_t *frame, uint8_t length,
              size_t count, const int64_t *receivers, const int64_t *arrivals_us, const int8_t *rssi_dbm);
void fd_usb(fd_fleet *fleet, uint8_t station, int64_t at_us, const uint8_t *bytes, size_t n);
/* When some station has work. */
int64_t fd_next_us(const fd_fleet *fleet);
/* Everything up to and with until_us. */
void fd_advance(fd_fleet *fleet, int64_t until_us);
/* Fleet time of every station at at_us, not before its last event; -1 for those that are off. */
void fd_fleet_times(const fd_fleet *fleet, int64_t at_us, int64_t *fleet_us);
/* cdef: end */

#endif
