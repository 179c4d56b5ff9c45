/* The radio core on this machine: `pio test -e native`, or `make firmware-native` where PlatformIO cannot
 * fetch Unity. The long tests are in tests/firmware (pytest). */
#include <string.h>
#include <unity.h>

#include "radio_core.h"

enum { ROBOT = 3, LISTENED_US = 310000 };

static rc_radio radio;
static uint8_t out[RC_LINK_MAX_ENCODED];
static const uint8_t OURS[RC_MAC_BYTES] = {2, 0, 0, 0, 0, 3};
static const uint8_t THEIRS[RC_MAC_BYTES] = {2, 0, 0, 0, 0, 5};

static rc_config a_robot(void) {
    rc_config config = {.about = {.boot_id = 1}, .boot_kept = true};
    memcpy(config.about.mac, OURS, RC_MAC_BYTES);
    rc_memory_init(&config.memory);
    config.memory.identity.robot = ROBOT;
    config.memory.boot_counter = 7;
    return config;
}

void setUp(void) {
    rc_config config = a_robot();
    rc_init(&radio, 0, &config);
}

void tearDown(void) {
}

static void host_sends(const uint8_t *payload, size_t n) {
    uint8_t framed[RC_LINK_MAX_ENCODED];
    rc_usb_rx(&radio, LISTENED_US, framed, rc_cobs_encode(payload, n, framed));
}

static size_t host_sends_state(void) {
    uint8_t payload[RC_LINK_MAX_PAYLOAD] = {RC_LINK_SEND, RC_STATE};
    rc_state state = {.claim = {.slot = RC_NO_SLOT}, .n = 5, .m = 3};
    size_t n = rc_state_encode(&state, payload + 2);
    host_sends(payload, n + 2);
    return n;
}

/* The next frame from now_us on, or 0 if none comes within 200 ms. */
static size_t next_frame(uint64_t *now_us, uint8_t *frame) {
    for (uint64_t until_us = *now_us + 200000; *now_us < until_us;
         *now_us = rc_next_us(&radio, *now_us + 1)) {
        rc_tick(&radio, *now_us);
        size_t n = rc_air_tx(&radio, *now_us, frame);
        if (n > 0)
            return n;
    }
    return 0;
}

static void hear_stop(uint32_t sequence, uint16_t counter) {
    uint8_t frame[RC_HEADER_BYTES + RC_STOP_BYTES];
    rc_header header = {.kind = RC_STOP, .fleet = 1, .sender = 5, .boot = 1, .sequence = sequence};
    rc_stop stop = {.counter = counter, .origin = 5};
    rc_header_encode(&header, frame);
    rc_stop_encode(&stop, frame + RC_HEADER_BYTES);
    rc_air_rx(&radio, LISTENED_US, -50, THEIRS, frame, sizeof frame);
}

static void test_a_state_goes_out_in_the_slot_of_its_robot(void) {
    uint8_t frame[RC_MAX_FRAME];
    uint64_t now_us = LISTENED_US;
    rc_header header;
    size_t body = host_sends_state();
    TEST_ASSERT_EQUAL_UINT(RC_HEADER_BYTES + body, next_frame(&now_us, frame));
    TEST_ASSERT_TRUE(rc_header_decode(frame, RC_HEADER_BYTES, &header));
    TEST_ASSERT_EQUAL_UINT(ROBOT, header.sender);
    TEST_ASSERT_EQUAL_UINT(7, header.boot);
    rc_schedule schedule = {.round_ms = 100, .slots = 5};
    uint64_t late_us = header.fleet_time_us % 100000 % rc_slot_us(&schedule);
    TEST_ASSERT_TRUE(late_us <= RC_SLOT_LATEST_US);
}

static void test_a_radio_listens_before_it_sends(void) {
    uint8_t frame[RC_MAX_FRAME];
    uint64_t now_us = 0;
    host_sends_state();
    TEST_ASSERT_EQUAL_UINT(0, next_frame(&now_us, frame));
}

