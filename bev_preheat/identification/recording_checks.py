# SPDX-License-Identifier: Apache-2.0
"""Signals of a recording that are missing, impossible, stuck, or contradict each other: one sentence for each."""

from __future__ import annotations

from collections.abc import Mapping
import math

import numpy as np

from bev_preheat.errors import figure, InvalidInput
from bev_preheat.logs.doubts import find_doubts, held_while_driving, integral, turned
from bev_preheat.logs.recording import Recording, Series
from bev_preheat.logs.signal_map import PLAUSIBLE
from bev_preheat.logs.unit_hypotheses import JUMP_K, JUMP_S
from bev_preheat.numerics import first_true, FloatArray, S_PER_H
from bev_preheat.vehicle.description import Vehicle

Signals = Mapping[str, Series]

# Valid range of a sample, in the signal's own unit: that of a reading, but without speeds in a wrong unit.
POSSIBLE = PLAUSIBLE | {'soc': (0.0, 1.0), 'speed_mps': (0.0, 100.0)}
# A state of charge that stays the same while this share of the vehicle's capacity flows is stuck.
STUCK_SOC_SHARE = 0.05
# A current that stays the same while the speed changes by this [m/s] is stuck.
LEAST_SPEED_CHANGE_MPS = 5.0
# A level is the median of this number of readings.
OF_LEVEL = 9
# Signals whose unit or sign decides a fit.
DECISIVE = ('battery_temperature_c', 'soc', 'current_a', 'power_w', 'battery_heater_w')
POWER = ('voltage_v', 'current_a', 'power_w')


def problems_of(recording: Recording, signals: Signals, vehicle: Vehicle) -> list[str]:
    """Return a sentence for each reason why a Recording with these signals is no trip of a car like `vehicle`."""
    name = recording.name
    impossible = _missing(recording, signals) + _implausible(name, signals)
    if not impossible and (sentence := held_while_driving(signals)):
        return [f'{name}: {sentence}']
    if not impossible and (sentence := turned(signals)):
        return [f'{name}: {sentence}; read the log with repair (--repair) or a signal map']
    return impossible or _stuck(name, signals, vehicle)


def _missing(recording: Recording, signals: Signals) -> list[str]:
    """Return one sentence for each signal that a trip needs and a Recording has not, with what to record."""
    has_power = 'power_w' in signals or {'voltage_v', 'current_a'} <= signals.keys()
    needed: list[tuple[str, str, tuple[str, ...]]] = [(key, advice, (key,)) for key, advice in (
        ('battery_temperature_c', "record the battery's temperature, or write its values at the begin and "
         'the end as a log of two rows'),
        ('soc', 'record the state of charge'),
        ('ambient_c', 'record the outside temperature')) if key not in signals]
    if not has_power:
        needed.append(('power', 'record voltage_v and current_a, or power_w', POWER))
    return [f'{recording.name}: no {what}; {advice}{reason_of(recording, *keys)}' for what, advice, keys in needed]


def reason_of(recording: Recording, *keys: str) -> str:
    """Return ' (…)' with the first remark of the reading on one of the signals `keys`; '' without."""
    said = (remark for remark in recording.remarks for key in keys if f' {key}: ' in remark)
    return next((f' ({remark})' for remark in said), '')


def refuse_doubted(recording: Recording) -> None:
    """Raise InvalidInput with one sentence for each doubt about a signal that decides a fit."""
    doubts = {doubt.signal: doubt.sentence for doubt in find_doubts(recording.signals) if doubt.signal in DECISIVE}
    if 'current_a' in doubts:
        # The power is often computed from it.
        doubts.pop('power_w', None)
    if doubts:
        raise InvalidInput([*(f'{recording.name}: {doubt}{"" if doubt.endswith("?") else ";"} correct it in the '
                              'log, with repair (--repair) or with a signal map' for doubt in doubts.values()),
                            *(remark for remark in recording.remarks if ': heater_w: ' in remark)])


def _implausible(name: str, signals: Signals) -> list[str]:
    problems = []
    for key, series in signals.items():
        low, high = POSSIBLE.get(key, (-math.inf, math.inf))
        if (at := first_true((series.value < low) | (series.value > high))) is not None:
            problems.append(f'{name}: {key}: {figure(float(series.value[at]))} after {series.time_s[at]:.0f} s; '
                            f'it must be {low:g} ... {high:g}')
    return problems


def _stuck(name: str, signals: Signals, vehicle: Vehicle) -> list[str]:
    """Return sentences on signals that stay the same, or jump, as no battery of a car like `vehicle` does."""
    problems = []
    soc, current, speed = (signals.get(key) for key in ('soc', 'current_a', 'speed_mps'))
    charge, constant_a = _only_value(soc), _only_value(current)
    if soc is not None and charge is not None and current is not None:
        # Long intervals without samples count nothing.
        part = current.part((current.time_s >= soc.time_s[0]) & (current.time_s <= soc.time_s[-1]))
        drawn_ah = float(integral(part)[-1] / S_PER_H) if len(part.value) else 0.0
        if abs(drawn_ah) > STUCK_SOC_SHARE * vehicle.battery.capacity_ah:
            problems.append(f'{name}: soc: stays at {figure(charge, 4)} while {drawn_ah:+.1f} Ah are drawn; '
                            'record the state of charge')
    constant_v = _only_value(signals.get('voltage_v'))
    if constant_v is not None and constant_a is None and current is not None:
        problems.append(f'{name}: voltage_v: stays at {constant_v:.1f} V while the current changes; record the '
                        "battery's voltage")
    if constant_a is not None and speed is not None and np.ptp(speed.value) > LEAST_SPEED_CHANGE_MPS:
        problems.append(f'{name}: current_a: stays at {figure(constant_a, 4)} A while the car drives; record the '
                        "battery's current")
    return problems + _jumps(name, signals.get('battery_temperature_c'))


def _only_value(series: Series | None) -> float | None:
    """Return the value of a signal that always has the same; None if it changes or was not recorded."""
    stays = series is not None and len(series.value) > 1 and np.ptp(series.value) == 0.0
    return float(series.value[0]) if series is not None and stays else None


def _jumps(name: str, series: Series | None) -> list[str]:
    """Return a sentence on the first lasting jump of the battery temperature."""
    if series is None or len(series.value) < 2 * OF_LEVEL:
        return []
    levels_c = np.median(np.lib.stride_tricks.sliding_window_view(series.value, OF_LEVEL), axis=1)
    jumps_k: FloatArray = levels_c[OF_LEVEL:] - levels_c[:-OF_LEVEL]
    # From the last reading of one level to the first of the next.
    quick = np.diff(series.time_s)[OF_LEVEL - 1:OF_LEVEL - 1 + len(jumps_k)] <= JUMP_S
    steps_k = np.diff(series.value)[OF_LEVEL - 1:OF_LEVEL - 1 + len(jumps_k)]
    found = np.flatnonzero(quick & (np.abs(jumps_k) > JUMP_K) & (np.abs(steps_k) > JUMP_K))
    if not len(found):
        return []
    at = int(found[0]) + OF_LEVEL
    return [f'{name}: battery_temperature_c: jumps from {series.value[at - 1]:.1f} to {series.value[at]:.1f} degC '
            f'after {series.time_s[at - 1]:.0f} s; no battery warms or cools so fast; cut the log there, or drop '
            'the wrong readings']
