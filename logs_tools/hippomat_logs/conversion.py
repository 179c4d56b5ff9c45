"""From any log to any other: .mcap, ROS 1 .bag, ROS 2 bag. Messages come out equal, or their channel is
named.

Decides what a target cannot hold. Definitions go along as they are: a ROS 1 Header keeps its seq in an .mcap
and gets it back in a .bag; a Header without one stays without one in a .bag.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from hippomat_core.errors import HippomatError, LogError
from hippomat_logs.log_writer import writing
from hippomat_logs.opened_run import OpenedRun, manifest_of
from hippomat_logs.outputs import refuse_existing
from hippomat_logs.selection import Selection, write_selection
from hippomat_logs.sources import Source, Stream

STORAGES = {"sqlite3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}
Progress = Callable[[int], None]  # messages done


def refuse_target(target: Path) -> None:
    """HippomatError where nothing can be converted to: asked before the source is opened."""
    if target.suffix not in ("", ".mcap", ".bag"):
        raise HippomatError(
            f"{target}: give a name that ends in .mcap or .bag, or none of both for a ROS 2 bag"
        )
    refuse_existing(target)


def convert(source: Source, target: Path, storage: str, progress: Progress) -> tuple[int, dict[str, str]]:
    """(messages written, channels left out and why). The target's kind is its suffix; none: a ROS 2 bag."""
    refuse_target(target)
    left_out = dict(source.left_out)
    if target.suffix == ".mcap":
        return _to_mcap(source, target, progress), left_out
    if target.suffix == ".bag":
        return _to_bag(source, target, left_out, progress), left_out
    return _to_rosbag2(source, target, STORAGES[storage], left_out, progress), left_out


def _to_mcap(source: Source, target: Path, progress: Progress) -> int:
    if manifest_of(source):  # a run of ours stays one, with manifest, weights and end mark
        return write_selection(OpenedRun([source]), Selection(), target)
    with writing(target) as writer:
        for row in source.rows():
            writer.write(source, row)
            progress(writer.messages)
        writer.finish()
        return writer.messages


def _to_bag(source: Source, target: Path, left_out: dict[str, str], progress: Progress) -> int:
    types = get_typestore(Stores.EMPTY)
    done = 0
    with _removed_on_failure(target), BagWriter(target) as writer:
        connections: dict[int, Any] = {}
        for number, stream in _registered(source, types, left_out):
            try:
                connections[number] = writer.add_connection(stream.topic, stream.type_name, typestore=types)
            except Exception as error:  # rosbags raises whatever its generator trips over
                left_out[stream.topic] = f"ROS 1 cannot hold it: {error}"
        for row in source.rows(list(connections)):
            stream = source.streams[row.channel]
            try:
                message = types.deserialize_cdr(row.data, stream.type_name)
                data = types.serialize_ros1(message, stream.type_name)
            except Exception as error:
                raise LogError(f"{source.path}: channel {stream.topic}: does not decode: {error}") from None
            writer.write(connections[row.channel], row.log_time_ns, data)
            done += 1
            progress(done)
    return done


def _to_rosbag2(
    source: Source, target: Path, plugin: StoragePlugin, left_out: dict[str, str], progress: Progress
) -> int:
    types = get_typestore(Stores.EMPTY)
    done = 0
    with (
        _removed_on_failure(target),
        Rosbag2Writer(target, version=9, storage_plugin=plugin) as writer,
    ):
        connections: dict[int, Any] = {}
        for number, stream in _registered(source, types, left_out):
            connections[number] = writer.add_connection(stream.topic, stream.type_name, typestore=types)
        for row in source.rows(list(connections)):
            writer.write(connections[row.channel], row.log_time_ns, row.data)
            done += 1
            progress(done)
    return done


def _registered(source: Source, types: Typestore, left_out: dict[str, str]) -> Iterator[tuple[int, Stream]]:
    """Channels whose definitions agree with those before them; two of one topic become one only in ROS 2."""
    for number, stream in source.streams.items():
        try:
            types.register(stream.types)
        except LogError as error:
            left_out[stream.topic] = str(error).removeprefix(f"channel {stream.topic}: ")
            continue
        except Exception as error:  # TypesysError
            left_out[stream.topic] = str(error)
            continue
        yield number, stream


@contextmanager
def _removed_on_failure(target: Path) -> Iterator[None]:
    try:
        yield
    except BaseException:
        if target.is_dir():
            shutil.rmtree(target, ignore_errors=True)
        else:
            target.unlink(missing_ok=True)
        raise
