# SPDX-License-Identifier: Apache-2.0
"""
The state file: learned values of cars, their last states, and the driver's choices.

Cars are stored under the SHA-256 of their vehicle files. Only a new file is written, or a file that this
module recognises by its keys: the present format, format 2, which had no driver, or format
1, which held a single car. Every other file is refused.
A damaged state file is moved to a free name before a new one is written. Entries of other vehicle files stay.
"""

from __future__ import annotations

from contextlib import suppress
from itertools import count
import json
import os
import re
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.estimation.driver_choices import choices_entry, choices_from, NO_CHOICES
from bev_preheat.estimation.last_seen import last_seen_entry, last_seen_from
from bev_preheat.estimation.memory import as_entry, from_entry, KEYS
from bev_preheat.files.output_files import AnyPath, existing_file, expanded, target_of, write_whole

if TYPE_CHECKING:
    from bev_preheat.estimation.driver_choices import DriverChoices
    from bev_preheat.estimation.last_seen import LastSeen
    from bev_preheat.estimation.prior import Learned
    from bev_preheat.files.checked_yaml import FileData

FORMAT_KEY, STATE_FILE_FORMAT, FORMATS_WITH_CARS = 'bev_preheat_state_file', 3, (2, 3)
DRIVER, LAST_SEEN, LEARNED = 'driver', 'last_seen', KEYS[0]
# The start of files of all formats; also identifies damaged ones.
OWN_HEAD = re.compile(
    rb'\s*\{\s*("bev_preheat_state_file"\s*:|"format"\s*:\s*1\s*,\s*"vehicle_file_sha256"\s*:)')
LARGEST_STATE_FILE_BYTES = 100_000
LONGEST_STATE_SENTENCE = 300
# A file with this many cars is 30 kB; the car that was written longest ago is dropped.
MOST_CARS = 50


class Recalled(NamedTuple):
    """
    The Learned of one car, its LastSeen (None: none), and the DriverChoices.

    `damage` describes the damage to the file ('': none).
    """

    learned: Learned | None = None
    last_seen: LastSeen | None = None
    choices: DriverChoices = NO_CHOICES
    damage: str = ''


class _Found(NamedTuple):
    """Entries by fingerprint, oldest first, and the driver's choices; `damage`: see Recalled."""

    cars: dict[str, FileData]
    choices: DriverChoices = NO_CHOICES
    damage: str = ''


def check_state_file(path: AnyPath) -> None:
    """Raise InvalidInput if a path is neither free nor a state file; changes nothing."""
    _find(path)


def load_state(path: AnyPath, fingerprint: str) -> Recalled:
    """
    Return the Recalled of the car with this fingerprint.

    Raises InvalidInput, naming file and problem, if the file is not a state file.
    """
    found = _find(path)
    entry = found.cars.get(fingerprint, {})
    return Recalled(from_entry(entry) if LEARNED in entry else None,
                    last_seen_from(entry[LAST_SEEN]) if LAST_SEEN in entry else None,
                    found.choices, found.damage)


def save_state(path: AnyPath, fingerprint: str, learned: Learned | None,
               last_seen: LastSeen | None = None, choices: DriverChoices | None = None) -> str | None:
    """
    Write the Learned of a car, its LastSeen and the DriverChoices, next to the file's other cars.

    None leaves the file's value. Returns the path to which a damaged file was moved, None if the file was
    sound. Raises InvalidInput if the file is not a state file, or cannot be written.
    """
    found = _find(path)
    others = [item for item in found.cars.items() if item[0] != fingerprint]
    before = found.cars.get(fingerprint, {})
    entry = {key: value for key, value in before.items() if key == LAST_SEEN or learned is None}
    if learned is not None:
        entry = {**as_entry(learned), **entry}
    if last_seen is not None:
        entry[LAST_SEEN] = last_seen_entry(last_seen)
    contents = {FORMAT_KEY: STATE_FILE_FORMAT,
                'cars': {**dict(others[-(MOST_CARS - 1):]), **({fingerprint: entry} if entry else {})},
                DRIVER: choices_entry(found.choices if choices is None else choices)}
    target = target_of(path)
    aside = _move_aside(path, target) if found.damage else None
    try:
        write_whole(path, json.dumps(contents, indent=1) + '\n', make_folder=True)
    except BaseException:
        if aside is not None:
            os.replace(aside, target)
        raise
    return aside


