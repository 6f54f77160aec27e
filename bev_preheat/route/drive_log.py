# SPDX-License-Identifier: Apache-2.0
"""
Builds a Route from drive logs: CSV files, one sample a second, a header, `#` for comments.

Columns: time_s, speed_mps, ambient_c (ambient temperature), cabin_heater_w (electrical
power of the cabin heater), and the battery's terminal power, positive when discharging: either
power_w or voltage_v and current_a. aircon_w (air conditioning) is optional; other columns are
ignored. Speed may be in km/h (speed_kmh), powers in kW (power_kw, ...).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.route.columns import advice, alternatives, Column, doubled, power_columns, speed_columns
from bev_preheat.route.segments import LIMITS, make_route, Route
from bev_preheat.route.text_table import read_text_table

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray, IntArray
    from bev_preheat.vehicle.description import Defaults

# Valid range of a sample: (low, high). Values outside come from sensor faults.
POSSIBLE = {
    'speed_mps': LIMITS['speed_mps'],
    'voltage_v': (1.0, 1500.0),
    'current_a': (-3000.0, 3000.0),
    'power_w': LIMITS['propulsion_power_w'],
    'ambient_c': LIMITS['ambient_temperature_c'],
    'cabin_heater_w': LIMITS['cabin_heating_power_w'],
    'aircon_w': LIMITS['auxiliary_power_w'],
}
COLUMNS = {
    'time_s': Column('time_s'),
    **speed_columns(),
    'ambient_c': Column('ambient_c'),
    **power_columns('cabin_heater_w'),
    **power_columns('power_w'),
    'voltage_v': Column('voltage_v'),
    'current_a': Column('current_a'),
    **power_columns('aircon_w'),
}
# A sample is valid for at most this time [s]; a longer interval is a gap.
LONGEST_INTERVAL_S = 1.5
# Longest gap that is bridged [s], and the largest share of a log that is bridged.
LONGEST_GAP_S = 10.0
MOST_BRIDGED = 0.2
# Number of a log's gaps that are reported individually.
MOST_GAPS_NAMED = 5


@dataclass(frozen=True)
class LoggedRoute:
    """The Route of one or more drive logs, and a sentence for each problem found in them."""

    route: Route
    remarks: tuple[str, ...]


def load_drive_logs(paths: Iterable[str | Path], defaults: Defaults,
                    step_s: float = 30.0) -> LoggedRoute:
    """
    Return the LoggedRoute of drive logs, joined in the given order, in segments of `step_s`.

    Propulsion power is the terminal power minus cabin heater, air conditioning
    and the constant auxiliary power of `defaults` (vehicle.description.Defaults). A sample holds
    until the next one. Empty, NaN or implausible samples are dropped and reported; gaps
    up to LONGEST_GAP_S are bridged by linear interpolation and reported.

    Raises InvalidInput naming file, line, column, value and allowed range: missing columns, text
    instead of a number, time that does not increase, gaps too long or too many.
    """
    if not 1.0 <= step_s <= 3600.0:
        raise InvalidInput(f'step: {step_s:g} s is not allowed; it must be 1 ... 3600 s')
    remarks: list[str] = []
    pieces = []
    for path in paths:
        names, lines, samples = _read(path)
        lines, samples = _possible_samples(path, names, lines, samples, remarks)
        pieces.append(_segments(path, names, lines, samples, defaults, remarks))
    columns = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    described = ', '.join(map(str, paths))
    try:
        route = make_route(columns, defaults).resampled(step_s)
    except InvalidInput as error:
        raise InvalidInput([f'{described}: {problem}' for problem in error.problems]) from error
    if route.propulsion_power_w @ route.duration_s < 0.0:
        remarks.append(f'{described}: net regeneration over the log; is the current really '
                       'positive when the battery is discharged?')
    return LoggedRoute(route, tuple(remarks))


def _read(path: str | Path) -> tuple[tuple[str, ...], IntArray, FloatArray]:
    """Return the names of the columns used, line numbers (N,), samples (N, columns) in SI units."""
    table = read_text_table(path, COLUMNS)
    if len(table.rows) < 2:
        raise InvalidInput(f'{path}: has {len(table.rows)} samples; at least 2 are needed, '
                           'below a header')
    names = _wanted_columns(f'{path}, line {table.header_line}', table.header)
    columns = table.numbers(names, empty_is_nan=True)
    return names, np.array(table.lines), np.column_stack(
        [COLUMNS[name].si(values) for name, values in zip(names, columns)])


def _wanted_columns(where: str, header: list[str]) -> tuple[str, ...]:
    """Return the columns used, time first."""
    found = {COLUMNS[name].quantity: name for name in header if name in COLUMNS}
    power = ('power_w',) if 'power_w' in found else ('voltage_v', 'current_a')
    wanted = ('time_s', 'speed_mps', 'ambient_c', 'cabin_heater_w', *power)
    # A log has many other columns; only a name that may stand for a missing column gets advice.
    advised = [advice(name, COLUMNS) for name in header if name not in COLUMNS]
    problems = []
    for quantity in wanted:
        if quantity in found:
            continue
        names = alternatives(quantity, COLUMNS)
        renaming = [sentence for sentence in advised if sentence.endswith(f'to {names}')]
        if renaming:
            problems.append(f'{where}: {renaming[0]}')
            continue
        near = get_close_matches(quantity, header, n=1)
        hint = f'; is it {near[0]!r}?' if near else ''
        other = f' (or {alternatives("power_w", COLUMNS)})' \
            if quantity in ('voltage_v', 'current_a') else ''
        problems.append(f'{where}: missing column {names}{other}{hint}')
    used = {quantity: found[quantity] for quantity in (*wanted, 'aircon_w') if quantity in found}
    problems += [f'{where}: {problem}' for problem in doubled(
        header, {name: column for name, column in COLUMNS.items() if column.quantity in used})]
    if problems:
        raise InvalidInput(problems)
    return tuple(used.values())


def _possible_samples(path: str | Path, names: Sequence[str], lines: IntArray, samples: FloatArray,
                      remarks: list[str]) -> tuple[IntArray, FloatArray]:
    """Return lines and samples without implausible ones; time must increase."""
    time_s = samples[:, 0]
    at = int(np.argmin(np.isfinite(time_s)))
    if not np.isfinite(time_s[at]):
        raise InvalidInput(f'{path}, line {lines[at]}: time_s: {time_s[at]:g} is not a time')
    falls = np.flatnonzero(np.diff(time_s) <= 0.0)
    if falls.size:
        at = falls[0] + 1
        raise InvalidInput(f'{path}, line {lines[at]}: time_s: {time_s[at]:g} is not after '
                           f'{time_s[at - 1]:g} of the previous sample')
    good = np.ones(len(samples), dtype=bool)
    for name, values in zip(names[1:], samples.T[1:]):
        column = COLUMNS[name]
        low, high = POSSIBLE[column.quantity]
        bad = ~((values >= low) & (values <= high))
        if bad.any():
            at, count = int(np.argmax(bad)), int(bad.sum())
            more = f' (and {count - 1} more lines)' if count > 1 else ''
            remarks.append(f'{path}, line {lines[at]}: {name}: {column.own(values[at]):g} is '
                           f'dropped; allowed: {column.own(low):g} ... {column.own(high):g}{more}')
            good &= ~bad
    if good.sum() < 2:
        raise InvalidInput(f'{path}: has {int(good.sum())} valid samples; at least 2 '
                           'are needed')
    return lines[good], samples[good]


def _segments(path: str | Path, names: Sequence[str], lines: IntArray, samples: FloatArray,
              defaults: Defaults, remarks: list[str]) -> dict[str, FloatArray]:
    """Return the columns of Route, one segment per sample; gaps are bridged."""
    logged_s = samples[:, 0]
    time_s = _bridged(path, lines, logged_s, remarks)
    log = {COLUMNS[name].quantity: values for name, values in zip(names, samples.T)}
    power_w = log['power_w'] if 'power_w' in log else log['voltage_v'] * log['current_a']
    auxiliary_w = log.get('aircon_w', 0.0) + np.full(len(logged_s), defaults.auxiliary_power_w)

    def over_gaps(values: FloatArray) -> FloatArray:
        return np.interp(time_s, logged_s, values)

    # The last sample is valid for the usual sampling time.
    interval_s = min(float(np.median(np.diff(logged_s))), LONGEST_INTERVAL_S)
    return {
        'duration_s': np.diff(time_s, append=time_s[-1] + interval_s),
        'speed_mps': over_gaps(log['speed_mps']),
        'propulsion_power_w': over_gaps(power_w - log['cabin_heater_w'] - auxiliary_w),
        'ambient_temperature_c': over_gaps(log['ambient_c']),
        'cabin_heating_power_w': over_gaps(log['cabin_heater_w']),
        'auxiliary_power_w': over_gaps(auxiliary_w),
    }


def _bridged(path: str | Path, lines: IntArray, time_s: FloatArray,
             remarks: list[str]) -> FloatArray:
    """Return the instants of the samples, with extra ones about a second apart in the gaps."""
    lengths_s = np.diff(time_s)
    gaps = np.flatnonzero(lengths_s > LONGEST_INTERVAL_S)
    # Both ends of a gap have samples; those between are missing.
    missing_s = float(np.sum(lengths_s[gaps] - 1.0))
    allowed_s = MOST_BRIDGED * (time_s[-1] - time_s[0])
    described = [f'{path}, line {lines[at + 1]}: {lengths_s[at]:g} s without a valid sample, from '
                 f'{time_s[at]:g} s to {time_s[at + 1]:g} s' for at in gaps]
    too_long = [f'{gap}; at most {LONGEST_GAP_S:g} s are bridged'
                for gap, at in zip(described, gaps) if lengths_s[at] > LONGEST_GAP_S]
    if too_long:
        raise InvalidInput(too_long)
    if missing_s > allowed_s:
        raise InvalidInput(f'{path}: {missing_s:g} s without samples, in {len(gaps)} gaps; at most '
                           f'{allowed_s:g} s, {MOST_BRIDGED:.0%} of the log, are bridged')
    remarks += [f'{gap}, are bridged' for gap in described[:MOST_GAPS_NAMED]]
    if len(gaps) > MOST_GAPS_NAMED:
        remarks.append(f'{path}: {len(gaps) - MOST_GAPS_NAMED} more gaps are bridged')
    inserted = [np.linspace(time_s[at], time_s[at + 1], int(np.ceil(lengths_s[at])) + 1)[1:-1]
                for at in gaps]
    return np.sort(np.concatenate([time_s, *inserted]))
