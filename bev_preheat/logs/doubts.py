# SPDX-License-Identifier: Apache-2.0
"""Mix-ups of sign, unit and scale, revealed by physics: charge and energy balances, distances, magnitudes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from bev_preheat.errors import figure
from bev_preheat.logs.recording import Series
from bev_preheat.numerics import BoolArray, EARTH_RADIUS_M, FloatArray

# Intervals longer than this [s] have no known charge, energy or distance.
LONGEST_HOLD_S = 120.0
# Distance that determines a speed's unit [m], and the agreement that a unit must reach.
UNIT_TELLING_M, AGREEMENT = 500.0, 0.08


def integral(series: Series) -> FloatArray:
    """Return the integral of a signal up to each sample, shape (N,); long intervals count nothing."""
    step_s = np.diff(series.time_s)
    means = 0.5 * (series.value[1:] + series.value[:-1])
    return np.concatenate([[0.0], np.cumsum(np.where(step_s <= LONGEST_HOLD_S, step_s, 0.0) * means)])


def changes(series: Series, beside: Series) -> FloatArray:
    """Return a signal's changes from sample to sample, shape (N,); 0 in those long intervals of another signal."""
    step_s = np.diff(beside.time_s, prepend=beside.time_s[0])
    unknown_s = np.interp(series.time_s, beside.time_s, np.cumsum(np.where(step_s > LONGEST_HOLD_S, step_s, 0.0)))
    return np.where(np.diff(unknown_s, prepend=unknown_s[0]) > 0.0, 0.0,
                    np.diff(series.value, prepend=series.value[0]))


def by_position(signals: Mapping[str, Series]) -> Series | None:
    """Return the distance by latitude and longitude [m], None without these."""
    if not {'latitude_deg', 'longitude_deg'} <= signals.keys():
        return None
    latitude, longitude = signals['latitude_deg'], signals['longitude_deg']
    north = np.radians(latitude.value)
    east = np.radians(longitude.at(latitude.time_s, np.nan))
    step_s = np.diff(latitude.time_s)
    steps_m = EARTH_RADIUS_M * np.hypot(np.diff(north), np.diff(east) * np.cos(0.5 * (north[1:] + north[:-1])))
    # Jumps of the receiver are no drives.
    steps_m = np.where(np.isfinite(steps_m) & (steps_m <= 70.0 * np.maximum(step_s, 1.0))
                       & (step_s <= LONGEST_HOLD_S), steps_m, 0.0)
    return Series(latitude.time_s, np.concatenate([[0.0], np.cumsum(steps_m)]))


def distances(driven: Series, other: Series) -> tuple[float, float] | None:
    """Return two distances [m] in the time that both series cover, None if they are short."""
    inside = (other.time_s >= driven.time_s[0]) & (other.time_s <= driven.time_s[-1])
    if inside.sum() < 2:
        return None
    ends = other.time_s[inside][[0, -1]]
    other_m = float(np.ptp(other.value[inside]))
    own_m = float(np.diff(driven.at(ends))[0])
    return (own_m, other_m) if other_m >= UNIT_TELLING_M and own_m > 0.0 else None


Signals = Mapping[str, Series]
SECONDS_PER_HOUR, J_PER_KWH = 3600.0, 3.6e6
# A change of the state of charge that is clearly more than its resolution, and a clear correlation with the
# charge.
CLEAR_SOC_CHANGE, LEAST_CORRELATION = 0.015, 0.7
# Capacities of vehicles' batteries [Ah] and [kWh], from a small hybrid's to a heavy truck's.
CAPACITIES_AH, CAPACITIES_KWH = (8.0, 2000.0), (3.0, 1000.0)
# Typical ones, nearest to which a scale is guessed.
TYPICAL_AH, TYPICAL_KWH = 150.0, 60.0
# A car that moves draws so much in the mean, unless the road falls by this grade.
MOVING_MPS, LEAST_DRIVING_W, LEAST_DRIVING_A, REGENERATING_GRADE = 3.0, 500.0, 2.0, 0.01
# The power of a moving car changes within this time [s], and within so many readings.
LONGEST_STEADY_S, MOST_STEADY = 300.0, 20
# Steps of the current from here on [A], and their number, show the sign of the current in the voltage.
LEAST_CURRENT_STEP_A, LEAST_STEPS = 5.0, 20
# Correlation of power and acceleration that shows the sign of the power.
LEAST_RESPONSE = 0.3
# Power over voltage times current mostly deviates less, if they differ by a factor such as three phases.
SAME_RATIO = 0.1
# Mistaken units of a speed, by the factor that corrects the mistake.
SPEED_FACTORS = {1.0 / 3.6: 'km/h taken as m/s', 3.6: 'm/s taken as km/h', 1.609344: 'mph taken as km/h',
                 1.0 / 1.609344: 'km/h taken as mph', 0.44704: 'mph taken as m/s',
                 1.0 / 0.44704: 'm/s taken as mph'}
