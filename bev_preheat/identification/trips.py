# SPDX-License-Identifier: Apache-2.0
"""A recorded trip, charging session or night at stand, on a grid of one second, checked."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from bev_preheat.errors import figure, InvalidInput
from bev_preheat.identification.recording_checks import problems_of
from bev_preheat.logs.recording import Recording, Series
from bev_preheat.numerics import FloatArray
from bev_preheat.vehicle.description import STANDING_MPS, Vehicle

# Sensors of power show slightly negative values when nothing is drawn [W].
MOST_NEGATIVE_NOISE_W = 500.0
SHORTEST_TRIP_S = 120.0
LONGEST_TRIP_S = 3.0 * 86400.0
# From this battery temperature on [deg C] cars cool their batteries; the model of a drive has no cooling.
COOLED_FROM_C = 30.0
# Longest interval between two samples of the power while the car draws more than LEAST_DRAWN_W.
POWER_GAP_S = 30.0
LEAST_DRAWN_W = 2000.0
# At stand the battery's power is below this [W] for more than this share of the time.
IDLE_W, SHARE_OF_STAND = 1000.0, 0.8
# A log at stand does not lose more of its charge than this.
STANDING_SOC_CHANGE = 0.02
# The arrival is the median reading of the last seconds, because a whole-degree sensor flickers.
ARRIVAL_S = 10.0
# A remark on more logs than this gives their number.
MOST_NAMED = 3
# Samples of the temperature count one by one if they are this far apart [s]. A signal that is only sent on a
# change shows something in between as well.
PERIODS_S = 1.0, 300.0
# Between two samples that are farther apart [s] and differ by more [K] than a signal that is sent on changes,
# nothing is known. A sample alone counts like as many readings in a row as have one lasting error.
SPARSE_S, SPARSE_K, ALONE = 300.0, 2.0, 40.0
# State of charge of a log at stand without one: the little power that flows hardly changes its meaning.
UNKNOWN_SOC = 0.5
# After parking the battery also warms its housing and coolant, which a file cannot hold: it predicts a night from
# this time [s] on, or from the middle. A measured night shows 11 W/K as a whole and 8.5 W/K after four hours.
SETTLED_S = 5.0 * 3600.0
# A log without the battery's power is one at stand if it has the heater's power, or lasts this long [s].
LEAST_STAND_S = 3600.0
# Numbers of trips for a fit, and the change of the battery temperature that one trip must have [K].
LEAST_TRIPS, MOST_TRIPS, LEAST_CHANGE_K = 3, 200, 2.0
# Usual steps of a temperature signal.
RESOLUTIONS_K = (1.0, 0.5, 0.25, 0.2, 0.1)


@dataclass(frozen=True, eq=False)
class Trip:
    """
    A recording on a grid of one second; arrays of shape (N,), SI units and deg C.

    `power_w` is the battery's terminal power without `heater_w`, the power of the HVCH for the battery.
    `propulsion_power_w` is the drivetrain's part, 0 at stand. `voltage_v` and `current_a` are None if the
    log has the power only. `temperature_period_s` is the time between two samples of the battery temperature [s].
    `reading_weight` (N,) is how many readings each second counts for, 0 where the temperature between two distant
    samples is not known; None: one a period.
    """

    name: str
    battery_temperature_c: FloatArray
    soc: FloatArray
    power_w: FloatArray
    propulsion_power_w: FloatArray
    cabin_heating_power_w: FloatArray
    heater_w: FloatArray
    speed_mps: FloatArray
    ambient_c: FloatArray
    voltage_v: FloatArray | None
    current_a: FloatArray | None
    remarks: tuple[str, ...] = ()
    temperature_period_s: float = 1.0
    reading_weight: FloatArray | None = None

    def __len__(self) -> int:
        """Return the duration [s], which is the number of samples."""
        return len(self.power_w)

    @cached_property
    def resolution_k(self) -> float:
        """Step of the temperature signal [K]; 0 if it is continuous."""
        return next((step_k for step_k in RESOLUTIONS_K if np.allclose(
            self.battery_temperature_c / step_k, np.round(self.battery_temperature_c / step_k), atol=1e-6)), 0.0)

    @property
    def start_c(self) -> float:
        """First temperature reading [deg C]."""
        return float(self.battery_temperature_c[0])

    @property
    def arrival_c(self) -> float:
        """Measured temperature on arrival [deg C]."""
        last = slice(-int(ARRIVAL_S), None)
        return float(np.median(self.battery_temperature_c[last][self.weights[last] > 0.0]))

    @cached_property
    def weights(self) -> FloatArray:
        """How many readings each second counts for (N,)."""
        return (np.full(len(self), 1.0 / self.temperature_period_s) if self.reading_weight is None
                else self.reading_weight)

    @property
    def arrival_soc(self) -> float:
        """Measured state of charge on arrival."""
        return float(np.median(self.soc[-int(ARRIVAL_S):]))

    @cached_property
    def heats(self) -> bool:
        """Whether the battery is heated during the trip."""
        return bool(self.heater_w.mean() > 50.0)

    @cached_property
    def stands(self) -> bool:
        """Whether hardly any power flows, beside that of a heater which battery or charger feeds."""
        least_w = np.minimum(np.abs(self.power_w), np.abs(self.power_w + self.heater_w))
        return bool(np.mean(least_w < IDLE_W) > SHARE_OF_STAND)

    @cached_property
    def charges(self) -> bool:
        """Whether the battery is charged at stand."""
        net_w = float((self.power_w + self.heater_w).mean())
        return net_w < -1000.0 and float(self.speed_mps.max()) < STANDING_MPS

    @property
    def kind(self) -> str:
        """`night at stand`, `heated at stand`, `charging session` or `drive`."""
        if self.charges:
            return 'charging session'
        return 'drive' if not self.stands else 'heated at stand' if self.heats else 'night at stand'

    @property
    def settled(self) -> Trip:
        """Return the part of a night that a file can predict; other trips as they are."""
        begin = min(int(SETTLED_S), len(self) // 2)
        if self.kind != 'night at stand' or len(self) - begin < SHORTEST_TRIP_S:
            return self
        cut: dict[str, Any] = {field.name: value[begin:] for field in fields(self)
                               if isinstance(value := getattr(self, field.name), np.ndarray)}
        return replace(self, **cut)

    def means(self, values: FloatArray, edges: FloatArray) -> FloatArray:
        """Return the means of values (N,) between whole seconds `edges` (M + 1,), shape (M,)."""
        total = np.concatenate(([0.0], np.cumsum(values)))
        return np.asarray(np.diff(total[edges.astype(int)]) / np.diff(edges))


def trips_of(recordings: Iterable[Recording], vehicle: Vehicle) -> list[Trip]:
    """Return the Trips of recordings; raise InvalidInput with one problem for each recording that is refused."""
    return trips_from(partial(trip_of, recording, vehicle) for recording in recordings)


def trips_from(makers: Iterable[Callable[[], Trip]]) -> list[Trip]:
    """Return the Trips that functions return; raise InvalidInput with the problems of all that raise it."""
    trips, problems = [], []
    for make in makers:
        try:
            trips.append(make())
        except InvalidInput as error:
            problems += error.problems
    for number, trip in enumerate(trips):
        twin = next((other for other in trips[:number] if np.array_equal(other.power_w, trip.power_w)
                     and np.array_equal(other.battery_temperature_c, trip.battery_temperature_c)), None)
        if twin is not None:
            problems.append(f'{trip.name}: is the same recording as {twin.name}; name each log once')
    if problems:
        raise InvalidInput(problems)
    return trips


def trip_of(recording: Recording, vehicle: Vehicle) -> Trip:
    """Return the Trip of a Recording, completed by powers of `vehicle`; raise InvalidInput with the value."""
    name = recording.name
    signals, at_stand = _at_stand(_without_noise(recording.signals))
    if problems := problems_of(recording, signals, vehicle):
        raise InvalidInput(problems)
    has_voltage = 'voltage_v' in signals and 'current_a' in signals
    of_power = ('voltage_v', 'current_a') if has_voltage else ('power_w',)
    needed = ('battery_temperature_c', 'soc', *of_power)
    firsts, lasts = ({key: signals[key].time_s[at] for key in needed} for at in (0, -1))
    late, early = max(needed, key=firsts.__getitem__), min(needed, key=lasts.__getitem__)
    start_s, end_s, hole = _longest_part(signals, of_power, firsts[late], lasts[early])
    used = f'only {start_s:.0f} ... {end_s:.0f} s are used'
    cut = [f'{key}: {verb} after {at_s:.0f} s; {used}' for key, verb, at_s, lost_s in (
        (late, 'begins', firsts[late], firsts[late] - min(firsts.values())),
        (early, 'ends', lasts[early], max(lasts.values()) - lasts[early])) if lost_s > SHORTEST_TRIP_S]
    if end_s - start_s < SHORTEST_TRIP_S:
        raise InvalidInput(f'{name}: {", ".join(needed)} together last {max(end_s - start_s, 0.0):.0f} s; a log '
                           f'must last at least {SHORTEST_TRIP_S:.0f} s{f" ({hole})" if hole else ""}')
    if end_s - start_s > LONGEST_TRIP_S:
        raise InvalidInput(f'{name}: lasts {figure((end_s - start_s) / 3600.0, 3)} h; at most '
                           f'{LONGEST_TRIP_S / 3600.0:.0f} h are allowed; cut it into trips')
    grid_s = np.arange(np.floor(end_s - start_s) + 1.0) + start_s

    def held(key: str) -> FloatArray:
        series = signals[key]
        at = np.searchsorted(series.time_s, grid_s, side='right') - 1
        return np.asarray(series.value[np.maximum(at, 0)])

    remarks = [*map(partial(_without_path, name), recording.remarks), *at_stand, *cut, *filter(None, (hole,))]
    voltage_v, current_a = (signals[key].at(grid_s) if has_voltage else None for key in ('voltage_v', 'current_a'))
    has_speed = 'speed_mps' in recording.signals
    speed_mps = signals['speed_mps'].at(grid_s) if has_speed else np.zeros_like(grid_s)
    if not has_speed and not at_stand:
        remarks.append('no speed: leakage with speed cannot be identified')
    heater_w = held('battery_heater_w') if 'battery_heater_w' in signals else np.zeros_like(grid_s)
    cabin_w, auxiliary_w = (np.zeros_like(grid_s), np.zeros_like(grid_s)) if at_stand else _others(
        signals, held, heater_w, vehicle, remarks)
    idle_w = _product(signals, of_power, grid_s) - heater_w
    propulsion_w = signals['propulsion_power_w'].at(grid_s) if 'propulsion_power_w' in signals else (
        idle_w - cabin_w - auxiliary_w)
    standing = speed_mps < STANDING_MPS if has_speed else np.full(
        len(grid_s), bool(at_stand) or idle_w.mean() < 0.0)
    temperature_c, weight = _readings(signals['battery_temperature_c'], grid_s, held('battery_temperature_c'))
    if np.max(temperature_c) > COOLED_FROM_C:
        remarks.append(f'battery above {COOLED_FROM_C:.0f} degC: leave the log out if the car cools it there')
    return Trip(name, temperature_c, held('soc'), idle_w, np.where(standing, 0.0, propulsion_w),
                cabin_w, heater_w, speed_mps, signals['ambient_c'].at(grid_s), voltage_v, current_a,
                tuple(remarks), _period_s(signals['battery_temperature_c'].time_s), weight)


def _at_stand(signals: dict[str, Series]) -> tuple[dict[str, Series], list[str]]:
    """
    Return the signals of a log at stand with state of charge and power, and a remark for each that was missing.

    A night, and a battery that is heated from a charger, give leakage and heat capacity without both. Other logs
    are returned as they are, without remarks.
    """
    temperature, speed = signals.get('battery_temperature_c'), signals.get('speed_mps')
    if temperature is None or not len(temperature.value) or (
            speed is not None and len(speed.value) and float(np.max(np.abs(speed.value))) >= STANDING_MPS):
        return signals, []
    has_power = 'power_w' in signals or {'voltage_v', 'current_a'} <= signals.keys()
    heater, ends_s = signals.get('battery_heater_w'), temperature.time_s[[0, -1]]
    completed, remarks = dict(signals), []
    if has_power:
        if 'soc' in signals or not _hardly_any_power(signals):
            return signals, []
    elif ('soc' in signals and float(np.ptp(signals['soc'].value)) > STANDING_SOC_CHANGE) or (
            heater is None and ends_s[1] - ends_s[0] < LEAST_STAND_S):
        return signals, []
    else:
        # What heats the battery comes from the charger.
        time_s = ends_s if heater is None else heater.time_s
        completed['power_w'] = Series(time_s, np.zeros(len(time_s)))
        remarks.append('no power: taken as at stand' + ('' if heater is None else ', heated from a charger'))
    if 'soc' in signals:
        # Logged on change, the last reading holds.
        completed['soc'] = Series(ends_s, signals['soc'].at(ends_s))
    else:
        completed['soc'] = Series(ends_s, np.full(2, UNKNOWN_SOC))
        remarks.append(f'no soc: {UNKNOWN_SOC:g} is taken; at stand it hardly matters')
    return completed, remarks


def _hardly_any_power(signals: Mapping[str, Series]) -> bool:
    """Return whether the battery's power without the heater's is below that of a standing car."""
    of_power = ('power_w',) if 'power_w' in signals else ('current_a', 'voltage_v')
    time_s = signals[of_power[0]].time_s
    return len(time_s) > 0 and float(
        np.mean(np.abs(_product(signals, of_power, time_s)) < IDLE_W)) > SHARE_OF_STAND


def _product(signals: Mapping[str, Series], keys: Sequence[str], time_s: FloatArray) -> FloatArray:
    """Return the product of signals at instants: of voltage and current, or the power itself."""
    return np.asarray(np.prod([signals[key].at(time_s) for key in keys], axis=0))


def _readings(series: Series, grid_s: FloatArray, held_c: FloatArray) -> tuple[FloatArray, FloatArray | None]:
    """
    Return the battery temperature (N,) [deg C], and how many readings each second counts for.

    None: every second of a signal is a reading. Between distant samples the temperature is linear, and no reading.
    """
    time_s, value = series.time_s, series.value
    apart = (np.diff(time_s) > SPARSE_S) & (np.abs(np.diff(value)) > SPARSE_K)
    if not apart.any():
        return held_c, None
    at = np.clip(np.searchsorted(time_s, grid_s, side='right') - 1, 0, len(apart) - 1)
    unknown = apart[at] & (grid_s < time_s[-1])
    temperature_c = np.where(unknown, np.interp(grid_s, time_s, value), held_c)
    weight = np.where(unknown, 0.0, 1.0 / _period_s(time_s))
    known_before, known_after = np.append(~apart, False), np.insert(~apart, 0, False)
    for alone_s in time_s[~known_before & ~known_after]:
        weight[min(int(np.searchsorted(grid_s, alone_s)), len(grid_s) - 1)] = ALONE
    return temperature_c, weight


def _without_path(name: str, remark: str) -> str:
    """Return a remark without the path of its log, whose name stands before it anyway."""
    path, _, rest = remark.partition(': ')
    return rest if rest and name in path else remark


def _period_s(time_s: FloatArray) -> float:
    """Return the usual time between two samples [s], within the range that counts."""
    low_s, high_s = PERIODS_S
    return float(np.clip(np.median(np.diff(time_s)), low_s, high_s)) if len(time_s) > 1 else high_s


def _others(signals: Mapping[str, Series], held: Callable[[str], FloatArray], battery_w: FloatArray,
            vehicle: Vehicle, remarks: list[str]) -> tuple[FloatArray, FloatArray]:
    """
    Return the power of cabin heating and auxiliaries (N,) [W]; the vehicle's defaults where the log has none.

    `battery_w` (N,) is the share of `heater_w` that heats the battery.
    """
    values = []
    for key, default_w in (('cabin_heater_w', vehicle.defaults.cabin_heating_power_w),
                           ('auxiliary_w', vehicle.defaults.auxiliary_power_w)):
        if key in signals:
            values.append(held(key))
        elif key == 'cabin_heater_w' and 'heater_w' in signals:
            values.append(np.maximum(held('heater_w') - battery_w, 0.0))
            if 'battery_heater_w' not in signals and values[-1].any():
                remarks.append('heater_w serves cabin and battery; it is taken as cabin heating')
        elif key == 'auxiliary_w' and 'aircon_w' in signals:
            values.append(default_w + held('aircon_w'))
        else:
            remarks.append(f"no {key}: the vehicle file's {default_w:g} W are used")
            values.append(np.full_like(battery_w, default_w))
    return values[0], values[1]


def _without_noise(signals: Mapping[str, Series]) -> dict[str, Series]:
    """Return the signals, with slightly negative powers of consumers set to 0."""
    cleaned = dict(signals)
    for key in ('battery_heater_w', 'cabin_heater_w', 'auxiliary_w', 'aircon_w', 'heater_w'):
        if key in cleaned and np.all(cleaned[key].value > -MOST_NEGATIVE_NOISE_W):
            cleaned[key] = Series(cleaned[key].time_s, np.maximum(cleaned[key].value, 0.0))
    return cleaned


def _longest_part(signals: Mapping[str, Series], keys: Sequence[str], begin_s: float,
                  end_s: float) -> tuple[float, float, str]:
    """
    Return begin and end [s] of the longest part without a hole, and a remark on the holes ('' without).

    A hole is where a signal of the power has no sample for long while the car draws power.
    """
    holes: list[tuple[float, float, str]] = []
    for key in keys:
        time_s = signals[key].time_s
        for at in np.flatnonzero(np.diff(time_s) > POWER_GAP_S):
            around_s = time_s[at:at + 2]
            draws = (np.abs(_product(signals, keys, around_s)) > LEAST_DRAWN_W).any()
            if draws and around_s[0] < end_s and around_s[1] > begin_s:
                holes.append((float(around_s[0]), float(around_s[1]), key))
    if not holes:
        return begin_s, end_s, ''
    edges, at_s = [], begin_s
    for from_s, to_s, _ in sorted(holes):
        edges.append((at_s, max(from_s, at_s)))
        at_s = max(to_s, at_s)
    own_s, until_s = max((*edges, (at_s, end_s)), key=lambda part: part[1] - part[0])
    from_s, to_s, key = max(holes, key=lambda hole: hole[1] - hole[0])
    return own_s, until_s, (
        f'{key}: no sample for {to_s - from_s:.0f} s after {from_s:.0f} s while the car draws power (at most '
        f'{POWER_GAP_S:.0f} s): only {own_s:.0f} ... {until_s:.0f} s are used')


def common_remarks(trips: Iterable[Trip]) -> tuple[str, ...]:
    """Return the remarks on Trips, each once, with the names of the trips or their number."""
    names: dict[str, list[str]] = {}
    for trip in trips:
        for remark in trip.remarks:
            names.setdefault(remark, []).append(trip.name)
    return tuple(f'{", ".join(found) if len(found) <= MOST_NAMED else f"{len(found)} logs"}: {remark}'
                 for remark, found in names.items())


def refuse_poor(trips: Sequence[Trip]) -> None:
    """Raise InvalidInput with a sentence for each reason why no car can be identified from Trips."""
    problems = []
    has_drive = any(trip.kind == 'drive' for trip in trips)
    if not trips or (has_drive and len(trips) < LEAST_TRIPS):
        problems.append(f'{len(trips)} usable log{"" if len(trips) == 1 else "s"}; at least {LEAST_TRIPS} are '
                        'needed with drives, because each is predicted from the others; record more drives')
    if len(trips) > MOST_TRIPS:
        problems.append(f'{len(trips)} logs; at most {MOST_TRIPS} are fitted; leave out the shortest')
    changes_k = [float(np.ptp(trip.battery_temperature_c)) for trip in trips]
    if trips and max(changes_k) < LEAST_CHANGE_K:
        problems.append(f'battery_temperature_c changes by at most {max(changes_k):.1f} K within a log; at least '
                        f'{LEAST_CHANGE_K:g} K are needed; record drives of 20 min or more with a cold battery, '
                        'or a night at stand after a drive')
        problems += [remark for remark in common_remarks(trips) if 'are used' in remark]
    if trips and all(trip.kind == 'charging session' for trip in trips):
        problems.append('none of the logs is a drive, a night or heated at stand; record at least one drive of '
                        '20 min')
    if problems:
        raise InvalidInput(problems)
