#include "fleet_driver.h"

#include <string.h>

#include "bytes.h"

enum { ROUND_HELD_AT = 21 }; /* in a Round message: type, round, two times */

static uint64_t own_us(const fd_station *station, int64_t at_us) {
    return (uint64_t)((double)(at_us - station->boot_us) * station->rate);
}

/* The first time at which the station's clock shows own. */
static int64_t world_us(const fd_station *station, uint64_t own) {
    int64_t at_us = station->boot_us + (int64_t)((double)own / station->rate);
    while (own_us(station, at_us) < own)
        at_us++;
    return at_us;
}

void fd_init(fd_fleet *fleet) {
    memset(fleet, 0, sizeof *fleet);
    for (size_t i = 0; i < FD_STATIONS; i++)
        fleet->stations[i].tick_us = fleet->stations[i].left_us = fleet->stations[i].host_us =
            fleet->stations[i].stopped_us = INT64_MAX;
}

void fd_boot(fd_fleet *fleet, uint8_t number, rc_radio *radio, int64_t boot_us, double rate) {
    fd_station *station = &fleet->stations[number];
    station->radio = radio;
    station->boot_us = boot_us;
    station->rate = rate;
    station->fleet_us = 0;
    station->waiting = 0;
    station->host_up = false;
    station->left_us = station->host_us = station->stopped_us = INT64_MAX;
    station->tick_us = radio ? boot_us : INT64_MAX;
    if (radio)
        memcpy(station->mac, radio->config.about.mac, RC_MAC_BYTES);
}

void fd_host(fd_fleet *fleet, uint8_t number, uint8_t robot, uint8_t n, uint8_t m) {
    fd_station *station = &fleet->stations[number];
    station->host_up = true;
    station->robot = robot;
    station->n = n;
    station->m = m;
}

/* ---- the host ----------------------------------------------------------------------------------------- */

/* Where the robot itself is in the same round and has one station only, its row is known. */
static uint8_t wrong_rows(const fd_fleet *fleet, const rc_relay_table *held) {
    uint8_t wrong = 0;
    for (size_t i = 0; i < FD_STATIONS; i++) {
        const fd_station *owner = &fleet->stations[i];
        if (!owner->radio || !owner->host_up || owner->robot != i || !(held->held >> i & 1))
            continue;
        const rc_relay_table *own = &owner->radio->relay;
        if (own->round == held->round && own->held >> i & 1)
            wrong += memcmp(own->rows[i], held->rows[i], RC_RELAY_ROW_BYTES + (size_t)held->m) != 0;
    }
    return wrong;
}

static void on_round(fd_fleet *fleet, fd_station *station, int64_t at_us, const uint8_t *payload) {
    if (fleet->round_count == FD_ROUNDS) {
        fleet->overruns++;
        return;
    }
    const uint8_t *round_at = payload + 1, *held_at = payload + ROUND_HELD_AT;
    fd_round *told = &fleet->rounds[fleet->round_count++];
    told->station = (uint8_t)(station - fleet->stations);
    told->at_us = at_us;
    told->round = rc_take32(&round_at);
    told->held = rc_take(&held_at, 8);
    told->agreed = *held_at;
    told->wrong = wrong_rows(fleet, &station->radio->relay);
    if (station->host_up)
        station->host_us = at_us + fleet->answer_min_us +
                           rc_noise(station->robot, told->round) % (fleet->answer_span_us + 1);
}

/* Only Round is opened: the others come too often. The type is the byte behind the first COBS code. */
static void on_message(fd_fleet *fleet, fd_station *station, int64_t at_us, const uint8_t *framed, size_t n) {
    if (n < 2 || framed[1] != RC_LINK_ROUND)
        return;
    rc_cobs_decoder decoder = {0};
    for (size_t i = 0; i < n; i++)
        if (rc_cobs_push(&decoder, framed[i]) == RC_ROUND_BYTES)
            on_round(fleet, station, at_us, decoder.buffer);
}

static void read_usb(fd_fleet *fleet, fd_station *station, int64_t at_us) {
    uint8_t bytes[4096];
    size_t n;
    while ((n = rc_usb_tx(station->radio, bytes, sizeof bytes)) > 0)
        for (const uint8_t *at = bytes, *end; at < bytes + n; at = end) {
            const uint8_t *zero = memchr(at, 0, (size_t)(bytes + n - at));
            end = zero ? zero + 1 : bytes + n;
            on_message(fleet, station, at_us, at, (size_t)(end - at));
        }
}

/* A valid STATE that differs from round to round; what it says of STOP is what the radio knows. */
static size_t state_body(fd_station *station, uint8_t *body) {
    const rc_stop_latch *stop = &station->radio->stop;
    rc_state state = {
        .status = 1,
        .flags = rc_stop_latched(stop) ? 1 : 0,
        .x_cm = (int16_t)(rc_noise(station->robot, station->states) % 1000),
        .n = station->n,
        .m = station->m,
        .claim = {.slot = RC_NO_SLOT},
        .fleet_digest = 1,
        .stop_counter = stop->counter,
    };
    for (size_t i = 0; i < station->m; i++)
        state.costs[i] = (uint8_t)rc_noise(station->states, station->robot * 256u + (uint32_t)i);
    return rc_state_encode(&state, body);
}

static void host_answers(fd_station *station, int64_t at_us) {
    uint8_t payload[RC_LINK_MAX_PAYLOAD] = {RC_LINK_SEND, RC_STATE}, framed[RC_LINK_MAX_ENCODED];
    size_t n = 2 + state_body(station, payload + 2);
    station->states++;
    station->host_us = INT64_MAX;
    rc_usb_rx(station->radio, own_us(station, at_us), framed, rc_cobs_encode(payload, n, framed));
}