ODOMETER_FACTORS = {1.609344: 'miles taken as km', 1.0 / 1.609344: 'km taken as miles'}
# Hardest changes of speed on the road [m/s2], and the fastest usual travel [m/s].
HARDEST_MPS2, FASTEST_TRAVEL_MPS = 6.0, 62.0
# A temperature that exceeds the other by more than CELSIUS_K is in degF, if it then differs by less than
# FAHRENHEIT_K.
CELSIUS_K, FAHRENHEIT_K = 22.0, 15.0
HOTTEST_PARKED_C, HOTTEST_C = 40.0, 52.0
# The largest power of a heater that was on at some time.
LEAST_HEATER_W = 25.0
HEATERS = ('heater_w', 'battery_heater_w', 'cabin_heater_w', 'aircon_w')


@dataclass(frozen=True)
class Doubt:
    """A doubt about a signal, and its linear correction; not clear if another correction would do as well."""

    signal: str
    sentence: str
    factor: float = 1.0
    offset: float = 0.0
    is_clear: bool = True

    def repaired(self, series: Series) -> Series:
        """Return the corrected Series."""
        return Series(series.time_s, self.factor * series.value + self.offset)


def find_doubts(signals: Signals) -> tuple[Doubt, ...]:
    """Return the Doubts about a recording's signals, at most one for each signal."""
    found: dict[str, Doubt] = {}
    for check in CHECKS:
        for doubt in check(signals):
            found.setdefault(doubt.signal, doubt)
    if any((doubt.factor, doubt.offset) == (1.0, 0.0) for doubt in found.values()):
        # Times in another unit look like many mix-ups.
        found = {signal: replace(doubt, is_clear=False) for signal, doubt in found.items()}
    return tuple(found.values())


def turned(signals: Signals) -> str:
    """Return a sentence if current or power seem to have the opposite sign, '' otherwise."""
    sentences = {doubt.signal: doubt.sentence for doubt in find_doubts(signals) if doubt.factor < 0.0}
    # The power is often computed from the current.
    return sentences.get('current_a') or sentences.get('power_w', '')


def held_while_driving(signals: Signals) -> str:
    """Return a sentence if the power of a moving car, otherwise changing, stays the same for minutes; else ''."""
    key = next((key for key in ('current_a', 'power_w') if key in signals and len(signals[key].value)), '')
    if not key or 'speed_mps' not in signals:
        return ''
    series, speed = signals[key], signals['speed_mps']
    starts = np.append(0, np.flatnonzero(np.diff(series.value)) + 1)
    held_s = np.append(series.time_s[starts[1:] - 1], series.time_s[-1]) - series.time_s[starts]
    held_s[np.diff(starts, append=len(series.value)) <= MOST_STEADY] = 0.0
    at = int(np.argmax(held_s))
    begin_s = series.time_s[starts[at]]
    inside = (speed.time_s >= begin_s) & (speed.time_s <= begin_s + held_s[at])
    if len(starts) == 1 or held_s[at] <= LONGEST_STEADY_S or speed.value[inside].min(initial=np.inf) < MOVING_MPS:
        return ''
    return (f'{key}: stays at {figure(float(series.value[starts[at]]), 4)} for {held_s[at]:.0f} s from '
            f'{begin_s:.0f} s on while the car drives; the logger held its last readings; cut the log there')


