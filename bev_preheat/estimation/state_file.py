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
from dataclasses import asdict
from itertools import count
import json
import math
import os
import re
from typing import NamedTuple

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.estimation.before_restart import choices_from, DriverChoices, last_seen_from, LastSeen, NO_CHOICES
from bev_preheat.estimation.estimate import Estimate, FACTOR_NAMES, FACTORS, OF_CAR, PROPULSION
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.estimation.prior import FACTOR_BOUNDS, LAG_BOUNDS, LAGS, Lags, Learned, prior_factor_covariance
from bev_preheat.files.checked_yaml import FileData
from bev_preheat.files.output_files import AnyPath, existing_file, expanded, target_of, write_whole
from bev_preheat.numerics import FloatArray
from bev_preheat.tunables import LAG_DEVIATION, LEAST_VARIANCE, OVERNIGHT

# The consumption error of one route says little about the next.
REMEMBERED = [index - FACTORS.start for index in OF_CAR]
NAMES = tuple(FACTOR_NAMES[index] for index in REMEMBERED)
LAG_NAMES = ('heat', 'sensor')
# Keys of an entry; the first two are mandatory, the others are present if the lags were learned.
KEYS = ('log_factors', 'covariance', 'log_lags', 'lag_variances')


def learned_from(estimate: Estimate) -> Learned:
    """Return the Learned of an Estimate."""
    bounds = np.array([FACTOR_BOUNDS[index] for index in range(FACTORS.start, FACTORS.stop)])
    # A mean over filters at a bound may exceed it by rounding.
    factors = np.clip(estimate.mean[FACTORS], -bounds, bounds)
    covariance = estimate.covariance[FACTORS, FACTORS].copy()
    prior = prior_factor_covariance()
    route = PROPULSION - FACTORS.start
    factors[route] = 0.0
    covariance[route, :] = covariance[:, route] = 0.0
    covariance[route, route] = prior[route, route]
    # The variance of a car that was hardly seen grows, but never beyond the prior's.
    shrink = np.sqrt(np.minimum(1.0, np.diag(prior) / np.maximum(np.diag(covariance), LEAST_VARIANCE)))
    return Learned(factors, covariance * np.outer(shrink, shrink), _lags_from(estimate))


def _lags_from(estimate: Estimate) -> Lags | None:
    """Return the Lags of an Estimate; None: a faulty heater gives no information about them."""
    if estimate.heater.heater is not Heater.ANSWERS:
        return None
    return Lags(np.clip(estimate.mean[[*LAGS]], LAG_BOUNDS[:, 0], LAG_BOUNDS[:, 1]),
                np.minimum(np.diag(estimate.covariance)[[*LAGS]], LAG_DEVIATION**2))


def as_entry(learned: Learned) -> dict[str, FileData]:
    """Return the stored part of a Learned as plain values for JSON."""
    entry = {'log_factors': dict(zip(NAMES, learned.factors[REMEMBERED].tolist())),
             'covariance': learned.covariance[np.ix_(REMEMBERED, REMEMBERED)].tolist()}
    if learned.lags is not None:
        entry['log_lags'] = dict(zip(LAG_NAMES, learned.lags.logs.tolist()))
        entry['lag_variances'] = dict(zip(LAG_NAMES, learned.lags.variances.tolist()))
    return entry


def from_entry(entry: FileData) -> Learned:
    """
    Return the Learned of an entry, with the uncertainty of one night added.

    Raises InvalidInput, naming the value and its valid range.
    """
    try:
        # Entries of version 0.2 end before the heat of other sources.
        names = NAMES[:max(len(NAMES) - 1, len(entry['log_factors']))]
        logs = np.array([entry['log_factors'][name] for name in names], dtype=float)
        covariance = np.array(entry['covariance'], dtype=float)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InvalidInput(f'log_factors or covariance is damaged: {error}') from error
    _check(logs, covariance)
    factors, whole = np.zeros(len(FACTOR_NAMES)), prior_factor_covariance()
    own = REMEMBERED[:len(logs)]
    factors[own] = logs
    whole[np.ix_(own, own)] = covariance + OVERNIGHT**2 * np.eye(len(own))
    return Learned(factors, whole, _lags_of(entry))