/* ---- the stations ------------------------------------------------------------------------------------- */

static void note_time(fd_station *station, int64_t at_us) {
    uint64_t fleet_us = rc_fleet_time_at(&station->radio->time, own_us(station, at_us));
    station->steps_back += fleet_us < station->fleet_us;
    station->fleet_us = fleet_us;
}

static void take_send(fd_fleet *fleet, fd_station *station, int64_t at_us) {
    uint8_t frame[RC_MAX_FRAME];
    size_t n = rc_air_tx(station->radio, own_us(station, at_us), frame);
    if (n == 0)
        return;
    if (fleet->send_count == FD_STATIONS) {
        fleet->overruns++;
        return;
    }
    fd_send *send = &fleet->sends[fleet->send_count++];
    send->station = (uint8_t)(station - fleet->stations);
    send->length = (uint8_t)n;
    send->at_us = at_us;
    memcpy(send->frame, frame, n);
}

/* What the shell does after everything else. */
static void settle(fd_fleet *fleet, fd_station *station, int64_t at_us) {
    rc_radio *radio = station->radio;
    uint64_t own = own_us(station, at_us);
    rc_tick(radio, own);
    if (rc_dirty(radio))
        rc_kept(radio, rc_dirty(radio), true);
    take_send(fleet, station, at_us);
    read_usb(fleet, station, at_us);
    note_time(station, at_us);
    if (!rc_stop_latched(&radio->stop))
        station->stopped_us = INT64_MAX;
    else if (station->stopped_us == INT64_MAX)
        station->stopped_us = at_us;
    int64_t tick_us = world_us(station, rc_next_us(radio, own));
    station->tick_us = tick_us > at_us ? tick_us : at_us + 1;
}

static int64_t earlier(int64_t a, int64_t b) {
    return a < b ? a : b;
}

static int64_t next_us(const fd_station *station) {
    if (!station->radio)
        return INT64_MAX;
    int64_t due_us = earlier(station->tick_us, earlier(station->left_us, station->host_us));
    return station->waiting ? earlier(due_us, station->inbox[0].at_us) : due_us;
}

static void hear(const fd_fleet *fleet, fd_station *station) {
    const fd_arrival *first = &station->inbox[0];
    rc_air_rx(station->radio, own_us(station, first->at_us), first->rssi_dbm,
              fleet->stations[first->sender].mac, first->frame, first->length);
    station->waiting--;
    memmove(&station->inbox[0], &station->inbox[1], station->waiting * sizeof station->inbox[0]);
}

static void one_event(fd_fleet *fleet, fd_station *station, int64_t at_us) {
    note_time(station, at_us);
    if (station->left_us == at_us) {
        station->left_us = INT64_MAX;
        rc_air_done(station->radio, own_us(station, at_us), true);
    } else if (station->waiting && station->inbox[0].at_us == at_us) {
        hear(fleet, station);
    } else if (station->host_us == at_us) {
        host_answers(station, at_us);
    }
    settle(fleet, station, at_us);
}

int64_t fd_next_us(const fd_fleet *fleet) {
    int64_t due_us = INT64_MAX;
    for (size_t i = 0; i < FD_STATIONS; i++)
        due_us = earlier(due_us, next_us(&fleet->stations[i]));
    return due_us;
}

void fd_advance(fd_fleet *fleet, int64_t until_us) {
    for (size_t i = 0; i < FD_STATIONS; i++) {
        fd_station *station = &fleet->stations[i];
        for (int64_t at_us; (at_us = next_us(station)) <= until_us;)
            one_event(fleet, station, at_us);
    }
}

static void arrive(fd_fleet *fleet, fd_station *station, const fd_arrival *arrival) {
    if (station->waiting == FD_INBOX) {
        fleet->overruns++;
        return;
    }
    size_t at = station->waiting++;
    for (; at > 0 && station->inbox[at - 1].at_us > arrival->at_us; at--)
        station->inbox[at] = station->inbox[at - 1];
    station->inbox[at] = *arrival;
}

void fd_ended(fd_fleet *fleet, uint8_t sender, int64_t at_us, const uint8_t *frame, uint8_t length,
              size_t count, const int64_t *receivers, const int64_t *arrivals_us, const int8_t *rssi_dbm) {
    fd_arrival arrival = {.sender = sender, .length = length};
    memcpy(arrival.frame, frame, length);
    if (fleet->stations[sender].radio)
        fleet->stations[sender].left_us = at_us;
    for (size_t i = 0; i < count; i++) {
        arrival.at_us = arrivals_us[i];
        arrival.rssi_dbm = rssi_dbm[i];
        fd_station *station = &fleet->stations[receivers[i]];
        if (station->radio && arrivals_us[i] >= station->boot_us)
            arrive(fleet, station, &arrival);
    }
}

void fd_usb(fd_fleet *fleet, uint8_t number, int64_t at_us, const uint8_t *bytes, size_t n) {
    fd_station *station = &fleet->stations[number];
    if (!station->radio)
        return;
    rc_usb_rx(station->radio, own_us(station, at_us), bytes, n);
    settle(fleet, station, at_us);
}

void fd_fleet_times(const fd_fleet *fleet, int64_t at_us, int64_t *fleet_us) {
    for (size_t i = 0; i < FD_STATIONS; i++) {
        const fd_station *station = &fleet->stations[i];
        bool on = station->radio && at_us >= station->boot_us;
        fleet_us[i] = on ? (int64_t)rc_fleet_time_at(&station->radio->time, own_us(station, at_us)) : -1;
    }
}