def _balance(signals: Signals) -> Iterator[Doubt]:
    """Compare charge and energy with the state of charge: sign and scale of current and power."""
    for signal, over, unit, typical, (low, high) in (
            ('current_a', SECONDS_PER_HOUR, 'Ah', TYPICAL_AH, CAPACITIES_AH),
            ('power_w', J_PER_KWH, 'kWh', TYPICAL_KWH, CAPACITIES_KWH)):
        if signal not in signals or 'soc' not in signals:
            continue
        series, soc = signals[signal], signals['soc']
        inside = (soc.time_s >= series.time_s[0]) & (soc.time_s <= series.time_s[-1])
        share = np.cumsum(changes(soc.part(inside), series)) if inside.any() else soc.value[inside]
        if len(share) < 5 or len(series.time_s) < 5 or np.ptp(share) < CLEAR_SOC_CHANGE:
            continue
        taken = np.interp(soc.time_s[inside], series.time_s, integral(series)) / over
        if np.ptp(taken) == 0.0:
            continue
        slope = float(np.polyfit(share, taken, 1)[0])
        if abs(np.corrcoef(share, taken)[0, 1]) < LEAST_CORRELATION:
            continue
        sign, capacity = (-1.0 if slope > 0.0 else 1.0), abs(slope)
        scale, factor = '', 1.0
        if not low <= capacity <= high:
            # The power of ten that brings the capacity nearest to a typical one.
            factor = float(10.0 ** np.round(np.log10(typical / capacity)))
            scale = ('its integral over the change of the state of charge gives a capacity of '
                     f'{figure(capacity, 3)} {unit} (plausible: {low:g} ... {high:g}); a factor of '
                     f'{figure(factor)} is missing')
        # Of readings that stay far from zero an offset may be missing as well.
        sizes = np.abs(series.value)
        is_clear = not scale or bool(np.quantile(sizes, 0.05) < 0.5 * np.median(sizes))
        scale += '' if is_clear else ', or an offset'
        turned = 'it grows while the state of charge rises; positive must mean discharging' if sign < 0.0 else ''
        if scale or turned:
            yield Doubt(signal, f'{signal}: {" and ".join(filter(None, (turned, scale)))}', sign * factor,
                        is_clear=is_clear)


def _resistance(signals: Signals) -> Iterator[Doubt]:
    """Compare steps of the current with those of the voltage, which falls while more is drawn."""
    if {'voltage_v', 'current_a'} <= signals.keys():
        current = signals['current_a']
        steps_v, steps_a = np.diff(signals['voltage_v'].at(current.time_s, np.nan)), np.diff(current.value)
        clear = np.isfinite(steps_v) & (np.abs(steps_a) > LEAST_CURRENT_STEP_A)
        steps_v, steps_a = steps_v[clear], steps_a[clear]
        if len(steps_v) > LEAST_STEPS and np.ptp(steps_v) > 0.0 and (
                np.corrcoef(steps_v, steps_a)[0, 1] > LEAST_CORRELATION):
            slope_ohm = float(steps_v @ steps_a / (steps_a @ steps_a))
            yield Doubt('current_a', f'current_a: the voltage rises by {1e3 * slope_ohm:.0f} mV for each ampere '
                                     'drawn; positive must mean discharging', -1.0)


def _power(signals: Signals) -> Iterator[Doubt]:
    if not {'power_w', 'voltage_v', 'current_a'} <= signals.keys():
        return
    power, current = signals['power_w'], signals['current_a']
    product = current.at(power.time_s, np.nan) * signals['voltage_v'].at(power.time_s, np.nan)
    clear = np.isfinite(product) & (np.abs(product) > 1000.0) & (power.value != 0.0)
    if clear.sum() < 5:
        return
    ratios = product[clear] / power.value[clear]
    ratio = float(np.median(ratios))
    turned = any(doubt.signal == 'current_a' and doubt.factor < 0.0
                 for check in (_balance, _resistance) for doubt in check(signals))
    for factor, words in ((-1.0, 'has the opposite sign of voltage times current'),
                          (1000.0, 'is a thousandth of voltage times current; is it in kW?'),
                          (-1000.0, 'is a thousandth of voltage times current, with the opposite sign'),
                          (0.001, 'is a thousand times voltage times current; is it in mW?')):
        if abs(ratio / factor - 1.0) < 0.3 and not (factor < 0.0 and turned):
            yield Doubt('power_w', f'power_w: {words}', factor)
    if np.median(np.abs(ratios / ratio - 1.0)) < SAME_RATIO and all(
            abs(abs(ratio) / usual - 1.0) > 0.3 for usual in (1.0, 1000.0, 0.001)):
        yield Doubt('power_w', f'power_w: is {figure(1.0 / ratio, 3)} times voltage times current; do all '
                    'three belong to the battery?', ratio, is_clear=False)


