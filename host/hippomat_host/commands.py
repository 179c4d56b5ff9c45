"""The commands of hippomat-host beside the daemon: their options, help texts and exit codes.

Reads arguments and the clock, opens nothing itself. What a command does is in its own module, imported when
it is called for.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Mapping

from hippomat_core.config import MAX_ROBOTS
from hippomat_core.wire.link import NO_ROBOT, RATES_MBPS
from hippomat_host.options import Parser, UsageError
from hippomat_host.radio_words import STOP_REASONS
from hippomat_host.serial_port import STABLE_NAMES, existing_ports

MAX_CHANNEL = 13  # 14 is for Japan, and not for OFDM
_CODES = """exit codes:
  0  done
  1  wrong usage, or something is missing, busy or does not fit (one line says what)"""
_STOP_CODES = """exit codes:
  0  every robot that is heard {}
  1  wrong usage, no robot is heard, or something is missing, busy or does not fit (one line says what)
  2  some robots that are heard did not show it within 5 s (it says which)"""


def ports(arguments: list[str]) -> int:
    options = _parser("ports", "List the serial ports and what is behind each.")
    options.add_argument("devices", metavar="DEV", nargs="*", help="look at these only")
    args = options.parse_args(arguments)
    from hippomat_host.ports import list_ports

    return list_ports(args.devices)


def make_key(arguments: list[str]) -> int:
    options = _parser(
        "make-key",
        "Make a fresh fleet key: 16 random bytes as 32 hex digits, in a new file that you alone can read.",
        f"The same file goes to every radio of the fleet (hippomat-host provision --key-file).\n\n{_CODES}",
    )
    options.add_argument("file", metavar="FILE", help="is never overwritten")
    path = options.parse_args(arguments).file
    from hippomat_host.key_file import make_key as make

    print(
        f"{path}: a new fleet key, fingerprint {make(path).fingerprint}; whoever has this file has the fleet"
    )
    return 0


def provision(arguments: list[str]) -> int:
    args = _provision_parser().parse_args(arguments)
    path = _port(args.port)
    from hippomat_host.key_file import read_key
    from hippomat_host.provision import Wanted
    from hippomat_host.provision import provision as write

    fleet_key = None if args.open else read_key(args.key_file)
    robot = NO_ROBOT if args.operator else args.robot
    return write(path, Wanted(robot, args.fleet, args.channel, args.rate, fleet_key), time.time())


def _provision_parser() -> Parser:
    options = _parser(
        "provision",
        "Write identity, channel, rate and fleet key into a radio. It restarts and says what it is now.\n"
        "A radio that was written before is written anew, without asking.",
        "examples:\n"
        "  hippomat-host make-key fleet7.key\n"
        "  hippomat-host provision --port DEV --fleet 7 --robot 3 --channel 6 --key-file fleet7.key\n"
        "      robot 3's radio\n"
        "  hippomat-host provision --port DEV --fleet 7 --operator --channel 6 --key-file fleet7.key\n"
        "      a dongle for a laptop: watches, stops and resumes the fleet\n\n" + _CODES,
    )
    _add_port(options)
    options.add_argument(
        "--fleet", metavar="F", type=_number(0, 255), required=True, help="fleet id, 0 .. 255"
    )
    who = options.add_mutually_exclusive_group(required=True)
    who.add_argument(
        "--robot", metavar="N", type=_number(0, MAX_ROBOTS - 1), help=f"robot id, 0 .. {MAX_ROBOTS - 1}"
    )
    who.add_argument("--operator", action="store_true", help="an operator's radio, without a robot")
    channel = _number(1, MAX_CHANNEL)
    options.add_argument("--channel", metavar="C", type=channel, required=True, help="Wi-Fi channel, 1 .. 13")
    key = options.add_mutually_exclusive_group(required=True)
    key.add_argument("--key-file", metavar="FILE", help="the fleet's key (hippomat-host make-key FILE)")
    key.add_argument("--open", action="store_true", help="no key: anyone in range may send, stop and resume")
    same = "Mbit/s on the air, the same in all radios (default: 6)"
    options.add_argument("--rate", type=int, choices=RATES_MBPS, default=RATES_MBPS[0], help=same)
    return options


def radio_info(arguments: list[str]) -> int:
    options = _parser(
        "radio-info",
        "Show everything that a radio says of itself but its key, and whom it hears. Changes nothing.",
        _CODES,
    )
    _add_port(options)
    options.add_argument("--json", action="store_true", help="print JSON")
    args = options.parse_args(arguments)
    path = _port(args.port)
    from hippomat_host.radio_info import radio_info as show

    return show(path, args.json)


def stop(arguments: list[str]) -> int:
    options = _parser(
        "stop",
        "Stop the whole fleet, now, from any radio, until `hippomat-host resume`; then see who shows it.",
        "examples:\n"
        "  hippomat-host stop --port /dev/ttyACM0                          a radio that was provisioned\n"
        "  hippomat-host stop --port /dev/ttyACM0 --fleet 7 --channel 6    a new one, for an OPEN fleet\n\n"
        "Without a computer: hold the BOOT button of any radio for 1 s.\n\n"
        + _STOP_CODES.format("shows STOP"),
    )
    return _stop_or_resume(options, arguments, "stop")


def resume(arguments: list[str]) -> int:
    options = _parser(
        "resume",
        "Let a stopped fleet go on: listens which STOP is in force, answers that one, and sees who goes on.",
        _STOP_CODES.format("goes on, or nothing was stopped"),
    )
    return _stop_or_resume(options, arguments, "resume")


def _stop_or_resume(options: Parser, arguments: list[str], which: str) -> int:
    _add_port(options)
    own = "(default: the radio's own; only a radio that was not provisioned takes another)"
    options.add_argument("--fleet", metavar="F", type=_number(0, 255), default=-1, help=f"fleet id {own}")
    channel = _number(1, MAX_CHANNEL)
    options.add_argument(
        "--channel", metavar="C", type=channel, default=-1, help="its Wi-Fi channel, 1 .. 13"
    )
    names = ", ".join(f"{name} ({code})" for name, code in STOP_REASONS.items())
    travels = f"travels with it and is recorded: {names}, or 0 .. 255"
    options.add_argument("--reason", metavar="NAME|CODE", type=_reason, default=0, help=travels)
    args = options.parse_args(arguments)
    told = (_port(args.port), args.reason, args.fleet, args.channel)
    from hippomat_host import stop_command

    commands = {"stop": stop_command.stop, "resume": stop_command.resume}
    return commands[which](stop_command.Told(*told))


COMMANDS: Mapping[str, Callable[[list[str]], int]] = {
    "ports": ports,
    "make-key": make_key,
    "provision": provision,
    "radio-info": radio_info,
    "stop": stop,
    "resume": resume,
}


def _parser(name: str, description: str, epilog: str = _CODES) -> Parser:
    return Parser(
        prog=f"hippomat-host {name}",
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )


def _add_port(options: Parser) -> None:
    options.add_argument(
        "--port", metavar="DEV", help=f"the radio (default: {STABLE_NAMES[0]}, where udev made it)"
    )


def _port(given: str | None) -> str:
    if given:
        return given
    if os.path.exists(STABLE_NAMES[0]):
        return STABLE_NAMES[0]
    raise UsageError(f"--port is missing: the radio's serial port; {existing_ports()}")


def _number(low: int, high: int) -> Callable[[str], int]:
    def number(text: str) -> int:
        if not (text.isascii() and text.isdigit() and low <= int(text) <= high):
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {low} to {high}")
        return int(text)

    return number


def _reason(text: str) -> int:
    if text in STOP_REASONS:
        return STOP_REASONS[text]
    try:
        return _number(0, 255)(text)
    except argparse.ArgumentTypeError:
        known = ", ".join(STOP_REASONS)
        raise argparse.ArgumentTypeError(f"{text!r} is neither one of {known} nor 0 .. 255") from None
