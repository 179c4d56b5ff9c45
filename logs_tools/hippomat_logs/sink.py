"""Where a log's bytes go: all or nothing, so that a failed write leaves no garbage in the middle of a file.

A sink collects writes until flush() and then either appends them all or none. Knows files, not records.
"""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Callable, Container
from pathlib import Path
from typing import Protocol

ACTIVE = ".active"
RESERVE_BYTES = 1 << 20  # no new part is begun on a disk with less free space


class Sink(Protocol):
    """What the log writes to. write() never fails; flush(), sync() and finish() raise OSError."""

    def write(self, data: bytes, /) -> int: ...
    def tell(self) -> int: ...
    def flush(self) -> None: ...
    def sync(self) -> None: ...
    def finish(self) -> None: ...
    def abandon(self) -> None: ...
    def discard(self) -> None: ...


SinkOpener = Callable[[str], Sink]


class FileSink:
    """DIRECTORY/NAME.active, locked while open; finish() makes it NAME."""

    def __init__(self, directory: Path, name: str, suffix: str = ACTIVE) -> None:
        space = os.statvfs(directory)
        if space.f_bavail * space.f_frsize < RESERVE_BYTES:
            raise OSError(errno.ENOSPC, "less than 1 MiB free", str(directory))
        self.path = directory / name
        if self.path.exists():
            raise FileExistsError(errno.EEXIST, "a finished log has this name", str(self.path))
        self._active = directory / (name + suffix)
        self._fd = os.open(self._active, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        fcntl.flock(self._fd, fcntl.LOCK_EX)
        if os.fstat(self._fd).st_nlink == 0:  # a recovery found it empty before it was locked
            os.close(self._fd)
            raise FileExistsError(errno.EEXIST, "taken away by a recovery", str(self._active))
        self._written = 0
        self._pending = bytearray()

    def write(self, data: bytes, /) -> int:
        self._pending += data
        return len(data)

    def tell(self) -> int:
        return self._written + len(self._pending)

    def flush(self) -> None:
        done = 0
        try:
            while done < len(self._pending):
                done += os.pwrite(self._fd, memoryview(self._pending)[done:], self._written + done)
        except OSError:
            os.ftruncate(self._fd, self._written)
            raise
        self._written += done
        self._pending = bytearray()

    def sync(self) -> None:
        os.fdatasync(self._fd)

    def finish(self) -> None:
        """Raises FileExistsError where somebody else has made a file of this name in the meantime."""
        self.flush()
        os.fsync(self._fd)
        if self.path.exists():
            raise FileExistsError(errno.EEXIST, "made by somebody else meanwhile", str(self.path))
        os.rename(self._active, self.path)
        sync_directory(self.path.parent)
        os.close(self._fd)
        self._fd = -1

    def abandon(self) -> None:
        """Leave the file as it was after the last good flush; recovery makes a log of it."""
        os.close(self._fd)

    def discard(self) -> None:
        """There shall be no such file, unless it is finished."""
        if self._fd >= 0:
            self._active.unlink(missing_ok=True)
            os.close(self._fd)
            self._fd = -1


class FullDiskSink:
    """A disk on which only `room_bytes` are left: stands in for a full one wherever that must be tried."""

    def __init__(self, inner: Sink, room_bytes: int) -> None:
        self._inner = inner
        self._end = room_bytes

    def write(self, data: bytes, /) -> int:
        return self._inner.write(data)

    def tell(self) -> int:
        return self._inner.tell()

    def flush(self) -> None:
        if self._inner.tell() > self._end:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._inner.flush()

    def sync(self) -> None:
        self._inner.sync()

    def finish(self) -> None:
        self.flush()
        self._inner.finish()

    def abandon(self) -> None:
        self._inner.abandon()

    def discard(self) -> None:
        self._inner.discard()


class PowerCutSink:
    """A page cache that loses what was not synced: stands in for a plug that is pulled at the worst moment.

    cut() leaves the file as a disk would have it that never wrote early.
    """

    def __init__(self, directory: Path, name: str) -> None:
        self._inner = FileSink(directory, name)
        self._path = directory / (name + ACTIVE)
        self._synced = 0

    def write(self, data: bytes, /) -> int:
        return self._inner.write(data)

    def tell(self) -> int:
        return self._inner.tell()

    def flush(self) -> None:
        self._inner.flush()

    def sync(self) -> None:
        self._inner.sync()
        self._synced = self._inner.tell()

    def finish(self) -> None:
        self._inner.finish()

    def abandon(self) -> None:
        self._inner.abandon()

    def discard(self) -> None:
        self._inner.discard()

    def cut(self) -> bytes:
        """What is on the disk now."""
        return self._path.read_bytes()[: self._synced]


class FaultyDisk:
    """Opens files on a disk that fails now and then, for the histories that nobody thinks of.

    Its operations (open, flush, sync, finish) are numbered from 0; those in `failing` raise OSError instead.
    """

    def __init__(self, directory: Path, failing: Container[int]) -> None:
        self._directory, self._failing, self._next = directory, failing, 0

    def __call__(self, name: str) -> Sink:
        self.take()
        return _FaultySink(self, FileSink(self._directory, name))

    def take(self) -> None:
        """One operation."""
        self._next += 1
        if self._next - 1 in self._failing:
            raise OSError(errno.EIO, os.strerror(errno.EIO))


class _FaultySink:
    def __init__(self, disk: FaultyDisk, inner: FileSink) -> None:
        self._disk, self._inner = disk, inner
        self.write, self.tell = inner.write, inner.tell
        self.abandon, self.discard = inner.abandon, inner.discard

    def flush(self) -> None:
        self._disk.take()
        self._inner.flush()

    def sync(self) -> None:
        self._disk.take()
        self._inner.sync()

    def finish(self) -> None:
        self._disk.take()
        self._inner.finish()


def file_sinks(directory: Path) -> SinkOpener:
    """Opener of files in `directory`, which is made if it does not exist."""
    directory.mkdir(parents=True, exist_ok=True)
    return lambda name: FileSink(directory, name)


def sync_directory(directory: Path) -> None:
    """Make a rename in `directory` survive a power cut."""
    fd = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