def _size(signals: Signals) -> Iterator[Doubt]:
    """Doubt powers of less than kilowatts while the car moves, heaters of a few watts, a charge of a percent."""
    for signal in ('power_w', 'propulsion_power_w'):
        if {signal, 'speed_mps'} <= signals.keys():
            power = signals[signal]
            moving = power.value[signals['speed_mps'].at(power.time_s, np.nan) > 5.0]
            largest = float(np.max(np.abs(moving), initial=0.0))
            if len(moving) >= 10 and 0.0 < largest < 600.0:
                yield Doubt(signal, f'{signal}: is at most {figure(largest, 3)} W while the car drives; is it in '
                            'kW?', 1000.0)
    for signal, least, words, factor in (
            *((name, LEAST_HEATER_W, ' W; is it in kW?', 1000.0) for name in HEATERS),
            ('soc', 0.0102, '; a share taken as percent?', 100.0)):
        if signal in signals and 0.0 < (largest := float(np.max(signals[signal].value))) < least:
            yield Doubt(signal, f'{signal}: is at most {figure(largest, 3)}{words}', factor)


def _sign_of_drive(signals: Signals) -> Iterator[Doubt]:
    """
    Doubt a power or current that a moving car delivers in the mean, if the state of charge does not decide.

    Not if the car descends enough for it, or if the power rises with the acceleration, as on an unknown descent.
    """
    if 'speed_mps' not in signals or ('soc' in signals and np.ptp(signals['soc'].value) >= CLEAR_SOC_CHANGE):
        return
    speed = signals['speed_mps']
    for signal, least in (('power_w', LEAST_DRIVING_W), ('current_a', LEAST_DRIVING_A),
                          ('propulsion_power_w', LEAST_DRIVING_W)):
        if signal not in signals:
            continue
        series = signals[signal]
        speed_mps = speed.at(series.time_s, np.nan)
        moving = speed_mps > MOVING_MPS
        if moving.sum() < 10 or not len(series.time_s) or np.mean(series.value[moving]) > -least:
            continue
        step_s = np.gradient(series.time_s)
        distance_m = float(np.sum(np.where(moving & (step_s <= LONGEST_HOLD_S), speed_mps * step_s, 0.0)))
        elevation = signals.get('elevation_m')
        descends = elevation is not None and (
            elevation.value[0] - elevation.value[-1] > REGENERATING_GRADE * distance_m)
        if distance_m < UNIT_TELLING_M or descends or _drives_harder(series, speed_mps, moving):
            continue
        yield Doubt(signal, f'{signal}: is {figure(float(np.mean(series.value[moving])), 3)} '
                            f'{"A" if signal == "current_a" else "W"} in the mean while the car drives; positive '
                            'must mean discharging', -1.0)


def _drives_harder(series: Series, speed_mps: FloatArray, moving: BoolArray) -> bool:
    """Return whether a power or current clearly rises with the power of acceleration."""
    if len(series.time_s) < 3:
        return False
    accelerating = speed_mps * np.gradient(speed_mps, series.time_s)
    good = moving & np.isfinite(accelerating)
    if good.sum() < 10 or np.ptp(accelerating[good]) == 0.0 or np.ptp(series.value[good]) == 0.0:
        return False
    return bool(np.corrcoef(accelerating[good], series.value[good])[0, 1] > LEAST_RESPONSE)


def _distance(signals: Signals) -> Iterator[Doubt]:
    """Compare speed and odometer with the distance by position, else with each other."""
    position, driven = by_position(signals), dict[str, Series]()
    if 'speed_mps' in signals:
        driven['speed_mps'] = Series(signals['speed_mps'].time_s, integral(signals['speed_mps']))
    # Odometers are coarse, and begin again.
    if 'odometer_m' in signals and np.ptp(signals['odometer_m'].value) >= 10.0 * UNIT_TELLING_M:
        odometer, beside = signals['odometer_m'], position or driven.get('speed_mps')
        if beside is not None:
            driven['odometer_m'] = Series(odometer.time_s, np.cumsum(np.maximum(changes(odometer, beside), 0.0)))
    known = {} if position is None else {
        signal: found for signal, each in driven.items() if (found := distances(each, position)) is not None}
    for signal, found in known.items():
        yield from _mixed(signal, *found, 'position')
    if 'speed_mps' not in known and len(driven) == 2 and (found := distances(*driven.values())) is not None:
        yield from _mixed('speed_mps', *found, 'odometer')


