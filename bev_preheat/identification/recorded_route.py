# SPDX-License-Identifier: Apache-2.0
"""Builds a Route from drive logs with speed, ambient temperature and the battery's power; the rest is optional."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bev_preheat.errors import figure, InvalidInput, located
from bev_preheat.logs.doubts import held_while_driving, turned
from bev_preheat.logs.reading import read_recording
from bev_preheat.logs.recording import gaps, LEAST_GAP_S, Recording, Series
from bev_preheat.logs.signal_map import SignalMap
from bev_preheat.numerics import FloatArray
from bev_preheat.route.segments import make_route, Route
from bev_preheat.vehicle.description import Defaults, STANDING_MPS

# Signals that a route is made of, or that reveal mix-ups of these.
USED = ('speed_mps', 'ambient_c', 'power_w', 'voltage_v', 'current_a', 'soc', 'battery_temperature_c', 'heater_w',
        'battery_heater_w', 'cabin_heater_w', 'auxiliary_w', 'aircon_w', 'latitude_deg', 'longitude_deg',
        'odometer_m')
# Longest gap that is bridged [s], or as many usual intervals, and the largest share of a log that is bridged.
BRIDGED_GAP_S, BRIDGED_GAP_INTERVALS = 10.0, 4.0
MOST_BRIDGED = 0.2
# Longest usual interval [s]; from SLOW_S on, the variation between the samples is unknown.
LONGEST_INTERVAL_S, SLOW_S = 40.0, 5.0
# A car at stand that takes more power than this for longer is charged.
LEAST_CHARGED_W, LEAST_CHARGED_S = 1000.0, 60.0
# Instants closer than this [s] become one.
SHORTEST_STEP_S = 0.05


@dataclass(frozen=True)
class LoggedRoute:
    """The Route of one or more drive logs, and a sentence for each problem found in them."""

    route: Route
    remarks: tuple[str, ...]


def load_drive_logs(paths: Iterable[str | Path], defaults: Defaults, step_s: float = 30.0,
                    signals: str | Path | SignalMap | None = None, repair: bool = False) -> LoggedRoute:
    """
    Return the LoggedRoute of drive logs, joined in the given order, in segments of `step_s`.

    Propulsion power is the terminal power minus heaters, air conditioning and auxiliaries; without a cabin heater
    or auxiliaries in the log, those of `defaults` (vehicle.description.Defaults) count. A sample holds until the
    next one; gaps up to BRIDGED_GAP_S or BRIDGED_GAP_INTERVALS are bridged by linear interpolation. `signals` and
    `repair` as for `read_recording`.

    Raises InvalidInput naming file, place and limit: missing signals, a doubt about the sign of power or current,
    a power that is held, charging at stand, gaps too long or too many.
    """
    if not 1.0 <= step_s <= 3600.0:
        raise InvalidInput(f'step: {step_s:g} s is not allowed; it must be 1 ... 3600 s')
    remarks: list[str] = []
    pieces = []
    for path in paths:
        recording = read_recording(path, signals, repair, USED)
        remarks += recording.remarks
        if sentence := held_while_driving(recording.signals):
            raise InvalidInput(f'{path}: {sentence}')
        # Otherwise the route would gain energy.
        if sentence := turned(recording.signals):
            raise InvalidInput(f'{path}: {sentence}; read the log with repair (--repair) or a signal map')
        pieces.append(_segments(path, recording, defaults, remarks))
    columns = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    described = ', '.join(map(str, paths))
    with located(described):
        route = make_route(columns, defaults).resampled(step_s)
    if route.propulsion_power_w @ route.duration_s < 0.0:
        remarks.append(f'{described}: net regeneration over the log; is the current really '
                       'positive when the battery is discharged?')
    return LoggedRoute(route, tuple(remarks))


def _segments(path: str | Path, recording: Recording, defaults: Defaults,
              remarks: list[str]) -> dict[str, FloatArray]:
    """Return the columns of Route, one segment a sample."""
    found = recording.signals
    missing = [f'{name}{" (or voltage_v and current_a)" if name == "power_w" else ""}'
               for name in ('speed_mps', 'ambient_c', 'power_w') if name not in found]
    if missing:
        raise InvalidInput([f'{path}: has no {", no ".join(missing)}; signals found: {", ".join(found)}; name its '
                            'channel in a signal map (--signals), or rename the column', *recording.remarks])
    time_s, usual_s = _instants(path, found['speed_mps'], found['power_w'], remarks)

    cabin_w, battery_w = _heaters(path, recording, defaults, time_s, remarks)
    charged_s = time_s[(found['speed_mps'].at(time_s) < STANDING_MPS)
                       & (found['power_w'].at(time_s) < -LEAST_CHARGED_W)]
    if len(charged_s) * usual_s > LEAST_CHARGED_S:
        raise InvalidInput(f'{path}: the car is charged at stand, from {figure(charged_s[0])} s to '
                           f'{figure(charged_s[-1])} s; cut this out of the log; drives are joined by --log A B')
    auxiliary_w = np.full(len(time_s), defaults.auxiliary_power_w)
    if 'auxiliary_w' in found:
        if found['auxiliary_w'].value.any():
            auxiliary_w = found['auxiliary_w'].at(time_s)
        else:
            # Loggers write 0 for a value that they do not get.
            remarks.append(f'{path}: auxiliary_w is always 0; auxiliaries '
                           f'({figure(defaults.auxiliary_power_w)} W) are those of the vehicle')
    if 'aircon_w' in found:
        auxiliary_w = auxiliary_w + found['aircon_w'].at(time_s)
    return {
        'duration_s': np.diff(time_s, append=time_s[-1] + usual_s), 'speed_mps': found['speed_mps'].at(time_s),
        'propulsion_power_w': found['power_w'].at(time_s) - cabin_w - battery_w - auxiliary_w,
        'ambient_temperature_c': found['ambient_c'].at(time_s), 'cabin_heating_power_w': cabin_w,
        'auxiliary_power_w': auxiliary_w}


def _heaters(path: str | Path, recording: Recording, defaults: Defaults, time_s: FloatArray,
             remarks: list[str]) -> tuple[FloatArray, FloatArray]:
    """Return the electrical powers of heating cabin and battery [W] at instants."""
    power_w = {name: recording.signals[name].at(time_s)
               for name in ('heater_w', 'battery_heater_w', 'cabin_heater_w') if name in recording.signals}
    battery_w = power_w.get('battery_heater_w', np.zeros(len(time_s)))
    if 'cabin_heater_w' in power_w:
        return power_w['cabin_heater_w'], battery_w
    if 'heater_w' in power_w:
        if 'battery_heater_w' not in power_w:
            remarks.append(f'{path}: has no cabin_heater_w; all of heater_w is taken to heat the cabin')
        return np.maximum(power_w['heater_w'] - battery_w, 0.0), battery_w
    also = ('' if 'auxiliary_w' in recording.signals else
            f' and auxiliaries ({figure(defaults.auxiliary_power_w)} W)')
    remarks.append(f'{path}: has no cabin_heater_w; cabin heating ({figure(defaults.cabin_heating_power_w)} W)'
                   f'{also} are those of the vehicle')
    return np.full(len(time_s), defaults.cabin_heating_power_w), battery_w


def _instants(path: str | Path, speed: Series, power: Series, remarks: list[str]) -> tuple[FloatArray, float]:
    """Return the instants of the segments [s], extra ones in gaps, and the usual interval [s]."""
    begin_s, end_s = max(speed.time_s[0], power.time_s[0]), min(speed.time_s[-1], power.time_s[-1])
    inside = [series.time_s[(series.time_s >= begin_s) & (series.time_s <= end_s)] for series in (speed, power)]
    fewest = min(map(len, inside))
    if fewest < 2:
        raise InvalidInput(f'{path}: has {fewest} samples of speed and power at the same time; at least 2 are '
                           'needed')
    usual_s = max(float(np.median(np.diff(time_s))) for time_s in inside)
    if usual_s > LONGEST_INTERVAL_S:
        raise InvalidInput(f'{path}: has a sample every {figure(usual_s, 3)} s; at most {LONGEST_INTERVAL_S:g} s '
                           'are allowed')
    if usual_s >= SLOW_S:
        remarks.append(f'{path}: has a sample every {figure(usual_s, 3)} s; a sample holds until the next one, so '
                       'peaks between them are missing')
    _check_gaps(path, {name: Series(time_s, time_s) for name, time_s in zip(('speed_mps', 'power_w'), inside)},
                remarks)
    time_s = np.union1d(*inside)
    while (close := np.diff(time_s) < SHORTEST_STEP_S).any():
        # Of several close instants each second one goes, until none are close.
        gone = np.flatnonzero(close) + 1
        time_s = np.delete(time_s, gone[::2] if len(gone) > 1 else gone)
    steps_s = np.diff(time_s)
    inserted = [np.linspace(time_s[at], time_s[at + 1], max(int(np.ceil(steps_s[at] / usual_s)), 1) + 1)[1:-1]
                for at in np.flatnonzero(steps_s > max(LEAST_GAP_S, 1.5 * usual_s))]
    return np.sort(np.concatenate([time_s, *inserted])), usual_s


def _check_gaps(path: str | Path, sampled: dict[str, Series], remarks: list[str]) -> None:
    """Refuse gaps that are too long or too many; remark on the others, once for signals with the same gaps."""
    described: dict[str, list[str]] = {}
    for name, series in sampled.items():
        steps_s, at = np.diff(series.time_s), np.flatnonzero(gaps(series))
        if not at.size:
            continue
        usual_s, most_s = float(np.median(steps_s)), MOST_BRIDGED * float(np.ptp(series.time_s))
        longest_s = max(BRIDGED_GAP_S, BRIDGED_GAP_INTERVALS * usual_s)
        worst = at[np.argmax(steps_s[at])]
        if steps_s[worst] > longest_s:
            raise InvalidInput(f'{path}: {name}: {figure(steps_s[worst])} s without a valid sample, from '
                               f'{figure(series.time_s[worst])} s to {figure(series.time_s[worst + 1])} s; at '
                               f'most {figure(longest_s)} s are bridged')
        missing_s = float(np.sum(steps_s[at] - usual_s))
        if missing_s > most_s:
            raise InvalidInput(f'{path}: {name}: {figure(missing_s)} s without samples, in {len(at)} gaps; at '
                               f'most {figure(most_s)} s, {MOST_BRIDGED:.0%} of the log, are bridged')
        first = at[0]
        many = f' (and {len(at) - 1} more gaps, {figure(missing_s)} s in all)' if len(at) > 1 else ''
        described.setdefault(
            f'{figure(steps_s[first])} s without a valid sample, from {figure(series.time_s[first])} s to '
            f'{figure(series.time_s[first + 1])} s, are bridged{many}', []).append(name)
    remarks += [f'{path}: {" and ".join(names)}: {text}' for text, names in described.items()]
