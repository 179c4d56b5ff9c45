"""The real shell around the real core on a fake chip: start, memory, provisioning, channel."""

from __future__ import annotations

import random

import pytest
from chip import KEY, UNIX_S, Chip, hello, identity_in_flash, keyed_flash, sealed, send_state, status_of
from radio_desk import frame_of, mac_of

from hippomat_core.wire import codec, link
from hippomat_core.wire import frames as air


def boot_of(flash: dict[str, bytes]) -> int:
    return int.from_bytes(flash["boot"], "little")


# ---- start ---------------------------------------------------------------------------------------


def test_an_empty_chip_counts_its_boot_and_listens(chip):
    new = chip().boot(1000)
    status = status_of(new)
    assert (status.robot, status.channel, status.boot_counter) == (link.NO_ROBOT, 1, 1)
    assert status.flags == link.FLAG_OPEN
    assert (status.firmware, status.reset_reason) == ("hippomat 0.1.0", 1)
    assert new.sent() == []
    assert new.flash == {"boot": (1).to_bytes(4, "little")}


def test_it_broadcasts_at_6_mbit_ofdm_without_power_save_above_all_other_tasks(chip):
    new = chip().boot()
    assert {"power save 0", "rate: phymode 2, rate 11", "task radio: priority 24, core 1"} <= set(new.lines)


@pytest.mark.parametrize(("mbps", "code"), [(6, 11), (12, 10), (24, 9)])
def test_the_rate_in_flash_is_the_rate_on_the_air(chip, mbps, code):
    provisioned = chip({"identity": identity_in_flash(rate_mbps=mbps, provisioned=True)}).boot()
    assert f"rate: phymode 2, rate {code}" in provisioned.lines
    assert status_of(provisioned).rate_mbps == mbps


def test_each_boot_is_stored_before_anything_is_sent_and_named_in_the_frames(chip):
    flash = {"identity": identity_in_flash()}
    for boot in (1, 2, 3):
        radio = chip(flash).boot(400)
        send_state(radio)
        (_, frame), *_ = radio.sent()
        assert codec.decode_header(frame).boot == boot == boot_of(radio.flash)
        assert radio.index("stored") < radio.index("espnow starts") < radio.index("sent")
        flash = radio.flash


# ---- a boot counter that cannot be kept ----------------------------------------------------------


def test_a_radio_with_a_key_sends_sealed_frames(chip):
    radio = chip(keyed_flash()).boot(400)
    send_state(radio)
    (_, frame), *_ = radio.sent()
    assert frame[0] & 8
    assert codec.decode_header(frame).boot == 1_700_000_001


@pytest.mark.parametrize("broken", ["commit", "set boot", "get boot"])
def test_a_radio_with_a_key_stays_silent_when_its_boot_is_not_stored(chip, broken):
    radio = chip(keyed_flash(), broken).boot(400)
    send_state(radio)
    assert radio.sent() == []
    assert status_of(radio).flags & link.FLAG_UNSAFE


def test_a_radio_with_a_key_and_no_boot_counter_does_not_begin_at_one_again(chip):
    radio = chip({"identity": identity_in_flash(key=KEY)}).boot(400)
    send_state(radio)
    assert radio.sent() == []
    assert status_of(radio).flags & link.FLAG_UNSAFE
    assert "boot" not in radio.flash


@pytest.mark.parametrize("broken", ["init", "commit"])
def test_an_open_radio_without_flash_works_under_a_random_boot_counter(chip, broken):
    radio = chip({}, broken).boot()
    radio.host(hello())
    radio.run_ms(400)
    send_state(radio)
    (_, frame), *_ = radio.sent()
    assert codec.decode_header(frame).boot > 1000
    assert radio.flash == {}


def test_a_partition_that_other_firmware_left_is_erased(chip):
    radio = chip({"boot": b"\x09\0\0\0"}, "full").boot()
    assert ["hippomat"] in radio.said("erased")
    assert boot_of(radio.flash) == 1


# ---- memory --------------------------------------------------------------------------------------


def test_an_adopted_identity_is_stored_once_and_known_after_a_reboot(chip):
    radio = chip().boot()
    for _ in range(3):
        radio.host(hello(robot=7, channel=6))
        radio.run_ms(50)
    assert [key for _, key, _ in radio.said("stored")] == ["boot", "identity"]
    assert radio.flash["identity"] == identity_in_flash(7, channel=6)
    again = chip(radio.flash).boot()
    status = status_of(again)
    assert (status.robot, status.channel, status.boot_counter) == (7, 6, 2)
    assert ["6"] in again.said("channel")


