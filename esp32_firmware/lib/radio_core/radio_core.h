/* The radio core: bytes from USB and frames from the air in, bytes for USB and frames for the air out.
 *
 * Pure C11: the caller owns the struct and the clock (now_us, monotonic since boot); no globals, no malloc,
 * no ESP-IDF. Not thread-safe: one task owns a radio. Decides when what is sent, what is passed on, what is
 * relayed and flooded, and what is dropped; knows no driver, no flash and no cipher.
 */
#ifndef RADIO_CORE_H
#define RADIO_CORE_H

#include "cobs.h"
#include "fleet_time.h"
#include "frame.h"
#include "link.h"
#include "peers.h"
#include "relay_table.h"
#include "schedule.h"
#include "seal.h"
#include "stop.h"

/* cdef: begin */
enum {
    RC_IN_FLIGHT_TIMEOUT_US = 50000, /* the driver's callback can stay away */
    RC_STATUS_PERIOD_US = 1000000,
    RC_STATE_ROUNDS = 1 /* a STATE that waited longer is not sent */
};

/* Parts of rc_memory, for rc_dirty and rc_kept. */
enum { RC_KEEP_IDENTITY = 1, RC_KEEP_BOOT = 2, RC_KEEP_PEERS = 4, RC_KEEP_STOP = 8 };

typedef struct {
    uint8_t mac[RC_MAC_BYTES];
    uint32_t boot; /* 0: this place is free */
} rc_operator;

/* All that outlives a reboot. The shell loads it, counts the boot, stores the counter, and hands it over. */
typedef struct {
    /* RC_KEEP_IDENTITY */
    rc_identity identity; /* robot RC_NO_ROBOT adopts what the first Hello names, unless there is a key */
    rc_schedule schedule;
    uint8_t rate_mbps;
    uint8_t provisioned, keyed;
    uint8_t key[RC_KEY_BYTES];
    /* RC_KEEP_BOOT */
    uint32_t boot_counter; /* of this boot */
    /* RC_KEEP_PEERS */
    uint32_t peer_boots[RC_MAX_ROBOTS]; /* highest heard; 0: never */
    rc_operator operators[RC_OPERATORS];
    /* RC_KEEP_STOP */
    uint16_t stop_counter, stop_resumed;
} rc_memory;

typedef struct {
    rc_about about;
    rc_memory memory;
    bool boot_kept;    /* the boot counter of this boot was stored before now */
    uint32_t sequence; /* numbers used already in this boot: 0 after a reset */
    rc_cipher cipher;  /* all NULL where no key will ever be used */
} rc_config;

typedef struct rc_radio rc_radio;

size_t rc_size(void); /* sizeof(rc_radio); align as for uint64_t */
/* An empty flash: listens only, fleet 1, channel 1, 100 ms, 5 slots, 6 Mbit/s, OPEN. */
void rc_memory_init(rc_memory *memory);
/* now_us: the caller's clock at this moment. Values in config.memory that cannot be are replaced by the empty
 * ones. */
void rc_init(rc_radio *rc, uint64_t now_us, const rc_config *config);

void rc_usb_rx(rc_radio *rc, uint64_t now_us, const uint8_t *bytes, size_t n);
void rc_air_rx(rc_radio *rc, uint64_t now_us, int8_t rssi_dbm, const uint8_t *mac, const uint8_t *frame,
               size_t n);
/* The driver is done with the frame in flight; ok: it was put on the air. */
void rc_air_done(rc_radio *rc, uint64_t now_us, bool ok);
/* Time passes; call it when rc_next_us() says so, and before rc_air_tx. */
void rc_tick(rc_radio *rc, uint64_t now_us);
/* The earliest time at which rc_tick or rc_air_tx has work, if nothing comes in before. */
uint64_t rc_next_us(const rc_radio *rc, uint64_t now_us);
/* The shell lost this many messages between radio and host. */
void rc_lost(rc_radio *rc, uint32_t messages);
/* The STOP button was held. */
void rc_button(rc_radio *rc, uint64_t now_us);

/* Whole framed messages for the host, as many as fit; cap >= RC_LINK_MAX_ENCODED. 0: none. */
size_t rc_usb_tx(rc_radio *rc, uint8_t *out, size_t cap);
/* The next frame for the air into out[RC_MAX_FRAME]; 0: nothing is due, or one is still in flight. */
size_t rc_air_tx(rc_radio *rc, uint64_t now_us, uint8_t *out);

/* Which parts of the memory have changed and must be stored; the shell writes them and then says how it went.
 * A sequence number that runs out, and a provisioning, wait for that answer. */
unsigned rc_dirty(const rc_radio *rc);
void rc_kept(rc_radio *rc, unsigned parts, bool ok);
/* A provisioning was stored and answered: restart once the host has the answer (rc_usb_tx gives nothing
 * more). */
bool rc_wants_restart(const rc_radio *rc);

const rc_memory *rc_memory_of(const rc_radio *rc);
/* The shell could not tune to the channel: name the one in use. */
void rc_channel_is(rc_radio *rc, uint8_t channel);
rc_counters rc_counters_of(const rc_radio *rc);
rc_condition rc_condition_of(const rc_radio *rc, uint64_t now_us);
/* cdef: end */

#include "outbox.h"
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
    uint32_t salt;     /* of this radio's pseudo-random choices */
    unsigned dirty;    /* parts of the memory that have to be stored */
    unsigned unkept;   /* parts that could not be stored: dirty again with the next status */
    bool boot_ready;   /* the boot counter in use is stored */
    bool passive;      /* another radio has our id */
    bool provisioning; /* the host waits for the answer */
    bool keep_failed;  /* a part of it could not be stored */
    bool restart;
    uint8_t tuned;            /* the channel in use */
    uint64_t listen_until_us; /* own time */
    uint64_t next_status_us;
    uint32_t round;          /* of fleet time, present */
    bool round_told;         /* the host was told that this round was observed */
    uint64_t turn_used;      /* 3 * round + phase + 1 of our last slotted frame */
    uint64_t state_since_us; /* since when the STATE waits */
    uint64_t state_round;    /* of our last STATE, + 1: one a round */
    uint64_t tasks_since_us; /* since when TASKS wait */
    rc_cobs_decoder from_host;
    rc_ring to_host;
    rc_outbox outbox;
    rc_fleet_time time;
    rc_relay_table relay;
    rc_stop_latch stop;
    rc_peer peers[RC_MAX_ROBOTS];
    rc_peer operators[RC_OPERATORS];
};

#endif
