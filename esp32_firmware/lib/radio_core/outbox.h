/* Bodies that wait for the air: a latest-wins mailbox for STATE, a short queue for the others.
 *
 * STOP and RESUME go first, then STATE, then the queue in order. */
#ifndef RC_OUTBOX_H
#define RC_OUTBOX_H

#include "frame.h"

enum { RC_QUEUE_LENGTH = 8 };

typedef struct {
    uint8_t kind;
    uint8_t length;
    uint8_t bytes[RC_MAX_BODY];
} rc_body;

typedef struct {
    bool state_waiting;
    uint8_t urgent; /* how many bodies at the head of the queue are STOP or RESUME */
    uint8_t count;
    rc_body state;
    rc_body queue[RC_QUEUE_LENGTH];
} rc_outbox;

typedef enum {
    RC_QUEUED,
    RC_REPLACED, /* an unsent STATE was overwritten */
    RC_LOST      /* no room: this body, or for STOP and RESUME the last other one, is gone */
} rc_queued;

/* n <= RC_MAX_BODY */
rc_queued rc_outbox_put(rc_outbox *outbox, uint8_t kind, const uint8_t *body, size_t n);

/* False: nothing waits. */
bool rc_outbox_take(rc_outbox *outbox, rc_body *body);

#endif
