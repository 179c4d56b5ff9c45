#include "shell.h"

#include "button.h"
#include "esp_log.h"
#include "esp_system.h"
#include "esp_timer.h"
#include "freertos/task.h"
#include "hal_board.h"
#include "hal_espnow.h"
#include "hal_nvs.h"
#include "hal_wake.h"
#include "lamp.h"

enum {
    CHUNK = 1024,
    EVENTS_A_STEP = 48,
    PATIENCE_US = 20000,      /* with a host that reads; one that does not is waited for no more */
    PEERS_EVERY_US = 5000000, /* at a fleet's start all peers are new: one write, not thirty */
    FLUSH_MS = 200,
    PARTING_MS = 50
};

_Static_assert(CHUNK >= (int)RC_LINK_MAX_ENCODED, "a chunk holds the longest message");

static const char *const TAG = "radio";

static rc_radio radio;
static QueueHandle_t events;
static const hal_host *host;
static uint64_t core_us;      /* the latest time that the core knows: for it time never goes back */
static uint8_t wished, tuned; /* channels: of the memory, and in use */
static uint64_t peers_stored_us;
static button stop_button;
static lamp_light shown;
static uint64_t lamp_us;

static struct {
    uint8_t bytes[CHUNK];
    size_t length; /* 0: nothing waits */
    uint64_t since_us;
    bool host_reads;
} out;

static uint64_t not_before(uint64_t time_us) {
    if (time_us > core_us)
        core_us = time_us;
    return core_us;
}

static uint64_t now(void) {
    return not_before((uint64_t)esp_timer_get_time());
}

static void take_event(const hal_event *event) {
    if (event->kind == EVENT_HEARD)
        rc_air_rx(&radio, not_before(event->time_us), event->rssi_dbm, event->mac, event->frame,
                  event->length);
    else if (event->kind == EVENT_SENT)
        rc_air_done(&radio, not_before(event->time_us), event->ok);
}

/* Waits for one, then takes what has come meanwhile. */
static void take_events(void) {
    hal_event event;
    TickType_t wait = 1;
    for (int i = 0; i < EVENTS_A_STEP && xQueueReceive(events, &event, wait) == pdTRUE; i++) {
        take_event(&event);
        wait = 0;
    }
    rc_lost(&radio, hal_espnow_take_dropped());
}

static void read_from_host(void) {
    uint8_t chunk[CHUNK];
    size_t n = host->read(chunk, sizeof chunk);
    rc_usb_rx(&radio, now(), chunk, n);
}

static void keep_channel(void) {
    uint8_t wanted = rc_memory_of(&radio)->identity.channel;
    if (wanted == wished)
        return;
    wished = wanted;
    if (hal_espnow_tune(wanted)) {
        tuned = wanted;
    } else {
        ESP_LOGE(TAG, "channel %u is not available here, stays on %u", wanted, tuned);
        rc_channel_is(&radio, tuned);
    }
}

static void send_to_air(void) {
    uint8_t frame[RC_MAX_FRAME];
    if (now() < hal_espnow_free_us())
        return;
    size_t n = rc_air_tx(&radio, now(), frame);
    if (n > 0 && !hal_espnow_send(now(), frame, n))
        rc_air_done(&radio, now(), false);
}

static void keep_memory(void) {
    unsigned parts = rc_dirty(&radio);
    if (parts == RC_KEEP_PEERS && now() < peers_stored_us + PEERS_EVERY_US)
        return;
    if (parts == 0)
        return;
    if (parts & RC_KEEP_PEERS)
        peers_stored_us = now();
    unsigned stored = hal_nvs_store(rc_memory_of(&radio), parts);
    if (stored != parts)
        ESP_LOGE(TAG, "not stored: parts %x of %x", parts & ~stored, parts);
    if (stored)
        rc_kept(&radio, stored, true);
    if (parts & ~stored)
        rc_kept(&radio, parts & ~stored, false);
}

static uint32_t messages_in(const uint8_t *bytes, size_t n) {
    uint32_t messages = 0;
    for (size_t i = 0; i < n; i++)
        messages += bytes[i] == 0;
    return messages;
}

/* What does not fit is offered again for PATIENCE_US, then dropped. A closed port drops at once, so that the
 * next to open it meets little that is stale. */
static void write_to_host(void) {
    if (out.length == 0) {
        out.length = rc_usb_tx(&radio, out.bytes, sizeof out.bytes);
        out.since_us = now();
    }
    if (out.length == 0)
        return;
    if (host->write(out.bytes, out.length)) {
        out.host_reads = true;
    } else {
        if (out.host_reads && now() - out.since_us < PATIENCE_US)
            return;
        out.host_reads = false;
        rc_lost(&radio, messages_in(out.bytes, out.length));
    }
    out.length = 0;
}

static void look_at_button(void) {
    if (button_held(&stop_button, now(), hal_board_pressed()))
        rc_button(&radio, now());
}

static void show_lamp(void) {
    if (now() < lamp_us)
        return;
    lamp_us = now() - now() % LAMP_STEP_US + LAMP_STEP_US;
    uint8_t robot = rc_memory_of(&radio)->identity.robot;
    lamp_light light = lamp_at(lamp_state_of(rc_condition_of(&radio, now()).flags, robot), now());
    bool same = light.on == shown.on && light.red == shown.red && light.green == shown.green &&
                light.blue == shown.blue;
    if (!same)
        hal_board_show(light);
    shown = light;
}

static void restart_if_wanted(void) {
    if (!rc_wants_restart(&radio) || out.length > 0)
        return;
    host->flush(FLUSH_MS);
    vTaskDelay(pdMS_TO_TICKS(PARTING_MS));
    esp_restart();
}

static void set_alarm(void) {
    uint64_t at_us = rc_next_us(&radio, now());
    uint64_t free_us = hal_espnow_free_us();
    hal_wake_at(now(), now() < free_us && at_us < free_us ? free_us : at_us);
}

void shell_start(const rc_config *config, QueueHandle_t queue, const hal_host *port) {
    events = queue;
    host = port;
    tuned = hal_espnow_channel();
    rc_init(&radio, now(), config);
}

void shell_step(void) {
    take_events();
    read_from_host();
    look_at_button();
    rc_tick(&radio, now());
    keep_channel();
    send_to_air();
    keep_memory();
    write_to_host();
    show_lamp();
    restart_if_wanted();
    set_alarm();
}
