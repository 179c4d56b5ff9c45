/* Who sends under which id: MAC, boot, sequence numbers heard, and how much. Decides whether a frame is new,
 * replayed, another radio's under the same id, or one of too many.
 *
 * A sender's frames are counted within a boot from 1; the boot counter only grows (provisioning seeds it from
 * Unix time). Of the present boot a window of 64 sequence numbers is remembered; an older boot is a replay.
 * In an OPEN fleet, where a radio may have lost its counter, an older boot is taken again after RC_DEAD_US of
 * silence. Judge first, accept only what proved authentic. */
#ifndef RC_PEERS_H
#define RC_PEERS_H

#include "seal.h"

/* cdef: begin */
enum {
    RC_DEAD_US = 3000000,
    RC_OPERATORS = 4,     /* operators' radios remembered, by MAC; the longest unheard makes room */
    RC_BABBLE_PER_S = 240 /* frames of one sender in one second; STATE, relays and floods stay below 120 */
};

typedef struct {
    bool known;     /* heard since our boot */
    bool rebooted;  /* has another boot than before; whoever reports it clears it */
    bool duplicate; /* another MAC sent under its id; cleared when it is heard and that is over for RC_DEAD_US
                     */
    bool babbling;  /* more than RC_BABBLE_PER_S frames in this second or the one before */
    uint8_t mac[RC_MAC_BYTES];
    int8_t rssi_dbm;
    uint16_t in_second;
    uint32_t boot;     /* highest that was accepted, kept over our reboot */
    uint32_t sequence; /* highest of that boot heard since our boot */
    uint32_t received;
    uint64_t window; /* bit b: sequence - b was heard */
    uint64_t heard_us;
    uint64_t impostor_us; /* when another MAC was last heard under its id */
    uint64_t second_us;   /* begin of the second that is counted */
} rc_peer;

typedef enum { RC_FRESH, RC_REPLAYED, RC_IMPOSTOR } rc_judgement;

/* keyed: the fleet has a key, so an older boot is never taken. */
rc_judgement rc_peer_judge(const rc_peer *peer, const uint8_t *mac, uint32_t boot, uint32_t sequence,
                           uint64_t now_us, bool keyed);
/* Remembers a frame judged FRESH and, where there is a key, proved authentic. True: its boot is new, so that
 * it should be stored. */
bool rc_peer_accept(rc_peer *peer, const uint8_t *mac, uint32_t boot, uint32_t sequence, int8_t rssi_dbm,
                    uint64_t now_us);
/* An authentic (or, OPEN, any) frame of another MAC came under this id. */
void rc_peer_impostor(rc_peer *peer, uint64_t now_us);
/* Counts a frame that is authentic and new. False: one of too many in this second. */
bool rc_peer_count(rc_peer *peer, uint64_t now_us);
bool rc_peer_alive(const rc_peer *peer, uint64_t now_us);
/* cdef: end */

#endif
