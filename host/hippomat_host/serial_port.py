"""Open a serial device for one process alone: raw 8N1, never blocking. Knows termios, no protocol.

Light on purpose: the motor guard starts with it. Works on USB serial adapters and on pseudo-terminals, which
have no control lines (TIOCMBIC answers ENOTTY) and keep TIOCEXCL beyond our death, so they only get the lock.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import glob
import os
import struct
import termios

from hippomat_core.errors import PortError

STABLE_NAMES = ("/dev/hippomat-radio", "/dev/hippomat-base", "/dev/hippomat-lidar")
_PATTERNS = ("/dev/ttyACM*", "/dev/ttyUSB*")
BAUD = 115_200  # base and lidar
RADIO_BAUD = 921_600  # a radio behind a UART bridge (hal_uart.c); USB has no speed
_SPEEDS = {BAUD: termios.B115200, RADIO_BAUD: termios.B921600}
_PSEUDO = "/dev/pts/"
_DTR = struct.pack("I", termios.TIOCM_DTR)


class BusyPort(PortError):
    """Another process has the port; `owner` is its pid and command, where known (a guard's: the daemon)."""

    def __init__(self, path: str, owner: tuple[int, str] | None) -> None:
        owner = self.owner = owner and _answerable(*owner)
        if owner is None:
            super().__init__(
                f"{path} is in use by another process (of another user?): see `sudo fuser {path}`"
            )
        else:
            pid, command = owner
            who = f"process {pid} ({command[:80]})"
            super().__init__(f"{path} is in use by {who}: stop it first, e.g. `kill {pid}`")


def present_ports() -> list[str]:
    """Serial devices of this machine: USB serial ports, and the stable names that udev rules gave them."""
    named = [path for path in STABLE_NAMES if os.path.exists(path)]
    return [*named, *sorted(path for pattern in _PATTERNS for path in glob.glob(pattern))]


def open_port(path: str, baud: int = BAUD) -> int:
    """A file descriptor of `path`, ours alone; raises PortError in one line that says what to do."""
    try:
        fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        raise _why_not(path, error) from None
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        set_raw(fd, baud)
        _alone(fd)
    except BlockingIOError:
        os.close(fd)
        raise BusyPort(path, owner_of(path)) from None
    except termios.error:
        os.close(fd)
        raise PortError(f"{path} is not a serial port; {existing_ports()}") from None
    except OSError as error:
        os.close(fd)
        raise PortError(f"{path} cannot be used: {error.strerror or error}") from None
    return fd


def set_raw(fd: int, baud: int) -> None:
    """Raw 8N1 at this speed from now on. Raises termios.error where `fd` is no serial port."""
    attributes = termios.tcgetattr(fd)
    control = attributes[6]
    control[termios.VMIN], control[termios.VTIME] = 1, 0  # with 0, "nothing yet" reads like a hang-up
    # CLOCAL: no modem. No HUPCL: closing must neither reset the ESP32 nor start a lidar's motor.
    flags = termios.CS8 | termios.CREAD | termios.CLOCAL
    raw = [0, 0, flags, 0, _SPEEDS[baud], _SPEEDS[baud], control]
    termios.tcsetattr(fd, termios.TCSANOW, raw)  # TCSAFLUSH would drop what is already there


def set_speed(fd: int, baud: int) -> None:
    """Another speed for a port that is open; raises OSError once the device is gone."""
    try:
        set_raw(fd, baud)
    except termios.error as error:
        raise OSError(*error.args) from None


def motor_on(fd: int) -> None:
    """Let a lidar's motor run: its adapter stops the motor while DTR is set, and opening sets it."""
    _control(fd, termios.TIOCMBIC)


def motor_off(fd: int) -> None:
    """Stop a lidar's motor; it stays off after close because HUPCL is cleared."""
    _control(fd, termios.TIOCMBIS)


def read_port(fd: int, limit: int = 4096) -> bytes:
    """What is there, b"" for nothing yet; raises OSError once the device is gone."""
    try:
        data = os.read(fd, limit)
    except BlockingIOError:
        return b""
    if not data:  # end of file: the other side hung up
        raise OSError(errno.EIO, "the device went away")
    return data


def write_port(fd: int, data: bytes) -> int:
    """How many bytes the port took; raises OSError once the device is gone."""
    try:
        return os.write(fd, data)
    except BlockingIOError:
        return 0


def existing_ports() -> str:
    """For the end of a message: which ports there are."""
    ports = present_ports()
    return f"ports that exist: {', '.join(ports)}" if ports else "no serial port is plugged in"


def owner_of(path: str) -> tuple[int, str] | None:
    """(pid, command) of another process that has locked or opened `path`, where /proc lets us see it."""
    device, own = os.path.realpath(path), str(os.getpid())
    locker = _locker(device)
    if locker is not None and locker != own:
        return int(locker), _command(locker)
    if device.startswith(_PSEUDO):
        return None
    for directory in glob.glob("/proc/[0-9]*/fd"):
        pid = directory.split("/")[2]
        with contextlib.suppress(OSError):
            if pid != own and any(_names(f"{directory}/{fd}", device) for fd in os.listdir(directory)):
                return int(pid), _command(pid)
    return None


def _locker(device: str) -> str | None:
    """The process that holds a lock on `device`: `1: FLOCK ADVISORY WRITE pid major:minor:inode 0 EOF`."""
    with contextlib.suppress(OSError), open("/proc/locks", encoding="ascii") as locks:
        inode = str(os.stat(device).st_ino)
        filesystem = os.stat(device).st_dev
        place = f"{os.major(filesystem):02x}:{os.minor(filesystem):02x}:{inode}"
        for line in locks:
            fields = line.split()
            if place in fields and "FLOCK" in fields:
                return fields[fields.index(place) - 1]
    return None


def _names(link: str, device: str) -> bool:
    try:
        return os.readlink(link) == device
    except OSError:  # closed between listing and reading
        return False


def _command(pid: str) -> str:
    try:
        with open(f"/proc/{pid}/cmdline", "rb") as file:
            return file.read().replace(b"\0", b" ").decode(errors="replace").strip() or "?"
    except OSError:
        return "?"


def _answerable(pid: int, command: str) -> tuple[int, str]:
    """A motor guard obeys its daemon alone, and is started anew when it dies: the daemon is to be stopped."""
    if "hippomat_host.base_guard" in command:
        with contextlib.suppress(OSError, ValueError), open(f"/proc/{pid}/stat", encoding="ascii") as file:
            parent = file.read().rpartition(")")[2].split()[1]
            if parent not in ("0", "1", str(os.getpid())):
                return int(parent), _command(parent)
    return pid, command


def _why_not(path: str, error: OSError) -> PortError:
    if error.errno in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return PortError(f"{path} does not exist; {existing_ports()}")
    if error.errno == errno.EACCES:
        remedy = "join its group: `sudo usermod -aG dialout $USER`, then log in again"
        return PortError(f"{path}: no permission; {remedy}")
    if error.errno == errno.EBUSY:
        return BusyPort(path, owner_of(path))
    return PortError(f"{path} cannot be opened: {error.strerror or error}")


def _alone(fd: int) -> None:
    """Keep others out of a real device, and refuse to share it with one who ignores locks."""
    device = os.ttyname(fd)
    if not device.startswith(_PSEUDO):  # there the device itself holds the other end open
        fcntl.ioctl(fd, termios.TIOCEXCL)
        if owner_of(device) is not None:
            raise BlockingIOError


def _control(fd: int, request: int) -> None:
    try:
        fcntl.ioctl(fd, request, _DTR)
    except OSError as error:
        if error.errno not in (errno.ENOTTY, errno.EINVAL):
            raise