@pytest.mark.parametrize("damaged", ["identity", "stop", "peers"])
def test_each_part_of_a_damaged_flash_is_replaced_alone(chip, damaged):
    whole = {
        "identity": identity_in_flash(9),
        "stop": bytes([1, 2, 0, 0, 0]),
        "peers": bytes([1]) + bytes(296),
    }
    rng = random.Random(damaged)
    for bad in (b"", b"\0", whole[damaged][:-1], b"\x02" + whole[damaged][1:], rng.randbytes(297)):
        status = status_of(chip(whole | {damaged: bad}).boot())
        assert status.robot == (link.NO_ROBOT if damaged == "identity" else 9)
        assert bool(status.flags & link.FLAG_STOPPED) == (damaged != "stop")


def test_whatever_the_flash_holds_the_radio_starts_and_answers(chip):
    rng = random.Random(1)
    for _ in range(30):
        flash = {
            "identity": b"\x01" + rng.randbytes(25),
            "stop": b"\x01" + rng.randbytes(4),
            "peers": b"\x01" + rng.randbytes(296),
            "boot": rng.randbytes(rng.choice((3, 4, 4, 4))),
        }
        radio = chip(flash).boot()
        radio.host(hello())
        radio.run_ms(20)
        (reply,) = radio.messages(link.HelloReply)
        assert 1 <= reply.channel <= 14


def resume(sender: int, sequence: int, boot: int) -> bytes:
    return frame_of(sender, sequence, air.StopFrame(0, 255, 0), kind=air.RESUME, boot=boot)


def test_thirty_new_peers_cost_one_write_to_the_flash(chip):
    radio = chip(keyed_flash()).boot()
    for robot in [r for r in range(31) if r != 3]:
        radio.hear(mac_of(robot), sealed(resume(robot, 1, UNIX_S + robot)))
        radio.run_ms(3)
    assert "peers" not in radio.flash
    radio.run_ms(5000)
    assert [key for _, key, _ in radio.said("stored")] == ["boot", "peers"]
    peers = radio.flash["peers"]
    assert int.from_bytes(peers[1 + 4 * 30 :][:4], "little") == UNIX_S + 30
    again = chip(radio.flash).boot()
    again.hear(mac_of(30), sealed(resume(30, 5, UNIX_S + 29)))
    assert status_of(again).dropped_replayed == 1


# ---- provisioning --------------------------------------------------------------------------------


def provision(on: Chip, robot: int = 3, key: bytes = KEY) -> None:
    on.host(link.Provision(link.LINK_VERSION, robot, 7, 6, 12, key, UNIX_S))


def test_a_provisioning_is_stored_then_answered_then_the_radio_restarts_with_it(chip):
    radio = chip().boot()
    radio.messages()
    provision(radio)
    radio.run_ms(1000)
    assert not radio.alive
    assert radio.messages(link.Provisioned) == [link.Provisioned(True, UNIX_S)]
    assert [key for _, key, _ in radio.said("stored")] == ["boot", "boot", "identity", "stop", "peers"]
    assert radio.lines[-2:] == ["flushed, 0 bytes left", f"restart {radio.said('restart')[0][0]}"]
    assert [i for i, line in enumerate(radio.lines) if line.startswith("stored")][-1] < len(radio.lines) - 3
    status = status_of(chip(radio.flash).boot())
    assert (status.robot, status.fleet, status.channel, status.rate_mbps) == (3, 7, 6, 12)
    assert (status.boot_counter, status.flags) == (UNIX_S + 1, link.FLAG_PROVISIONED)


@pytest.mark.parametrize(("broken", "kept"), [("set boot", []), ("commit", []), ("set identity", ["boot"])])
def test_a_provisioning_that_cannot_be_stored_is_answered_so_and_leaves_no_key_behind(chip, broken, kept):
    radio = chip().boot()
    radio.messages()
    radio.tell(f"break {broken}")
    provision(radio)
    radio.run_ms(1000)
    assert not radio.alive
    assert [answer.stored for answer in radio.messages(link.Provisioned)] == [False]
    assert [key for _, key, _ in radio.said("stored")][1:] == kept
    assert "identity" not in radio.flash


def test_a_host_that_is_gone_does_not_keep_the_radio_from_its_restart(chip):
    radio = chip().boot()
    radio.tell("closed")
    radio.run_ms(8000)
    provision(radio)
    radio.run_ms(2000)
    assert not radio.alive
    assert "identity" in radio.flash


# ---- the channel ---------------------------------------------------------------------------------


def test_a_channel_that_the_region_forbids_stays_a_wish_and_the_status_names_the_one_in_use(chip):
    radio = chip().boot()
    radio.host(hello(robot=5, channel=13))
    status = status_of(radio)
    assert (status.robot, status.channel) == (5, 1)
    assert radio.flash["identity"] == identity_in_flash(5, channel=13)


def test_a_forbidden_channel_in_flash_does_not_keep_the_radio_from_starting(chip):
    radio = chip({"identity": identity_in_flash(channel=13)}).boot()
    assert status_of(radio).channel == 1
    assert len([line for line in radio.lines if "13 is not available" in line]) == 1
