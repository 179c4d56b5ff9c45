"""A websocket to rosbridge, and what to tell a user of it that cannot be opened or broke.

Knows addresses and failures; what is said over it is in hippomat_logs.ros.rosbridge.
"""

from __future__ import annotations

import contextlib
import json
import socket
from collections.abc import Mapping
from types import TracebackType
from typing import Any

from hippomat_core.errors import PortError
from hippomat_logs.ros.rosbridge import MOST_BYTES, Incoming, websockets_sync

OPEN_S = 5.0
DEAD_MS = 1000  # bytes that nobody acknowledges for so long: the other side, or the way to it, is gone
LAUNCH = (
    "`roslaunch rosbridge_server rosbridge_websocket.launch` (ROS 1), "
    "`ros2 launch rosbridge_server rosbridge_websocket_launch.xml` (ROS 2)"
)


class Rosbridge:
    """One connection, used by one thread. Every method raises PortError in one line."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.incoming = Incoming()
        self._open = contextlib.ExitStack()
        self._socket = _connected(url, self._open)

    def __enter__(self) -> Rosbridge:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: object, trace: TracebackType | None) -> None:
        self.close()

    def say(self, operation: Mapping[str, Any]) -> None:
        try:
            self._socket.send(json.dumps(operation))
        except Exception as error:
            raise self._broken(error) from None

    def hear(self, timeout_s: float) -> dict[str, Any] | None:
        """The next operation; None if there was none in time, or what came was none."""
        try:
            frame = self._socket.recv(timeout=timeout_s)
        except TimeoutError:
            return None
        except Exception as error:
            raise self._broken(error) from None
        return self.incoming.operation(frame)

    def close(self) -> None:
        with contextlib.suppress(Exception):
            self._open.close()

    def _broken(self, error: Exception) -> PortError:
        return PortError(f"{self.url}: rosbridge hung up ({_reason(error)})")


def _connected(url: str, until_closed: contextlib.ExitStack) -> Any:
    client = websockets_sync("client")
    try:
        options = {"max_size": MOST_BYTES, "open_timeout": OPEN_S, "close_timeout": 0.5}
        connection = until_closed.enter_context(client.connect(url, compression=None, **options))
    except ConnectionRefusedError:
        raise PortError(f"{url}: connection refused; start rosbridge there: {LAUNCH}") from None
    except socket.gaierror:
        raise PortError(f"{url}: no such host; give an address that this robot knows (ping it)") from None
    except TimeoutError:
        raise PortError(
            f"{url}: no answer within {OPEN_S:.0f} s: is the address right, and no firewall?"
        ) from None
    except OSError as error:
        raise PortError(f"{url}: cannot be reached: {error.strerror or error}") from None
    except Exception as error:  # websockets' own: a server that speaks something else
        raise PortError(
            f"{url}: that is no rosbridge ({_reason(error)}): give rosbridge_websocket's port, usually 9090"
        ) from None
    with contextlib.suppress(OSError, AttributeError):  # not on every system
        connection.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, DEAD_MS)
        connection.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


def _reason(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
