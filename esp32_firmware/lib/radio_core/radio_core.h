/* The radio core: bytes from USB and frames from the air in, bytes for USB and frames for the air out.
 *
 * Pure C11: the caller owns the struct and the clock (now_us, monotonic since boot); no globals, no malloc,
 * no ESP-IDF. Not thread-safe: one task owns a radio. Decides what is sent next, what is passed on and what
 * is dropped; knows no driver. Fleet time, slots, relay, encryption and flooding are not here yet.
 */
#ifndef RADIO_CORE_H
#define RADIO_CORE_H

#include "cobs.h"
#include "frame.h"
#include "link.h"

/* cdef: begin */
enum {
    RC_IN_FLIGHT_TIMEOUT_US = 50000, /* the driver's callback can stay away */
    RC_STATUS_PERIOD_US = 1000000,
    RC_FLAG_OPEN = 1 /* no fleet key */
};

typedef struct {
    rc_about about;
    rc_identity identity; /* as stored; robot RC_NO_ROBOT adopts what the first Hello names */
} rc_config;

typedef struct rc_radio rc_radio;

size_t rc_size(void); /* sizeof(rc_radio); align as for uint64_t */
void rc_init(rc_radio *rc, const rc_config *config);

void rc_usb_rx(rc_radio *rc, uint64_t now_us, const uint8_t *bytes, size_t n);
void rc_air_rx(rc_radio *rc, uint64_t now_us, int8_t rssi_dbm, const uint8_t *frame, size_t n);
/* The driver is done with the frame in flight; ok: it was put on the air. */
void rc_air_done(rc_radio *rc, uint64_t now_us, bool ok);
/* Time passes; call at least every 10 ms. */
void rc_tick(rc_radio *rc, uint64_t now_us);
/* The shell lost this many messages between radio and host. */
void rc_lost(rc_radio *rc, uint32_t messages);

/* Whole framed messages for the host, as many as fit; cap >= RC_LINK_MAX_ENCODED. 0: none. */
size_t rc_usb_tx(rc_radio *rc, uint8_t *out, size_t cap);
/* The next frame for the air into out[RC_MAX_FRAME]; 0: nothing to send, or one is still in flight. */
size_t rc_air_tx(rc_radio *rc, uint64_t now_us, uint8_t *out);

rc_identity rc_identity_of(const rc_radio *rc);
rc_counters rc_counters_of(const rc_radio *rc);
/* cdef: end */

#include "outbox.h"
#include "peers.h"
#include "ring.h"

typedef struct {
    bool up;
    uint8_t kind;
    uint32_t sequence;
    uint64_t since_us;
} rc_flight;

struct rc_radio {
    rc_config config;
    rc_counters counters;
    rc_flight flight;
    uint32_t sequence; /* of the last frame taken for the air */
    uint64_t next_status_us;
    rc_cobs_decoder from_host;
    rc_ring to_host;
    rc_outbox outbox;
    rc_peer peers[RC_MAX_ROBOTS];
};

#endif
