/* The radio core on this machine: `pio test -e native`. The long tests are in tests/firmware (pytest). */
#include <string.h>
#include <unity.h>

#include "radio_core.h"

static rc_radio radio;
static uint8_t out[RC_LINK_MAX_ENCODED];
static const uint8_t STOP_BODY[] = {1, 0, 255, 0};

void setUp(void) {
    rc_config config = {
        .about = {.boot_id = 1, .boot_counter = 7},
        .identity = {.robot = 3, .fleet = 1, .channel = 1},
    };
    rc_init(&radio, &config);
}

void tearDown(void) {
}

static void host_sends(uint8_t kind, const uint8_t *body, size_t n) {
    uint8_t payload[RC_LINK_MAX_PAYLOAD] = {RC_LINK_SEND, kind};
    memcpy(payload + 2, body, n);
    rc_usb_rx(&radio, 0, out, rc_cobs_encode(payload, n + 2, out));
}

static void test_a_body_from_the_host_gets_a_header_and_goes_on_the_air(void) {
    uint8_t frame[RC_MAX_FRAME];
    host_sends(RC_STOP, STOP_BODY, sizeof STOP_BODY);
    TEST_ASSERT_EQUAL_UINT(RC_HEADER_BYTES + sizeof STOP_BODY, rc_air_tx(&radio, 5, frame));
    rc_header header;
    TEST_ASSERT_TRUE(rc_header_decode(frame, RC_HEADER_BYTES, &header));
    TEST_ASSERT_EQUAL_UINT(3, header.sender);
    TEST_ASSERT_EQUAL_UINT(7, header.boot);
    TEST_ASSERT_EQUAL_MEMORY(STOP_BODY, frame + RC_HEADER_BYTES, sizeof STOP_BODY);
    TEST_ASSERT_EQUAL_UINT(0, rc_air_tx(&radio, 6, frame));
}

static void test_a_frame_without_a_callback_is_given_up_in_time(void) {
    uint8_t frame[RC_MAX_FRAME];
    host_sends(RC_STOP, STOP_BODY, sizeof STOP_BODY);
    host_sends(RC_STOP, STOP_BODY, sizeof STOP_BODY);
    rc_air_tx(&radio, 0, frame);
    rc_tick(&radio, RC_IN_FLIGHT_TIMEOUT_US);
    TEST_ASSERT_EQUAL_UINT(1, rc_counters_of(&radio).send_failed);
    TEST_ASSERT_TRUE(rc_air_tx(&radio, RC_IN_FLIGHT_TIMEOUT_US, frame) > 0);
}

static void test_the_same_frame_twice_is_passed_on_once(void) {
    uint8_t frame[RC_HEADER_BYTES + RC_STOP_BYTES];
    rc_header header = {.kind = RC_STOP, .fleet = 1, .sender = 5, .boot = 1, .sequence = 9};
    rc_header_encode(&header, frame);
    memcpy(frame + RC_HEADER_BYTES, STOP_BODY, sizeof STOP_BODY);
    rc_air_rx(&radio, 0, -50, frame, sizeof frame);
    rc_air_rx(&radio, 1, -50, frame, sizeof frame);
    TEST_ASSERT_EQUAL_UINT(1, rc_counters_of(&radio).received);
    TEST_ASSERT_EQUAL_UINT(1, rc_counters_of(&radio).dropped_duplicate);
    TEST_ASSERT_TRUE(rc_usb_tx(&radio, out, sizeof out) > 0);
    TEST_ASSERT_EQUAL_UINT(0, rc_usb_tx(&radio, out, sizeof out));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_body_from_the_host_gets_a_header_and_goes_on_the_air);
    RUN_TEST(test_a_frame_without_a_callback_is_given_up_in_time);
    RUN_TEST(test_the_same_frame_twice_is_passed_on_once);
    return UNITY_END();
}
