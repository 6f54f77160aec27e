# SPDX-License-Identifier: Apache-2.0
"""Recordings of ROS 2 topics: MCAP files and rosbag2 folders."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.input_files import beginning_of, installed_prefix, mcap_messages
from bev_preheat.logs.raw_log import Channel, Piece, pieces_of, RawLog, Remarks
from bev_preheat.optional_packages import MissingPackage, require

MAGIC = (b'\x89MCAP0\r\n', b'SQLite format 3\0')
MESSAGES = 'bev_preheat_msgs'
NS = 1e-9
# Messages that are searched for the fields of topics.
SEARCHED_MESSAGES = 20_000
LONGEST_ARRAY, DEEPEST_MESSAGE = 8, 6
# Of a RoutePlan, the conditions of each segment.
ROUTE_FIELDS = ('speed', 'ambient_temperature', 'cabin_heating_power', 'auxiliary_power')
# The encapsulation: byte order, then two bytes of options.
CDR_HEAD_BYTES = 4


class RosBag(RawLog):
    """An open recording of topics; see RawLog. A channel is a field: /battery_state.temperature."""

    format = 'ROS 2 topics'
    place = 'message'

    def __init__(self, path: str | Path) -> None:
        """Read the first messages of each topic for their fields; raises InvalidInput if the file is damaged."""
        require('rosbags')
        self._path = Path(path)
        # drive_10 comes after drive_2.
        files = sorted(self._path.glob('*.mcap'), key=lambda file: (len(file.name), file.name)) if (
            self._path.is_dir()) else [self._path]
        # None of a recording in SQLite.
        self._files = [file for file in files if beginning_of(file).startswith(MAGIC[0])]
        # Of a file whose messages are read as they come, they are not known before its end.
        self._topics: set[str] | None = None
        found: dict[str, None] = {}
        seen: set[str] = set()
        problem: list[str] = []
        for number, (topic, _, _, message) in enumerate(self._messages(problem)):
            if topic not in seen:
                seen.add(topic)
                found.update(dict.fromkeys((*_fields(topic, message), *(
                    f'{topic}.{name}' for name in ROUTE_FIELDS if hasattr(message, 'segment_duration')))))
            if seen == self._topics or number > SEARCHED_MESSAGES:
                break
        if not found:
            raise InvalidInput(f'{path}: no message can be read' + (f': {problem[0]}' if problem else ''))
        self.channels = tuple(Channel(name) for name in found)

    def pieces(self, wanted: Collection[str], remarks: Remarks) -> Iterator[Piece]:
        """Yield the Pieces of the wanted fields, at the times of their messages."""
        yield from pieces_of(self._readings(wanted, remarks))

    def _readings(self, wanted: Collection[str], remarks: Remarks) -> Iterator[tuple[str, float, float, int]]:
        topics = {name.partition('.')[0] for name in wanted}
        # Simulated time runs apart from the recorder's clock; stamps show by how much.
        ahead_s = 0.0
        # The rest of the latest route.
        route: list[tuple[float, dict[str, float]]] = []
        problem: list[str] = []
        for number, (topic, received_s, stamp_s, message) in enumerate(self._messages(problem), start=1):
            if hasattr(message, 'segment_duration'):
                route = _route(topic, message, received_s + ahead_s if stamp_s is None else stamp_s)
            elif stamp_s is not None:
                ahead_s = stamp_s - received_s
                while route and route[0][0] <= stamp_s:
                    _, segment = route.pop(0)
                    if not route or route[0][0] > stamp_s:
                        yield from ((name, stamp_s, value, number) for name, value in segment.items()
                                    if name in wanted)
            if topic in topics:
                for name, value in _fields(topic, message).items():
                    if name in wanted:
                        yield name, received_s + ahead_s, value, number
        if problem:
            remarks.add('bag', f'{self._path}: is damaged: {problem[0]}; the messages before are used')

    def _messages(self, problem: list[str]) -> Iterator[tuple[str, float, float | None, Any]]:
        """Yield topic, time of arrival [s], stamp [s] (None: none) and message; an error ends it and is named."""
        try:
            reader = self._mcap_messages if self._files else self._bag_messages
            yield from reader(problem)
        except (GeneratorExit, MissingPackage):
            raise
        except Exception as error:
            # rosbags raises errors of many kinds for damaged files.
            problem.append(quoted(str(error) or type(error).__name__))

    def _bag_messages(self, _: list[str]) -> Iterator[tuple[str, float, float | None, Any]]:
        from rosbags.highlevel import AnyReader
        with AnyReader([self._path], default_typestore=known_types()) as reader:
            known = [each for each in reader.connections if each.msgtype in reader.typestore.fielddefs]
            self._topics = {each.topic for each in known}
            for connection, received_ns, data in reader.messages(connections=known):
                message = _deserialized(reader.typestore, connection.msgtype, data)
                yield connection.topic, received_ns * NS, _stamp_s(message), message

    def _mcap_messages(self, problem: list[str]) -> Iterator[tuple[str, float, float | None, Any]]:
        """Yield those of MCAP files: AnyReader refuses a file with a channel that is not ROS's."""
        from rosbags.typesys import get_typestore, Stores
        recorded, here, stores = get_typestore(Stores.EMPTY), known_types(), dict[str, Any]()
        for file in self._files:
            for topic, type_name, received_ns, data, text in mcap_messages(file, problem.append):
                if type_name not in stores:
                    stores[type_name] = _typestore(type_name, text.decode('utf-8', 'replace'), recorded, here)
                store = stores[type_name]
                if store is not None:
                    message = _deserialized(store, type_name, data)
                    yield topic, received_ns * NS, _stamp_s(message), message


