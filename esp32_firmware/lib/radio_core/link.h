/* Messages on the USB link, each in one frame of cobs.h; byte tables in README.md.
 *
 * The radio decodes what a host sends and encodes what a host receives. The same in Python, both ways:
 * host/hippomat_core/wire/link.py. */
#ifndef RC_LINK_H
#define RC_LINK_H

#include "frame.h"
#include "schedule.h"
#include "seal.h"

/* cdef: begin */
enum {
    RC_LINK_VERSION = 2,
    RC_NO_ROBOT = 255, /* listens; sends only what an operator may: TASKS, STOP, RESUME */
    RC_MAX_CHANNEL = 14,
    RC_HELLO_BYTES = 8,
    RC_PROVISION_BYTES = 27,
    RC_REPLY_BYTES = 51,
    RC_STATUS_BYTES = 147,
    RC_HEARD_HEAD_BYTES = 18,
    RC_ROUND_BYTES = 30,
    RC_PEER_BYTES = 27
};

enum {
    RC_LINK_HELLO = 0x01,
    RC_LINK_SEND = 0x02,
    RC_LINK_PROVISION = 0x03,
    RC_LINK_COMMAND = 0x04,
    RC_LINK_ASK_PEERS = 0x05,
    RC_LINK_HELLO_REPLY = 0x81,
    RC_LINK_STATUS = 0x82,
    RC_LINK_HEARD = 0x83,
    RC_LINK_SENT = 0x84,
    RC_LINK_PROVISIONED = 0x85,
    RC_LINK_PEER = 0x86,
    RC_LINK_ROUND = 0x87
};

/* Status.flags and HelloReply.flags */
enum {
    RC_FLAG_OPEN = 1,        /* no fleet key: frames are neither encrypted nor authenticated */
    RC_FLAG_AGREED = 2,      /* fleet time is agreed with somebody */
    RC_FLAG_PASSIVE = 4,     /* another radio sends under our id: sends nothing but STOP and RESUME */
    RC_FLAG_STOPPED = 8,     /* a STOP is latched */
    RC_FLAG_UNSAFE = 16,     /* the boot counter could not be stored: a radio with a key stays silent */
    RC_FLAG_PROVISIONED = 32 /* identity was provisioned or adopted and is stored */
};

/* Who a radio is. robot: 0..63, or RC_NO_ROBOT. */
typedef struct {
    uint8_t robot, fleet, channel;
} rc_identity;

typedef struct {
    uint8_t link_version;
    rc_identity identity;
    rc_schedule schedule;
} rc_hello;

typedef struct {
    uint8_t kind;        /* RC_STATE or RC_TASKS; everything else is made by the radio */
    const uint8_t *body; /* inside the payload that was decoded */
    size_t length;
} rc_send;

/* Written once, at a desk. The radio stores it, answers, and restarts. */
typedef struct {
    uint8_t link_version;
    rc_identity identity;
    uint8_t rate_mbps; /* 6, 12 or 24 */
    uint8_t keyed;     /* 0: OPEN, and key is all zeros; 1: it is not */
    uint8_t key[RC_KEY_BYTES];
    uint32_t unix_s; /* now; seeds the boot counter */
} rc_provision;

/* kind RC_STOP: raise; counter 0, the radio chooses it. RC_RESUME: answer the STOP of that counter. */
typedef struct {
    uint8_t kind;
    uint16_t counter;
    uint8_t reason;
} rc_command;

typedef struct {
    uint32_t boot_id;     /* random, new at each boot */
    uint8_t reset_reason; /* esp_reset_reason() */
    uint8_t mac[RC_MAC_BYTES];
    char firmware[16]; /* printable ASCII, zeros behind */
    char git_hash[8];
} rc_about;

typedef struct {
    uint32_t sent, received;
    uint32_t relays;          /* of those sent */
    uint32_t replaced;        /* STATE overwritten in the mailbox before it was sent */
    uint32_t send_failed;     /* given up: not sent, queue full, not allowed, or no identity to send under */
    uint32_t dropped_foreign; /* other protocol version or fleet */
    uint32_t dropped_malformed;
    uint32_t dropped_seal;     /* sealed without our having a key, or the other way round */
    uint32_t dropped_forged;   /* the tag is wrong */
    uint32_t dropped_replayed; /* heard before, or of an older boot */
    uint32_t dropped_impostor; /* another radio under the id of one that is alive */
    uint32_t dropped_babble;   /* of a sender with too many frames */
    uint32_t dropped_usb;      /* messages lost between radio and host, either way */
    uint32_t usb_skipped_bytes, usb_bad_checksums;
} rc_counters;

/* The changing part of a status. Bitmaps by robot id. */
typedef struct {
    uint64_t uptime_us, fleet_time_us;
    uint16_t flags;
    uint16_t stop_counter, stop_resumed;
    uint64_t alive;    /* heard within 3 s */
    uint64_t rebooted; /* since the last status */
    uint64_t babbling, duplicate;
} rc_condition;

typedef struct {
    uint8_t robot; /* RC_OPERATOR for operators' radios */
    uint8_t mac[RC_MAC_BYTES];
    uint32_t boot, sequence;
    int8_t rssi_dbm;
    uint32_t age_ms;
    uint32_t received;
    uint8_t loss;  /* of the link from it to us, 1/255 */
    uint8_t flags; /* 1 alive, 2 babbling, 4 duplicate */
} rc_peer_report;

bool rc_identity_valid(const rc_identity *identity);
bool rc_rate_valid(uint8_t rate_mbps);
bool rc_hello_decode(const uint8_t *payload, size_t n, rc_hello *hello);
bool rc_send_decode(const uint8_t *payload, size_t n, rc_send *send);
bool rc_provision_decode(const uint8_t *payload, size_t n, rc_provision *provision);
bool rc_command_decode(const uint8_t *payload, size_t n, rc_command *command);
bool rc_ask_peers_decode(const uint8_t *payload, size_t n);

/* Each writes a payload (out holds RC_LINK_MAX_PAYLOAD bytes) and returns its length. */
size_t rc_reply_encode(const rc_about *about, uint32_t boot_counter, const rc_identity *identity,
                       const rc_schedule *schedule, uint8_t rate_mbps, uint16_t flags, uint8_t *out);
size_t rc_status_encode(const rc_about *about, uint32_t boot_counter, const rc_identity *identity,
                        const rc_schedule *schedule, uint8_t rate_mbps, const rc_condition *condition,
                        const rc_counters *counters, uint8_t *out);
/* frame: header and plain body, n <= RC_MAX_FRAME - RC_TAG_BYTES; 0 if longer or no frame. */
size_t rc_heard_encode(uint64_t radio_time_us, uint64_t fleet_time_us, int8_t rssi_dbm, const uint8_t *frame,
                       size_t n, uint8_t *out);
size_t rc_sent_encode(uint64_t radio_time_us, uint8_t kind, uint32_t sequence, bool sent, uint8_t *out);
size_t rc_provisioned_encode(bool stored, uint32_t boot_counter, uint8_t *out);
size_t rc_peer_encode(const rc_peer_report *peer, uint8_t *out);
/* held: rows of this round that the radio holds, relayed ones and its own included. */
size_t rc_round_encode(uint32_t round, uint64_t fleet_time_us, uint64_t radio_time_us, uint64_t held,
                       bool agreed, uint8_t *out);
/* cdef: end */

#endif
