# SPDX-License-Identifier: Apache-2.0
"""Recordings of ROS 2 topics: MCAP files and rosbag2 folders."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.installed import installed_prefix
from bev_preheat.logs.channels import Channel, Piece
from bev_preheat.optional_packages import require

if TYPE_CHECKING:
    from bev_preheat.logs.remarks import Remarks
    from bev_preheat.logs.signal_map import SignalMap

MAGIC = (b'\x89MCAP0\r\n', b'SQLite format 3\0')
MESSAGES = 'bev_preheat_msgs'
NS = 1e-9
# Messages that are searched for the fields of topics, and those that are read at once.
MOST_SEARCHED, BATCH = 20_000, 20_000
LONGEST_ARRAY, DEEPEST = 8, 6


class RosBag:
    """An open recording of topics; see RawLog. A channel is a field: /battery_state.temperature."""

    format = 'ROS 2 topics'
    place = 'message'
    decimal = '.'
    absolute = True

    def __init__(self, path: str | Path) -> None:
        """Read the first messages of each topic for their fields; raises InvalidInput if the file is damaged."""
        require('rosbags')
        self._path = Path(path)
        found: dict[str, None] = {}
        missing: set[str] | None = None
        problem: list[str] = []
        for number, (topic, _, _, message) in enumerate(self._messages(problem)):
            if missing is None:
                missing = set(self._topics)
            if topic in missing:
                missing.discard(topic)
                found.update(dict.fromkeys(_fields(topic, message)))
            if not missing or number > MOST_SEARCHED:
                break
        if not found:
            raise InvalidInput(f'{path}: no message can be read' + (f': {problem[0]}' if problem else ''))
        self.channels = tuple(Channel(name) for name in found)

    def use(self, signal_map: SignalMap) -> None:
        """Do nothing: each message has its time."""

    def pieces(self, wanted: Collection[str], remarks: Remarks) -> Iterator[Piece]:
        """Yield the Pieces of the wanted fields; see RawLog."""
        topics = {name.partition('.')[0] for name in wanted}
        readings: dict[str, list[tuple[float, float, int]]] = {}
        # Simulated time runs apart from the recorder's clock; stamps tell by how much.
        ahead_s = 0.0
        problem: list[str] = []
        for number, (topic, received_s, stamp_s, message) in enumerate(self._messages(problem), start=1):
            if stamp_s is not None:
                ahead_s = stamp_s - received_s
            if topic in topics:
                for name, value in _fields(topic, message).items():
                    if name in wanted:
                        readings.setdefault(name, []).append((received_s + ahead_s, value, number))
            if number % BATCH == 0:
                yield from _pieces(readings)
                readings = {}
        if problem:
            remarks.add('bag', f'{self._path}: is damaged: {problem[0]}; the messages before are used')
        yield from _pieces(readings)

    def _messages(self, problem: list[str]) -> Iterator[tuple[str, float, float | None, Any]]:
        """Yield topic, time of arrival [s], stamp [s] (None: none) and message; an error ends it and is named."""
        from rosbags.highlevel import AnyReader
        try:
            with AnyReader([self._path], default_typestore=_types()) as reader:
                known = [each for each in reader.connections if each.msgtype in reader.typestore.fielddefs]
                self._topics = {each.topic for each in known}
                for connection, received_ns, data in reader.messages(connections=known):
                    message = reader.deserialize(data, connection.msgtype)
                    yield connection.topic, received_ns * NS, _stamp_s(message), message
        except GeneratorExit:
            raise
        except Exception as error:
            # rosbags raises errors of many kinds for damaged files.
            problem.append(quoted(str(error) or type(error).__name__))


def _types() -> Any:
    """Return the types of messages, with our own, for recordings that do not hold them."""
    from rosbags.typesys import get_types_from_msg, get_typestore, Stores
    store = get_typestore(Stores.ROS2_JAZZY)
    prefix = installed_prefix(MESSAGES)
    if prefix is not None:
        types: dict[str, Any] = {}
        for file in sorted((prefix / 'share' / MESSAGES / 'msg').glob('*.msg')):
            types.update(get_types_from_msg(file.read_text(encoding='utf-8'), f'{MESSAGES}/msg/{file.stem}'))
        store.register(types)
    return store


def _stamp_s(message: Any) -> float | None:
    """Return the time that a message is stamped with [s], None if it has none."""
    stamp = getattr(getattr(message, 'header', None), 'stamp', None) or getattr(message, 'stamp', None)
    if stamp is None or not hasattr(stamp, 'nanosec'):
        return None
    seconds = stamp.sec + stamp.nanosec * NS
    return seconds if seconds > 0.0 else None


def _fields(prefix: str, value: Any, depth: int = 0) -> dict[str, float]:
    """Return the numbers in a message by dotted path; long arrays are left out."""
    found: dict[str, float] = {}
    if isinstance(value, bool | int | float | np.number):
        found[prefix] = float(value)
    elif isinstance(value, list | tuple | np.ndarray):
        if len(value) <= LONGEST_ARRAY:
            for at, item in enumerate(value):
                found.update(_fields(f'{prefix}.{at}', item, depth + 1))
    elif depth < DEEPEST and hasattr(value, '__dataclass_fields__'):
        for name in value.__dataclass_fields__:
            if not name.startswith('_') and name not in ('header', 'stamp'):
                found.update(_fields(f'{prefix}.{name}', getattr(value, name), depth + 1))
    return found


def _pieces(readings: dict[str, list[tuple[float, float, int]]]) -> Iterator[Piece]:
    for name, rows in readings.items():
        time_s, values, places = (np.array(column) for column in zip(*rows))
        yield Piece(name, time_s, values, places)


def is_bag_folder(path: str | Path) -> bool:
    """Return whether a path is a folder that rosbag2 wrote."""
    return (Path(path) / 'metadata.yaml').is_file()


def open_ros_bag(path: str | Path, head: bytes) -> RosBag | None:
    """Return the open recording if a file is MCAP or SQLite, else None."""
    if not head.startswith(MAGIC):
        return None
    return RosBag(path)
