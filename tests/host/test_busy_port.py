"""Who is named where a port is in use."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from host_devices import Silent, plugged

from hippomat_host.serial_port import BusyPort, open_port

# A process whose child holds the port, as the daemon's motor guard does.
_HOLDER = """
import fcntl, os, sys, time
file = open(sys.argv[1])
fcntl.flock(file, fcntl.LOCK_EX)
print(flush=True)
sys.stdin.read()
"""
_PARENT = """
import subprocess, sys
subprocess.run([sys.executable, "-c", sys.argv[2], sys.argv[1], sys.argv[3]])
"""


@pytest.mark.parametrize("name", ["hippomat_host.base_guard", "another"])
def test_the_daemon_is_named_in_place_of_its_motor_guard(tmp_path: Path, name: str) -> None:
    silent = Silent(tmp_path / "base")
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", _PARENT, str(silent.link), _HOLDER, name]
    with plugged(silent), subprocess.Popen(command, stdin=pipe, stdout=pipe) as daemon:
        assert daemon.stdout is not None
        daemon.stdout.readline()
        with pytest.raises(BusyPort) as caught:
            open_port(str(silent.link))
    assert caught.value.owner is not None
    assert (caught.value.owner[0] == daemon.pid) == (name == "hippomat_host.base_guard")