def _find(path: AnyPath) -> _Found:
    raw = _read(path)
    if raw is None:
        return _Found({})
    if not raw:
        raise InvalidInput(_not_ours(path, 'it is empty'))
    has_own_head = OWN_HEAD.match(raw)
    if len(raw) > LARGEST_STATE_FILE_BYTES:
        if has_own_head:
            return _Found({}, damage=f'it is larger than {LARGEST_STATE_FILE_BYTES} bytes')
        raise InvalidInput(_not_ours(path))
    try:
        contents = json.loads(raw)
    except (ValueError, RecursionError) as error:
        if has_own_head:
            return _Found({}, damage=f'it cannot be read: {error}')
        raise InvalidInput(_not_ours(path)) from error
    if isinstance(contents, dict) and FORMAT_KEY in contents:
        number = contents[FORMAT_KEY]
        if isinstance(number, int) and number > STATE_FILE_FORMAT:
            raise InvalidInput(f'{path}: has format {number} of a later version; this version reads '
                               f'1 to {STATE_FILE_FORMAT}; name another file')
        return _sound(*((contents.get('cars'), contents.get(DRIVER))
                        if number in FORMATS_WITH_CARS else (None, None)))
    if isinstance(contents, dict) and contents.get('format') == 1 \
            and 'vehicle_file_sha256' in contents:
        fingerprint = contents['vehicle_file_sha256']
        return _sound({fingerprint: contents} if isinstance(fingerprint, str) else None)
    raise InvalidInput(_not_ours(path))


def _sound(cars: FileData, driver: FileData = None) -> _Found:
    """Return the valid entries as _Found; the others count as damage."""
    if not isinstance(cars, dict):
        return _Found({}, damage='its format or its list of cars is damaged')
    sound, choices, problems = {}, NO_CHOICES, []
    for fingerprint, entry in cars.items():
        try:
            sound[fingerprint] = _sound_entry(entry)
        except InvalidInput as error:
            problems.append(f'car {fingerprint[:12]}: {error}')
    try:
        choices = NO_CHOICES if driver is None else choices_from(driver)
    except InvalidInput as error:
        problems.append(str(error))
    # It goes into one log line, however long the text found is.
    return _Found(sound, choices, '; '.join(problems)[:LONGEST_STATE_SENTENCE])


def _sound_entry(entry: FileData) -> FileData:
    """Return the known keys of a car's entry; raise InvalidInput if a value is invalid."""
    is_seen = isinstance(entry, dict) and LAST_SEEN in entry
    if is_seen:
        last_seen_from(entry[LAST_SEEN])
    # A car that was seen but not driven has no learned values.
    if not is_seen or LEARNED in entry:
        from_entry(entry)
    return {key: entry[key] for key in (*KEYS, LAST_SEEN) if key in entry}


def _read(path: AnyPath) -> bytes | None:
    """Return the first bytes of a file, None if it does not exist."""
    if existing_file(path) is None:
        if os.path.islink(expanded(path)):
            raise InvalidInput(f'{path}: is a link to {target_of(path)}, which does not exist; '
                               'name that file itself')
        return None
    try:
        # If a pipe has replaced it meanwhile, opening it must not wait for a writer.
        with open(os.open(expanded(path), os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC),
                  'rb') as file:
            return file.read(LARGEST_STATE_FILE_BYTES + 1)
    except OSError as error:
        raise InvalidInput(f'{path}: cannot be read: {error.strerror}') from error


def _not_ours(path: AnyPath, finding: str = 'it is not a state file of this planner') -> str:
    return f'{path}: not overwritten: {finding}; name a file that does not exist yet'


def _move_aside(path: AnyPath, target: str) -> str:
    """Move a damaged file to a free name, and return that name."""
    numbers = count(1)
    while True:
        number = next(numbers)
        aside = f'{target}.damaged' if number == 1 else f'{target}.damaged.{number}'
        try:
            # Reserves the name, because a plain rename would overwrite another file.
            os.close(os.open(aside, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))
        except FileExistsError:
            continue
        except OSError as error:
            raise InvalidInput(f'{path}: is damaged and cannot be moved to {aside}: '
                               f'{error.strerror}') from error
        try:
            os.replace(target, aside)
        except OSError as error:
            with suppress(OSError):
                os.unlink(aside)
            raise InvalidInput(f'{path}: is damaged and cannot be moved to {aside}: '
                               f'{error.strerror}') from error
        return aside