def _lags_of(entry: dict[str, FileData]) -> Lags | None:
    """Return the Lags of an entry, with the uncertainty of one night added; None if it has none."""
    if 'log_lags' not in entry and 'lag_variances' not in entry:
        return None
    try:
        logs, variances = (np.array([entry[key][name] for name in LAG_NAMES], dtype=float)
                           for key in ('log_lags', 'lag_variances'))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InvalidInput(f'log_lags or lag_variances is damaged: {error}') from error
    for name, value, (low, high) in zip(LAG_NAMES, logs, LAG_BOUNDS):
        if not low <= value <= high:
            raise InvalidInput(f'log_lags.{name}: {value:g} is not allowed; it must be '
                               f'{low:.3f} ... {high:.3f}')
    most = LAG_DEVIATION**2
    for name, value in zip(LAG_NAMES, variances):
        if not 0.0 <= value <= most:
            raise InvalidInput(f'lag_variances.{name}: {value:g} is not allowed; it must be '
                               f'0 ... {most:g}')
    return Lags(logs, np.minimum(variances + OVERNIGHT**2, most))


def _check(logs: FloatArray, covariance: FloatArray) -> None:
    size = len(logs)
    bounds = [FACTOR_BOUNDS[index] for index in OF_CAR]
    for name, value, bound in zip(NAMES, logs, bounds):
        if not abs(value) <= bound:
            raise InvalidInput(f'log_factors.{name}: {value:g} is not allowed; it must be '
                               f'{-bound:g} ... {bound:g}')
    if covariance.shape != (size, size) or not np.isfinite(covariance).all():
        raise InvalidInput(f'covariance: must be {size} times {size} finite numbers')
    variances = np.diag(covariance)
    most = np.diag(prior_factor_covariance())[REMEMBERED[:size]] * (1.0 + 1e-6)
    symmetric = np.allclose(covariance, covariance.T, rtol=1e-6, atol=1e-15)
    if not symmetric or (variances > most).any() or (
            np.linalg.eigvalsh(covariance) < -LEAST_VARIANCE).any():
        raise InvalidInput('covariance: is not positive semidefinite, or exceeds the prior '
                           f'(standard deviations {", ".join(_roots(variances))})')


def _roots(variances: FloatArray) -> list[str]:
    return [f'{math.sqrt(value):.3g}' if value >= 0.0 else 'none' for value in variances]


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
    """Raise InvalidInput if a path is neither free nor an empty or a state file; changes nothing."""
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
        entry[LAST_SEEN] = asdict(last_seen)
    contents = {FORMAT_KEY: STATE_FILE_FORMAT,
                'cars': {**dict(others[-(MOST_CARS - 1):]), **({fingerprint: entry} if entry else {})},
                DRIVER: asdict(found.choices if choices is None else choices)}
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
    if not raw:
        # An empty file holds nothing to lose: file systems leave one after a loss of power.
        return _Found({})
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


def _not_ours(path: AnyPath) -> str:
    return f'{path}: is not a state file of this planner, and stays as it is; name another file'


def _move_aside(path: AnyPath, target: str) -> str:
    """Move a damaged file to a free name, and return that name."""
    numbers = count(1)
    while True:
        number = next(numbers)
        aside = f'{target}.damaged' if number == 1 else f'{target}.damaged.{number}'
        try:
            # Reserves the name, because a plain rename would overwrite another file.
            os.close(os.open(aside, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))
            try:
                os.replace(target, aside)
            except OSError:
                with suppress(OSError):
                    os.unlink(aside)
                raise
        except FileExistsError:
            continue
        except OSError as error:
            raise InvalidInput(f'{path}: is damaged and cannot be moved to {aside}: '
                               f'{error.strerror}') from error
        return aside
