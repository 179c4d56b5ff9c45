"""A Ray of our own on this machine alone, or a cluster that somebody runs. To be asked before importing Ray.

On its own: no dashboard, no usage statistics, and every port on 127.0.0.1, which Ray decides by environment
variables that it reads when it is imported. Knows nothing of learning.
"""

from __future__ import annotations

import importlib
import importlib.util
import logging
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from hippomat_core.errors import ConfigError

LOCAL = "local"
_LOOPBACK = "127.0.0.1"
_KNOCK_S = 5.0
# Ray takes a loopback address for a mistake and looks for another one, unless clusters are off.
_LOCAL_ENVIRONMENT = {
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",
    "RAY_USAGE_STATS_ENABLED": "0",
}
_OBJECT_STORE_BYTES = 256 * 1024 * 1024  # rollouts and weights; Ray's own choice is a third of the memory


def stay_on_loopback() -> None:
    """Before the first import of Ray in a process that starts a Ray of its own."""
    os.environ.update(_LOCAL_ENVIRONMENT)


def require_ray() -> None:
    """ConfigError where Ray is missing; imports nothing."""
    if importlib.util.find_spec("ray") is None:
        raise _missing("ray")


@contextmanager
def ray_session(address: str, processors: int) -> Iterator[None]:
    """Ray while the block lasts. address: LOCAL, or that of a cluster's head as `ray.init` takes it.

    ConfigError where Ray is missing, a cluster does not answer, or others could reach a local Ray.
    """
    if address == LOCAL:
        stay_on_loopback()
    ray = _ray()
    for name in ("ray", "ray.rllib"):
        logging.getLogger(name).setLevel(logging.ERROR)
    quiet = {"log_to_driver": False, "logging_level": logging.ERROR}
    if address == LOCAL:
        _start(ray, processors, quiet)
    else:
        _join(ray, address, quiet)
    try:
        yield
    finally:
        ray.shutdown()


def _ray() -> Any:
    try:
        importlib.import_module("ray.rllib")
    except ImportError as error:
        raise _missing(error.name) from None
    return importlib.import_module("ray")


def _missing(package: str | None) -> ConfigError:
    return ConfigError(f"--ray needs Ray RLlib ({package} is not installed): pip install 'hippomat[ray]'")


def _start(ray: Any, processors: int, quiet: dict[str, Any]) -> None:
    found = ray.util.get_node_ip_address()
    if found != _LOOPBACK:
        raise ConfigError(
            f"a local Ray would listen on {found}, because Ray was imported before it was asked to stay on "
            f"{_LOOPBACK}: set RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER=0 for the process"
        )
    ray.init(
        address=LOCAL,
        num_cpus=processors,
        include_dashboard=False,
        object_store_memory=_OBJECT_STORE_BYTES,
        _node_ip_address=_LOOPBACK,
        **quiet,
    )


def _join(ray: Any, address: str, quiet: dict[str, Any]) -> None:
    try:
        _knock(address)
        ray.init(address=address, **quiet)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ConfigError(
            f"--ray {address}: no Ray cluster there ({reason}); start one, or use {LOCAL}"
        ) from None


def _knock(address: str) -> None:
    """OSError where nobody listens, which Ray finds out after minutes. "auto" and the like pass."""
    host, _, port = address.rpartition("//")[2].rpartition(":")
    if host and port.isdigit():
        socket.create_connection((host.strip("[]"), int(port)), timeout=_KNOCK_S).close()