static void test_a_frame_without_a_callback_is_given_up_in_time(void) {
    uint8_t frame[RC_MAX_FRAME];
    uint64_t now_us = LISTENED_US;
    host_sends_state();
    TEST_ASSERT_TRUE(next_frame(&now_us, frame) > 0);
    rc_tick(&radio, now_us + RC_IN_FLIGHT_TIMEOUT_US);
    TEST_ASSERT_EQUAL_UINT(1, rc_counters_of(&radio).send_failed);
}

static void test_the_same_frame_twice_is_passed_on_once(void) {
    hear_stop(9, 1);
    hear_stop(9, 1);
    TEST_ASSERT_EQUAL_UINT(1, rc_counters_of(&radio).received);
    TEST_ASSERT_EQUAL_UINT(1, rc_counters_of(&radio).dropped_replayed);
}

static void test_a_stop_that_was_heard_is_latched_stored_and_flooded(void) {
    uint8_t frame[RC_MAX_FRAME];
    uint64_t now_us = LISTENED_US;
    hear_stop(9, 4);
    TEST_ASSERT_TRUE((rc_condition_of(&radio, now_us).flags & RC_FLAG_STOPPED) != 0);
    TEST_ASSERT_EQUAL_UINT(RC_KEEP_STOP, rc_dirty(&radio));
    TEST_ASSERT_EQUAL_UINT(4, rc_memory_of(&radio)->stop_counter);
    TEST_ASSERT_EQUAL_UINT(RC_HEADER_BYTES + RC_STOP_BYTES, next_frame(&now_us, frame));
}

static void test_the_button_raises_a_stop(void) {
    rc_button(&radio, LISTENED_US);
    TEST_ASSERT_TRUE((rc_condition_of(&radio, LISTENED_US).flags & RC_FLAG_STOPPED) != 0);
    TEST_ASSERT_TRUE(rc_condition_of(&radio, LISTENED_US).stop_counter <= RC_STOP_STEP);
}

static void test_a_provisioning_is_answered_once_it_is_stored(void) {
    uint8_t payload[RC_PROVISION_BYTES] = {RC_LINK_PROVISION, RC_LINK_VERSION, 4, 7, 6, 12, 1, 0x5e};
    while (rc_usb_tx(&radio, out, sizeof out) > 0)
        continue;
    payload[RC_PROVISION_BYTES - 1] = 0x68; /* unix_s, its highest byte */
    host_sends(payload, sizeof payload);
    TEST_ASSERT_EQUAL_UINT(0, rc_usb_tx(&radio, out, sizeof out));
    TEST_ASSERT_EQUAL_UINT(RC_KEEP_IDENTITY | RC_KEEP_BOOT | RC_KEEP_PEERS | RC_KEEP_STOP, rc_dirty(&radio));
    TEST_ASSERT_EQUAL_UINT(0x68000000, rc_memory_of(&radio)->boot_counter);
    rc_kept(&radio, rc_dirty(&radio), true);
    TEST_ASSERT_TRUE(!rc_wants_restart(&radio));
    TEST_ASSERT_TRUE(rc_usb_tx(&radio, out, sizeof out) > 0);
    TEST_ASSERT_TRUE(rc_wants_restart(&radio));
}

static void test_a_key_without_a_stored_boot_counter_means_silence(void) {
    uint8_t frame[RC_MAX_FRAME];
    uint64_t now_us = LISTENED_US;
    rc_config config = a_robot();
    config.memory.keyed = 1;
    config.boot_kept = false;
    rc_init(&radio, 0, &config);
    host_sends_state();
    TEST_ASSERT_EQUAL_UINT(0, next_frame(&now_us, frame));
    TEST_ASSERT_TRUE((rc_condition_of(&radio, now_us).flags & RC_FLAG_UNSAFE) != 0);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_state_goes_out_in_the_slot_of_its_robot);
    RUN_TEST(test_a_radio_listens_before_it_sends);
    RUN_TEST(test_a_frame_without_a_callback_is_given_up_in_time);
    RUN_TEST(test_the_same_frame_twice_is_passed_on_once);
    RUN_TEST(test_a_stop_that_was_heard_is_latched_stored_and_flooded);
    RUN_TEST(test_the_button_raises_a_stop);
    RUN_TEST(test_a_provisioning_is_answered_once_it_is_stored);
    RUN_TEST(test_a_key_without_a_stored_boot_counter_means_silence);
    return UNITY_END();
}
