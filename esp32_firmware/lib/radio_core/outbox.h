/* Bodies from the host that wait for the air: a latest-wins mailbox for STATE, a short queue for TASKS. */
#ifndef RC_OUTBOX_H
#define RC_OUTBOX_H

#include "frame.h"

enum { RC_QUEUE_LENGTH = 8 };

typedef struct {
    uint8_t length;
    uint8_t bytes[RC_MAX_BODY];
} rc_body;

typedef struct {
    bool state_waiting;
    uint8_t first, count; /* of the queue, a ring */
    rc_body state;
    rc_body queue[RC_QUEUE_LENGTH];
} rc_outbox;

typedef enum {
    RC_QUEUED,
    RC_REPLACED, /* an unsent STATE was overwritten */
    RC_LOST      /* the queue is full */
} rc_queued;

/* kind: RC_STATE or RC_TASKS; n <= RC_MAX_BODY */
rc_queued rc_outbox_put(rc_outbox *outbox, uint8_t kind, const uint8_t *body, size_t n);

/* The length of what waited, written to body[RC_MAX_BODY]; 0: nothing did. */
size_t rc_outbox_take_state(rc_outbox *outbox, uint8_t *body);
size_t rc_outbox_take_tasks(rc_outbox *outbox, uint8_t *body);

#endif