def _typestore(type_name: str, text: str, recorded: Any, here: Any) -> Any:
    """Return the Typestore with a type: `recorded`, with its recorded definition, or `here`; None: not ROS's."""
    from rosbags.typesys import get_types_from_msg
    if type_name in here.fielddefs and not text.strip():
        return here
    try:
        types = get_types_from_msg(text, type_name)
        recorded.register({name: fields for name, fields in types.items() if name not in recorded.fielddefs})
    except Exception:
        # Another language of definitions, such as JSON or IDL.
        return here if type_name in here.fielddefs else None
    return recorded


def _deserialized(store: Any, type_name: str, data: bytes) -> Any:
    """
    Return the message of bytes (CDR), without a look at those behind it.

    `rmw_serialize` of Fast DDS, which rclpy calls, counts padding for empty sequences too, so the bytes of a
    RoutePlan end with up to 60 bytes of no meaning. `Typestore.deserialize_cdr` refuses more than three.
    """
    kind = store.get_msgdef(type_name)
    if len(data) < CDR_HEAD_BYTES or data[0] != 0 or data[1] not in (0, 1):
        raise InvalidInput(f'a message of type {type_name} is no CDR: it begins with {bytes(data[:4]).hex()}')
    read = kind.deserialize_cdr_le if data[1] == 1 else kind.deserialize_cdr_be
    return read(data[CDR_HEAD_BYTES:], 0, kind.cls, store)[0]


def known_types() -> Any:
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
    elif depth < DEEPEST_MESSAGE and hasattr(value, '__dataclass_fields__'):
        for name in value.__dataclass_fields__:
            if not name.startswith('_') and name not in ('header', 'stamp'):
                found.update(_fields(f'{prefix}.{name}', getattr(value, name), depth + 1))
    return found


def _route(topic: str, message: Any, start_s: float) -> list[tuple[float, dict[str, float]]]:
    """Return begin [s] and ROUTE_FIELDS of each segment of a RoutePlan; at stops and at the end the car stands."""
    length = max(len(getattr(message, name)) for name in ('segment_duration', *ROUTE_FIELDS))
    columns = {f'{topic}.{name}': np.broadcast_to(values, length).tolist()
               for name in ROUTE_FIELDS if len(values := getattr(message, name))}
    pauses_s = dict(zip(message.stop_after_segment, message.stop_duration))
    rows: list[tuple[float, dict[str, float]]] = []
    for at, duration_s in enumerate(np.broadcast_to(message.segment_duration, length).tolist()):
        rows.append((start_s, {name: values[at] for name, values in columns.items()}))
        start_s += duration_s
        if at in pauses_s or at == length - 1:
            rows.append((start_s, {f'{topic}.speed': 0.0}))
            start_s += pauses_s.get(at, 0.0)
    return rows


def is_bag_folder(path: str | Path) -> bool:
    """Return whether a path is a folder that rosbag2 wrote."""
    return (Path(path) / 'metadata.yaml').is_file()


def open_ros_bag(path: str | Path, head: bytes, _: Collection[str | Path] = ()) -> RosBag | None:
    """Return the open recording if a file is MCAP or SQLite, else None."""
    return RosBag(path) if head.startswith(MAGIC) else None
