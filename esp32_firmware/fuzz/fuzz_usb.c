/* Bytes from the host, at once and byte by byte: both radios must say and send the same. */
#include "radios.h"

static void compare(rc_radio *whole, rc_radio *pieces, uint64_t now_us) {
    static uint8_t one[RC_RING_BYTES], other[RC_RING_BYTES];
    fuzz_send(whole, now_us);
    fuzz_send(pieces, now_us);
    rc_counters a = rc_counters_of(whole), b = rc_counters_of(pieces);
    if (memcmp(&a, &b, sizeof a) != 0)
        abort();
    size_t n = rc_usb_tx(whole, one, sizeof one);
    if (n != rc_usb_tx(pieces, other, sizeof other) || memcmp(one, other, n) != 0)
        abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static rc_radio whole, pieces;
    uint8_t robot = size > 0 && data[0] & 1 ? 3 : RC_NO_ROBOT;
    fuzz_start(&whole, false, robot);
    fuzz_start(&pieces, false, robot);
    rc_usb_rx(&whole, 0, data, size);
    for (size_t i = 0; i < size; i++)
        rc_usb_rx(&pieces, 0, data + i, 1);
    for (uint64_t now_us = 0; now_us < 600000; now_us += 7000)
        compare(&whole, &pieces, now_us);
    fuzz_check_host(&whole);
    return 0;
}
