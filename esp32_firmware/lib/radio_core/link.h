/* Messages on the USB link, each in one frame of cobs.h; byte tables in README.md.
 *
 * The radio decodes what a host sends and encodes what a host receives. The same in Python, both ways:
 * host/hippomat_core/wire/link.py. */
#ifndef RC_LINK_H
#define RC_LINK_H

#include "frame.h"

/* cdef: begin */
enum {
    RC_LINK_VERSION = 1,
    RC_NO_ROBOT = 255,
    RC_MAX_CHANNEL = 14,
    RC_REPLY_BYTES = 45,
    RC_STATUS_BYTES = 54
};

enum {
    RC_LINK_HELLO = 0x01,
    RC_LINK_SEND = 0x02,
    RC_LINK_HELLO_REPLY = 0x81,
    RC_LINK_STATUS = 0x82,
    RC_LINK_HEARD = 0x83,
    RC_LINK_SENT = 0x84
};

/* Who a radio is. robot: 0..63, or RC_NO_ROBOT: listens only, never transmits. */
typedef struct {
    uint8_t robot, fleet, channel;
} rc_identity;

typedef struct {
    uint8_t link_version;
    rc_identity identity;
} rc_hello;

typedef struct {
    uint8_t kind;
    const uint8_t *body; /* inside the payload that was decoded */
    size_t length;
} rc_send;

typedef struct {
    uint32_t boot_id;      /* random, new at each boot */
    uint32_t boot_counter; /* kept over boots, travels in every header */
    uint8_t reset_reason;  /* esp_reset_reason() */
    uint8_t mac[6];
    char firmware[16]; /* printable ASCII, zeros behind */
    char git_hash[8];
} rc_about;

typedef struct {
    uint32_t sent, received;
    uint32_t replaced;    /* STATE overwritten in the mailbox before it was sent */
    uint32_t send_failed; /* given up: not sent, queue full, or no identity to send under */
    uint32_t dropped_foreign, dropped_malformed, dropped_duplicate;
    uint32_t dropped_usb; /* messages lost between radio and host, either way */
    uint32_t usb_skipped_bytes, usb_bad_checksums;
} rc_counters;

typedef struct {
    uint64_t uptime_us;
    uint8_t flags; /* bit 0: OPEN (no key), bit 1: fleet time agreed */
} rc_condition;

bool rc_identity_valid(const rc_identity *identity);
bool rc_hello_decode(const uint8_t *payload, size_t n, rc_hello *hello);
bool rc_send_decode(const uint8_t *payload, size_t n, rc_send *send);

/* Each writes a payload (out holds RC_LINK_MAX_PAYLOAD bytes) and returns its length. */
size_t rc_reply_encode(const rc_about *about, const rc_identity *identity, uint8_t *out);
size_t rc_status_encode(const rc_about *about, const rc_identity *identity, const rc_condition *condition,
                        const rc_counters *counters, uint8_t *out);
size_t rc_heard_encode(uint64_t radio_time_us, int8_t rssi_dbm, const uint8_t *frame, size_t n, uint8_t *out);
size_t rc_sent_encode(uint64_t radio_time_us, uint8_t kind, uint32_t sequence, bool sent, uint8_t *out);
/* cdef: end */

#endif
