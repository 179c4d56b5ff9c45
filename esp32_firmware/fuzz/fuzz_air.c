/* Frames from the air at a radio without a key and at one whose seal opens everything.
 *
 * Input: of each frame its length, the last byte of the sender's MAC, the time since the last one in ms, its
 * bytes. */
#include "radios.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static rc_radio open, keyed;
    uint8_t mac[RC_MAC_BYTES] = {2};
    uint64_t now_us = 400000;
    fuzz_start(&open, false, 3);
    fuzz_start(&keyed, true, 3);
    while (size >= 3) {
        size_t n = data[0] < size - 3 ? data[0] : size - 3;
        mac[5] = data[1];
        now_us += data[2] * 1000u;
        /* Copies of exactly the frame's size: a byte read behind it is found. */
        uint8_t *frame = malloc(n > 0 ? n : 1);
        memcpy(frame, data + 3, n);
        rc_air_rx(&open, now_us, -50, mac, frame, n);
        rc_air_rx(&keyed, now_us, -50, mac, frame, n);
        free(frame);
        fuzz_send(&open, now_us);
        fuzz_send(&keyed, now_us);
        data += 3 + n;
        size -= 3 + n;
    }
    fuzz_check_host(&open);
    fuzz_check_host(&keyed);
    return 0;
}