def _mixed(signal: str, own_m: float, other_m: float, words: str) -> Iterator[Doubt]:
    """Doubt the unit of a speed or an odometer by the distance that it gives and another one [m]."""
    is_speed = signal == 'speed_mps'
    for factor, mixed in (SPEED_FACTORS if is_speed else ODOMETER_FACTORS).items():
        if abs(other_m / own_m / factor - 1.0) < AGREEMENT:
            # An odometer in miles looks as if the speed were too high.
            both = words == 'odometer' and mixed == 'km/h taken as mph'
            own = 'integral' if is_speed else 'change'
            yield Doubt(signal, f'{signal}: its {own} is {own_m / 1000.0:.2f} km, the '
                                f'distance by {words} {other_m / 1000.0:.2f} km; {mixed}'
                                f'{", or an odometer in miles" if both else ""}?', factor, is_clear=not both)
            return


def _motion(signals: Signals) -> Iterator[Doubt]:
    """Doubt speeds and changes of speed that no car reaches."""
    if 'speed_mps' not in signals:
        return
    speed = signals['speed_mps']
    moving = speed.value[speed.value > 1.0]
    step_s = np.diff(speed.time_s)
    quick = step_s <= 2.5
    if quick.sum() >= 60:
        hardest = float(np.quantile(np.abs(np.diff(speed.value)[quick] / step_s[quick]), 0.995))
        if hardest > 3.6 * HARDEST_MPS2:
            yield Doubt('speed_mps', f'speed_mps: changes by {figure(hardest, 3)} m/s2; are the times in seconds?',
                        is_clear=False)
        elif hardest > HARDEST_MPS2 and np.median(moving) > 15.0:
            yield Doubt('speed_mps', f'speed_mps: changes by {figure(hardest, 3)} m/s2; km/h taken as '
                                     'm/s?', 1.0 / 3.6)
    if len(moving) >= 10 and np.quantile(moving, 0.9) > FASTEST_TRAVEL_MPS:
        yield Doubt('speed_mps', f'speed_mps: is above {figure(float(np.quantile(moving, 0.9)), 3)} m/s for a '
                                 'tenth of the drive; km/h taken as m/s?', 1.0 / 3.6)


def _temperature(signals: Signals) -> Iterator[Doubt]:
    """
    Doubt temperatures far from each other at the start, as degrees Fahrenheit are.

    Whole readings may as well be tenths, or a byte without its offset, so they are not repaired.
    """
    if not {'battery_temperature_c', 'ambient_c'} <= signals.keys():
        return
    begins = {signal: float(np.median(signals[signal].value[:20]))
              for signal in ('battery_temperature_c', 'ambient_c')}
    for signal, other, least in (
            # A battery may be warm from a garage or from charging, but hardly so warm.
            ('battery_temperature_c', 'ambient_c', HOTTEST_PARKED_C),
            ('ambient_c', 'battery_temperature_c', -np.inf)):
        value, near = begins[signal], begins[other]
        is_far = value > least and value - near > CELSIUS_K and abs((value - 32.0) / 1.8 - near) < FAHRENHEIT_K
        if is_far or (value > HOTTEST_C and least > 0.0):
            halves = 2.0 * signals[signal].value
            is_clear = bool((halves != np.round(halves)).any())
            yield Doubt(signal, f'{signal}: begins at {figure(value, 4)}, {other} at {figure(near, 4)}; is it in '
                                f'degF{"" if is_clear else ", in tenths, or a byte without its offset"}?',
                        1.0 / 1.8, -32.0 / 1.8, is_clear)


CHECKS: tuple[Callable[[Signals], Iterator[Doubt]], ...] = (
    _balance, _resistance, _power, _sign_of_drive, _size, _distance, _motion, _temperature)
