"""The fleet key's file: 16 bytes as 32 hex digits, readable by its owner alone. Never says what is in it."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import secrets
import stat
from dataclasses import dataclass

from hippomat_core.errors import HippomatError

KEY_BYTES = 16
_FEWEST_VALUES = 6  # of 16 random bytes; fewer: one key in 10^17
_MAX_FILE = 4096


@dataclass(frozen=True, slots=True, repr=False)
class FleetKey:
    """`warning` says who else may read the file, "" where nobody may."""

    key: bytes
    warning: str = ""

    @property
    def fingerprint(self) -> str:
        return fingerprint(self.key)


def fingerprint(key: bytes) -> str:
    """Tells two keys of a lab apart: 16 bits of a hash, which leave an attacker 2^112 keys to try."""
    return hashlib.sha256(b"hippomat fleet key" + key).hexdigest()[:4]


def make_key(path: str) -> FleetKey:
    """A fresh key in a new file; raises HippomatError where the file exists or cannot be written."""
    key = secrets.token_bytes(KEY_BYTES)
    try:
        fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        _fill(fd, path, key)
    except FileExistsError:
        raise HippomatError(
            f"{path} exists: a key is never overwritten (radios may have it): give another name"
        ) from None
    except OSError as error:
        raise HippomatError(
            f"{path} cannot be written: {error.strerror or error}; give another name"
        ) from None
    return FleetKey(key)


def _fill(fd: int, path: str, key: bytes) -> None:
    """Leaves no file behind that holds less than a key."""
    try:
        with os.fdopen(fd, "w", encoding="ascii") as file:
            file.write(key.hex() + "\n")
            file.flush()
            os.fsync(file.fileno())
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(path)
        raise


def read_key(path: str) -> FleetKey:
    """The key in a file; raises HippomatError in one line that quotes nothing of what the file holds."""
    try:
        with open(path, "rb", opener=_at_once) as file:
            mode = os.fstat(file.fileno()).st_mode
            if not stat.S_ISREG(mode):
                raise OSError(errno.EINVAL, "not a regular file")
            data = file.read(_MAX_FILE + 1)
    except OSError as error:
        raise HippomatError(
            f"--key-file {path}: cannot be read: {error.strerror or error}; {_remedy()}"
        ) from None
    return FleetKey(_parsed(path, data), _exposed(path, mode))


def _at_once(path: str, flags: int) -> int:
    """A pipe is opened without waiting for its writer."""
    return os.open(path, flags | os.O_NONBLOCK)


def _parsed(path: str, data: bytes) -> bytes:
    text = data.decode("ascii", errors="replace").strip()
    if len(text) != 2 * KEY_BYTES:
        length = f"more than {_MAX_FILE}" if len(data) > _MAX_FILE else str(len(text))
        raise HippomatError(
            f"--key-file {path}: holds {length} characters, a key is {2 * KEY_BYTES} hex digits; {_remedy()}"
        )
    if not all(digit in "0123456789abcdefABCDEF" for digit in text):
        raise HippomatError(f"--key-file {path}: holds something else than hex digits; {_remedy()}")
    key = bytes.fromhex(text)
    if len(set(key)) < _FEWEST_VALUES:
        raise HippomatError(
            f"--key-file {path}: this key was typed, not drawn: it can be guessed; {_remedy()}"
        )
    return key


def _exposed(path: str, mode: int) -> str:
    if not mode & (stat.S_IRWXG | stat.S_IRWXO):
        return ""
    return f"{path} can be read by others (mode {stat.S_IMODE(mode):04o}): `chmod 600 {path}`"


def _remedy() -> str:
    return "`hippomat-host make-key FILE` makes one"
