# SPDX-License-Identifier: Apache-2.0
"""The files of `ros2 bag`: messages of MCAP and SQLite files as bytes."""

from __future__ import annotations

from pathlib import Path
import sqlite3
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.input_files import mcap_messages
from bev_preheat.recording.message_types import definition, OWN, SEPARATOR

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

MCAP, SQLITE = b'\x89MCAP0\r\n', b'SQLite format 3\0'
SUFFIXES = ('.mcap', '.db3')
COMPRESSED = ('.zstd', '.zst')


def bag_messages(path: Path, types: Mapping[str, str],
                 remarks: list[str]) -> Iterator[tuple[str, str, int, bytes]]:
    """
    Yield topic, type, time of arrival [ns] and bytes of the messages of topics with these names and types.

    `types` has the type by the last part of the topic's name. Raises InvalidInput, naming the file, if it cannot
    be read, or if a type of ours was recorded with other fields.
    """
    for file in files_of(path):
        before = len(remarks)
        read = _sqlite_messages if _head(file).startswith(SQLITE) else _mcap
        is_empty = True
        for message in read(file, types, remarks):
            is_empty = False
            yield message
        if is_empty and len(remarks) > before:
            # The remark tells why there is nothing.
            raise InvalidInput(remarks[before].partition(';')[0] + ', and nothing before can be used')


def files_of(path: Path) -> list[Path]:
    """Return the files of a recording, or of the folder that `ros2 bag` wrote, in order; raises InvalidInput."""
    if not path.is_dir():
        return [path]
    try:
        there = sorted(path.iterdir())
    except OSError as error:
        raise InvalidInput(f'{path}: cannot be read: {error.strerror}') from error
    files = [file for file in there if file.suffix in SUFFIXES]
    if not files:
        packed = [file.name for file in there if file.suffix in COMPRESSED]
        raise InvalidInput(f'{path}: has no .mcap and no .db3 file' + (
            f'; decompress {packed[0]} first (zstd -d)' if packed else ''))
    return files


def _head(path: Path) -> bytes:
    try:
        with open(path, 'rb') as file:
            return file.read(16)
    except OSError as error:
        raise InvalidInput(f'{path}: cannot be read: {error.strerror}') from error


def is_bag(path: Path) -> bool:
    """Return whether a path is a folder or a file of `ros2 bag`, by its first bytes."""
    return (path / 'metadata.yaml').is_file() if path.is_dir() else _head(path).startswith((MCAP, SQLITE))


def _is_wanted(topic: str, type_name: str, types: Mapping[str, str]) -> bool:
    return types.get(topic.rpartition('/')[2]) == type_name


def _mcap(path: Path, types: Mapping[str, str], remarks: list[str]) -> Iterator[tuple[str, str, int, bytes]]:
    def note(problem: str) -> None:
        remarks.append(f'{path}: {problem}; the messages before are used')

    checked: set[str] = set()
    for topic, type_name, received_ns, data, text in mcap_messages(path, note):
        if _is_wanted(topic, type_name, types):
            if type_name not in checked:
                checked.add(type_name)
                check_fields(path, type_name, text.decode('utf-8', 'replace'))
            yield topic, type_name, received_ns, data


def _sqlite_messages(path: Path, types: Mapping[str, str],
                     remarks: list[str]) -> Iterator[tuple[str, str, int, bytes]]:
    # A recorder that was killed leaves a journal beside the file; without one nothing is written beside it.
    how = 'mode=ro' if path.with_name(f'{path.name}-wal').exists() else 'mode=ro&immutable=1'
    try:
        base = sqlite3.connect(f'{path.resolve().as_uri()}?{how}', uri=True)
    except sqlite3.Error as error:
        raise InvalidInput(f'{path}: cannot be read: {error}') from error
    try:
        wanted = {number: (topic, type_name) for number, topic, type_name in base.execute(
            'SELECT id, name, type FROM topics') if _is_wanted(topic, type_name, types)}
        texts = _sqlite_texts(base)
        for _, type_name in wanted.values():
            if type_name in texts:
                check_fields(path, type_name, texts[type_name])
        numbers = ','.join(str(int(number)) for number in wanted)
        for number, received_ns, data in base.execute(
                'SELECT topic_id, timestamp, data FROM messages '
                f'WHERE topic_id IN ({numbers}) ORDER BY timestamp, id'):
            yield *wanted[number], int(received_ns), bytes(data)
    except (sqlite3.Error, TypeError, ValueError, OverflowError) as error:
        remarks.append(f'{path}: is damaged ({error}); the messages before are used')
    finally:
        base.close()


def _sqlite_texts(base: sqlite3.Connection) -> dict[str, str]:
    """Return the definitions of types; {} in recordings of a ROS that did not write them."""
    try:
        return {str(name): str(text) for name, text in base.execute(
            'SELECT topic_type, encoded_message_definition FROM message_definitions')}
    except sqlite3.Error:
        return {}


def check_fields(path: Path, type_name: str, text: str) -> None:
    """Raise InvalidInput if a type of ours was recorded with other fields than it has here."""
    package, _, name = type_name.partition('/msg/')
    # ROS's own types keep their fields.
    if package != OWN or not text.strip():
        return
    recorded, here = fields_of(text), fields_of(definition(package, name).decode())
    if recorded != here:
        other = next((line for line in (*recorded, *here) if (line in recorded) != (line in here)), 'their order')
        raise InvalidInput(f'{path}: {type_name} was recorded with other fields than this version has '
                           f'({quoted(other)}); replay it with the version that wrote it')


def fields_of(text: str) -> list[str]:
    """Return the fields of a message definition, without comments, constants and the types in it."""
    lines = text.partition(SEPARATOR)[0].splitlines()
    stripped = [' '.join(line.partition('#')[0].split()) for line in lines]
    # `string<=256 name` has a bound, `uint8 NAME=1` is a constant.
    return [line for line in stripped if line and '=' not in line.replace('<=', '')]
