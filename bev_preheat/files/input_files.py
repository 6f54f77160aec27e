# SPDX-License-Identifier: Apache-2.0
"""Finds and reads input files, regular ones only, because a pipe blocks and a device never ends; the version."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from difflib import get_close_matches
import os
from pathlib import Path
from xml.etree import ElementTree

from bev_preheat.errors import InvalidInput, LONGEST_QUOTE, quoted
from bev_preheat.optional_packages import require

AnyPath = str | os.PathLike[str]
LARGEST_TEXT = 64_000_000


def check_input(path: AnyPath) -> None:
    """Raise InvalidInput unless a path is a regular file or a link to one; `~` is the home folder."""
    file = os.path.expanduser(path)
    # pathlib's is_file() raises if a name is too long or a folder is not accessible.
    if not os.path.isfile(file):
        raise InvalidInput(f'{path}: ' + (
            'is a folder; a file is needed' if os.path.isdir(file) else
            'is not a regular file' if os.path.exists(file) else 'no such file'))


def read_text(path: AnyPath, encoding: str = 'utf-8') -> str:
    """Return a file's text; raise InvalidInput if it cannot be read, is no UTF-8 or has more than 64 MB."""
    check_input(path)
    try:
        with open(os.path.expanduser(path), encoding=encoding) as file:
            text = file.read(LARGEST_TEXT + 1)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'is not UTF-8 text'
        raise InvalidInput(f'{path}: cannot be read: {reason}') from error
    if len(text) > LARGEST_TEXT:
        raise InvalidInput(f'{path}: is larger than {LARGEST_TEXT / 1e6:.0f} MB')
    return text


def beginning_of(path: AnyPath, size: int = 16) -> bytes:
    """Return the first bytes of a file; raise InvalidInput if it cannot be read."""
    try:
        with open(path, 'rb') as file:
            return file.read(size)
    except OSError as error:
        raise InvalidInput(f'{path}: cannot be read: {error.strerror}') from error


# A damaged length must not make the reader ask for all memory.
LARGEST_RECORD_BYTES = 100_000_000


def mcap_messages(path: Path, note: Callable[[str], object]) -> Iterator[tuple[str, str, int, bytes, bytes]]:
    """
    Yield channel, type, instant [ns], bytes and the type's definition of each message as written.

    A damaged record ends it, and is noted. Raises InvalidInput if the file cannot be read, and MissingPackage
    without the package mcap.
    """
    require('mcap')
    from mcap.records import Channel, Message, Schema
    from mcap.stream_reader import StreamReader
    channels: dict[int, Channel] = {}
    schemas: dict[int, Schema] = {}
    try:
        with open(path, 'rb') as file:
            for record in StreamReader(file, record_size_limit=LARGEST_RECORD_BYTES).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    channel = channels[record.channel_id]
                    schema = schemas.get(channel.schema_id)
                    name, text = ('', b'') if schema is None else (schema.name, schema.data)
                    yield channel.topic, name, record.log_time, record.data, text
    except OSError as error:
        raise InvalidInput(f'{path}: cannot be read: {error.strerror}') from error
    except Exception as error:
        # Damaged bytes raise errors of many kinds, also of the libraries that decompress chunks.
        note(f'ends in the middle ({type(error).__name__})')


PACKAGE = 'bev_preheat'
_INDEX = Path('share', 'ament_index', 'resource_index', 'packages')
HERE = Path(__file__).resolve()
# In a source tree, its own config folder and its own version are used.
SOURCES = HERE.parents[2]


def installed_prefix(package: str) -> Path | None:
    """Return the first prefix of AMENT_PREFIX_PATH, else of this file, with a package; None without one."""
    prefixes = [Path(prefix) for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if prefix]
    return next((prefix for prefix in (*prefixes, *HERE.parents) if (prefix / _INDEX / package).is_file()), None)


def share_folder() -> Path:
    """Return the folder of the files that come with this package; raises InvalidInput if it is missing."""
    prefix = installed_prefix(PACKAGE)
    if prefix is None:
        raise InvalidInput(f'the files of {PACKAGE} are missing: AMENT_PREFIX_PATH does not lead to them; source '
                           'the setup file of the install space')
    return prefix / 'share' / PACKAGE


def configuration_folder(kind: str) -> Path:
    """Return the folder of the package's files of a kind (`vehicles`, `itineraries`)."""
    if (SOURCES / 'config').is_dir():
        return SOURCES / 'config' / kind
    # Installed by pip they lie in the package, by colcon in the share folder.
    in_package = HERE.parents[1] / 'config'
    return (in_package if in_package.is_dir() else share_folder() / 'config') / kind


def _files_beside(text: str) -> list[str]:
    """Return the files of the working folder with this name, whatever their suffix, as they must be given."""
    try:
        found = sorted(path.name for path in Path().iterdir() if path.stem == Path(text).stem and path.is_file())
    except OSError:
        return []
    return [f'./{name}' for name in found]


def find_configuration(kind: str, name_or_file: str | Path, suffix: str) -> Path:
    """
    Return the path of a file named on a command line or by a parameter.

    A text with a slash or with the suffix is a file; anything else is a name in the package's config
    folder. Raises InvalidInput with the known names.
    """
    text = str(name_or_file)
    if '/' in text or text.endswith(suffix):
        check_input(text)
        return Path(os.path.expanduser(text))
    folder = configuration_folder(kind)
    names = sorted(item.stem for item in folder.glob(f'*{suffix}'))
    if text in names:
        return folder / f'{text}{suffix}'
    near = [*_files_beside(text), *get_close_matches(text[:LONGEST_QUOTE], names, n=1)]
    if not near and Path(text).suffix:
        # The name of a file, which is missing.
        check_input(text)
    hint = f'; did you mean {near[0]!r}?' if near else ''
    singular = 'signal map' if kind == 'signals' else (
        f'{kind[:-3]}y' if kind.endswith('ies') else kind.rpartition('/')[2][:-1])
    raise InvalidInput(
        f'{singular} {quoted(text)} is unknown{hint}; known: {", ".join(names)}; '
        f'or give a file ending in {suffix}')


def version() -> str:
    """Return the version of the running sources, or of the installed package, as a text."""
    manifest = SOURCES / 'package.xml'
    if not manifest.is_file():
        if installed_prefix(PACKAGE) is None:
            # Installed by pip.
            from importlib.metadata import version as version_of
            return version_of(PACKAGE)
        manifest = share_folder() / 'package.xml'
    return ElementTree.parse(manifest).findtext('version', '').strip()
