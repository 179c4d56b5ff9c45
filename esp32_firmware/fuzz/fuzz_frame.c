/* One air frame, header and plain body: what decodes encodes to the same bytes. */
#include <stdlib.h>
#include <string.h>

#include "frame.h"

static size_t encoded(const rc_header *header, const uint8_t *body, size_t n, uint8_t *out) {
    union {
        rc_state state;
        rc_relay relay;
        rc_tasks tasks;
        rc_stop stop;
    } scratch;
    switch (header->kind) {
    case RC_STATE:
        return rc_state_decode(body, n, &scratch.state) ? rc_state_encode(&scratch.state, out) : 0;
    case RC_RELAY:
        return rc_relay_decode(body, n, &scratch.relay) ? rc_relay_encode(&scratch.relay, out) : 0;
    case RC_TASKS:
        return rc_tasks_decode(body, n, &scratch.tasks) ? rc_tasks_encode(&scratch.tasks, out) : 0;
    default:
        return rc_stop_decode(body, n, &scratch.stop) ? rc_stop_encode(&scratch.stop, out) : 0;
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    rc_header header;
    bool valid = rc_frame_valid(data, size);
    if (!rc_header_decode(data, size, &header)) {
        if (valid)
            abort();
        return 0;
    }
    uint8_t again[RC_HEADER_BYTES + RC_MAX_BODY];
    if (rc_header_encode(&header, again) != RC_HEADER_BYTES || memcmp(again, data, RC_HEADER_BYTES) != 0)
        abort();
    size_t n = size - RC_HEADER_BYTES;
    size_t length = encoded(&header, data + RC_HEADER_BYTES, n, again);
    if ((length > 0) != valid || (valid && (length != n || memcmp(again, data + RC_HEADER_BYTES, n) != 0)))
        abort();
    return 0;
}
