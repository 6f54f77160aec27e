# SPDX-License-Identifier: Apache-2.0
"""The result of an identification: estimates, errors on unseen trips, a verdict as text, recordings to make."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
import math
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import figure
from bev_preheat.identification.check import Check, rms
from bev_preheat.identification.structures import graded, LeftOut, misfit_gains, StructureResult
from bev_preheat.identification.uncertainty import QUANTILE, SYSTEMATIC_DEVIATIONS
from bev_preheat.numerics import FloatArray, S_PER_H

if TYPE_CHECKING:
    from bev_preheat.identification.electrical import Electrical
    from bev_preheat.identification.trips import Trip
    from bev_preheat.vehicle.description import Vehicle

# Errors on unseen trips [K]: a file with less can be trusted, one with more should not replace START.
GOOD_RMSE_K, POOR_RMSE_K = 0.6, 1.5
COLDEST_USEFUL_C = -10.0
LEAST_DRIVES = 6
# A night that determines leakage: duration [h] and difference to the air [K].
NIGHT_H, NIGHT_DIFFERENCE_K = 3.0, 5.0
# Each heated drive is predicted from the others: two do not tell a shell.
LEAST_HEATED = 3


def verdict_of(result: Identification) -> Iterator[str]:
    """Yield the verdict's sentences, the most important first."""
    estimates, coverage = result.estimates, result.coverage
    unusual = [item for item in estimates if item.is_unusual]
    if result.left_out:
        yield from _on_trips_left_out(result, unusual)
    else:
        yield (f'Only {coverage.trips} log{"" if coverage.trips == 1 else "s"}: nothing tests the file; the '
               'intervals say how far it can be trusted. Record more, and each log is predicted from the others.')
    yield from map(_on_unusual, unusual)
    yield from _resistance(coverage, result.electrical)
    unknown = [item.label for item in estimates if not item.is_identified]
    if unknown:
        yield f"Not told by these logs, so START's value stays: {', '.join(unknown)}."
    if coverage.heated_trips == 0:
        yield 'Without any use of the battery heater its efficiency is unknown.'
    labels = {item.name: item.label for item in estimates}
    for one, other, ratio in result.together:
        if one in labels and other in labels:
            yield f'Known only together (correlation {ratio:+.2f}): {labels[one]} and {labels[other]}.'
    if result.left_out:
        yield from _structures(result)


def _on_trips_left_out(result: Identification, unusual: Sequence[Estimated]) -> Iterator[str]:
    grading = graded(result.left_out)
    rmse_k = rms([trip.error_k for trip in grading])
    worst = max(grading, key=lambda trip: abs(trip.error_k))
    grade = ('The file should not be trusted yet' if rmse_k > POOR_RMSE_K or unusual else
             'The file can be trusted for drives like the recorded ones' if rmse_k < GOOD_RMSE_K else
             'The file can be used with care')
    if unusual:
        grade += f', because of its {" and ".join(item.label for item in unusual)} (see below)'
    yield (f'{grade}: fitted without a trip, it predicts the arrival temperature of that trip with an RMSE of '
           f'{rmse_k:.2f} K (worst {worst.error_k:+.2f} K, {worst.name}).')
    for baseline in result.baselines.values():
        if rmse_k > baseline.rmse_k:
            consequence = ('these trips are too alike to test the file for others' if rmse_k < GOOD_RMSE_K else
                           'the fit has no value yet')
            yield f'A {baseline.structure} does better on these trips ({baseline.rmse_k:.2f} K): {consequence}.'
    for trip in result.left_out:
        if trip not in grading:
            yield (f'{trip.name} is the only {trip.kind}: without it the others miss it by {trip.error_k:+.2f} K; '
                   'no other log tests its part of the file.')
    outside = [trip.name for trip in grading if not trip.is_within]
    if outside:
        yield f'Outside its 90 % interval: {", ".join(outside)} of {len(grading)} trips.'


def _on_unusual(item: Estimated) -> str:
    where = ('lies at its bound' if item.bound is not None else
             f'is outside {figure(item.prior_low, 3)} … {figure(item.prior_high, 3)} ({item.prior})')
    return (f'{item.label}: {figure(item.estimate, 3)} {item.unit}'.rstrip() + f' {where}: either START or a '
            'signal is wrong, or the value stands in for an effect that is missing in the model.')


def _resistance(coverage: Coverage, electrical: Electrical) -> Iterator[str]:
    if not electrical.used:
        yield ("No log has voltage and current that change: resistance keeps START's value, and heat capacity is "
               'known only as far as that value is right.')
        return
    low_c, high_c = coverage.resistance_from_c, coverage.resistance_to_c
    if low_c is None or high_c is None:
        yield f'Resistance rests on one log only ({coverage.coldest_trip}).'
        return
    if coverage.coldest_c < low_c:
        yield (f'Resistance below {low_c:.0f} degC is extrapolated: down to {coverage.coldest_c:.0f} degC it '
               f'rests on one trip ({coverage.coldest_trip}), below that on the prior alone.')
    else:
        yield f'Resistance below {low_c:.0f} degC is extrapolated: it rests on the prior alone.'
    yield f'Resistance above {high_c:.0f} degC is extrapolated.'


def _structures(result: Identification) -> Iterator[str]:
    first, kinds = result.structures[0], [trip.kind for trip in result.left_out]
    own = next(each for each in result.structures if each.structure == result.structure)
    diverging = [each.structure for each in result.structures if each.diverges]
    yield (f'Structure: {own.structure} (RMSE {own.rmse_k:.2f} K, worst {own.worst_k:.2f} K on trips left out); '
           + ('no other structure explains unseen trips clearly better.' if own is first else
              f'it explains unseen trips better than {first.structure}, by '
              f'{figure(float(misfit_gains(first, own, kinds).sum()), 3)} in the log-likelihood '
              f'(RMSE {first.rmse_k:.2f} K, worst {first.worst_k:.2f} K).'))
    if diverging:
        yield f'On these trips the fit diverges: {", ".join(diverging)}.'


def missing_recordings(result: Identification) -> Iterator[str]:
    """Yield the recordings that would determine most, the most valuable first."""
    coverage, is_identified = result.coverage, {item.name: item.is_identified for item in result.estimates}
    if not result.electrical.used:
        yield 'Voltage and current of the battery, once a second: they tell the resistance.'
    more = LEAST_HEATED - coverage.heated_trips
    if more > 0:
        yield (f'{more} more drive{"s" if more > 1 else ""} with the battery heater on, by planner or by hand, '
               'and its power (battery_heater_w): they tell its efficiency, and the lag of its heat or the shell '
               'around the core.')
    if coverage.heated_trips > 0 and coverage.unheated_drives == 0:
        yield 'Two drives without battery heating: they separate the heater from the Joule heat.'
    if coverage.telling_nights == 0 and not is_identified['leakage']:
        yield ('A night at stand: the battery at least 10 K warmer than the air, one reading a minute for six '
               'hours or more; it tells the leakage.')
    if coverage.battery_c[0] > COLDEST_USEFUL_C:
        yield (f'A drive with a battery below {min(COLDEST_USEFUL_C, coverage.battery_c[0] - 5.0):.0f} degC: it '
               'tells the resistance in the cold.')
    elif coverage.resistance_from_c is not None and coverage.coldest_c < coverage.resistance_from_c - 1.0:
        yield f'A second drive below {coverage.resistance_from_c:.0f} degC: the resistance there rests on one.'
    if coverage.drives < LEAST_DRIVES:
        yield f'{LEAST_DRIVES - coverage.drives} more drives of at least 20 min: intervals rest on whole trips.'
    if not is_identified['drivetrain_heat']:
        yield 'A drive on a motorway and one in a town: they separate drivetrain heat from Joule heat.'


@dataclass(frozen=True)
class Coverage:
    """
    Situations covered by trips.

    Ranges are (low, high). The resistance is known between `resistance_from_c` and `resistance_to_c`, where at
    least two trips with voltage and current were; None: nowhere. `coldest_trip` is the only one below, '' if none.
    """

    trips: int
    drives: int
    nights: int
    charging_sessions: int
    heated_trips: int
    unheated_drives: int
    hours: float
    battery_c: tuple[float, float]
    ambient_c: tuple[float, float]
    soc: tuple[float, float]
    speed_mps: tuple[float, float]
    resistance_from_c: float | None
    resistance_to_c: float | None
    coldest_trip: str
    coldest_c: float
    telling_nights: int

    def as_dictionary(self) -> dict[str, Any]:
        """Return the coverage in JSON form."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}


def coverage_of(trips: Sequence[Trip], electrical: Electrical) -> Coverage:
    """Return the Coverage of Trips."""
    def span(name: str) -> tuple[float, float]:
        return (min(float(getattr(trip, name).min()) for trip in trips),
                max(float(getattr(trip, name).max()) for trip in trips))

    telling = [trip for trip in trips if trip.name in electrical.used]
    lows = sorted((float(trip.battery_temperature_c.min()), trip.name) for trip in telling)
    highs = sorted((float(trip.battery_temperature_c.max()) for trip in telling), reverse=True)
    drives = [trip for trip in trips if trip.kind == 'drive']
    nights = [trip for trip in trips if trip.kind == 'night at stand']
    return Coverage(
        len(trips), len(drives), len(nights), sum(trip.kind == 'charging session' for trip in trips),
        sum(trip.heats for trip in trips), sum(not trip.heats for trip in drives),
        sum(map(len, trips)) / S_PER_H, span('battery_temperature_c'), span('ambient_c'), span('soc'),
        span('speed_mps'), lows[1][0] if len(lows) > 1 else None, highs[1] if len(highs) > 1 else None,
        lows[0][1] if lows else '', lows[0][0] if lows else float('nan'),
        sum(len(trip) > NIGHT_H * S_PER_H
            and float(np.mean(np.abs(trip.battery_temperature_c - trip.ambient_c))) > NIGHT_DIFFERENCE_K
            for trip in nights))


@dataclass(frozen=True)
class Estimated:
    """
    A parameter: START's value, estimate, 90 % interval, and what half the interval is worth on arrival [K].

    `is_identified` False: the trips do not give it, and the estimate is START's value. `prior` explains the prior,
    `prior_low` and `prior_high` are its 90 % interval. `bound` is the bound at which the estimate lies, if any.
    `can_be_0`: 0 is a value like others, as for a share of heat.
    """

    name: str
    label: str
    unit: str
    start: float
    estimate: float
    low: float
    high: float
    prior_low: float
    prior_high: float
    is_identified: bool
    arrival_k: float
    prior: str
    key: str
    bound: float | None = None
    can_be_0: bool = False

    @property
    def is_unusual(self) -> bool:
        """
        Whether the trips determine a value outside the prior's interval, or at its bound.

        A lag is never: it stands for several in a row, and hardly changes an arrival.
        """
        if not self.is_identified or self.name in SYSTEMATIC_DEVIATIONS or (self.can_be_0 and self.bound == 0.0):
            return False
        low = 0.0 if self.can_be_0 else self.prior_low
        return self.bound is not None or not low <= self.estimate <= self.prior_high


@dataclass(frozen=True, eq=False)
class ResistanceCurve:
    """Resistance over temperature [deg C]: START's, estimate, 90 % interval [ohm], and where trips cover it."""

    temperature_c: FloatArray
    start_ohm: FloatArray
    estimate_ohm: FloatArray
    low_ohm: FloatArray
    high_ohm: FloatArray


@dataclass(frozen=True, eq=False)
class Identification:
    """
    An identified car, and how far it can be trusted.

    `vehicle` is the car as its file describes it. `structures` are compared on trips left out, `structure` is the
    chosen one; `left_out` are the errors of its files as plans predict them, `baselines` those of two predictions
    without a model. `check` is the file on all trips. `together` are pairs of parameters known only together.
    `fit_rmse_k` is the root mean square error of the fit on all readings [K].
    """

    vehicle: Vehicle
    start_name: str
    estimates: tuple[Estimated, ...]
    resistance: ResistanceCurve
    electrical: Electrical
    structure: str
    structures: tuple[StructureResult, ...]
    baselines: dict[str, StructureResult]
    left_out: tuple[LeftOut, ...]
    together: tuple[tuple[str, str, float], ...]
    coverage: Coverage
    check: Check
    remarks: tuple[str, ...]
    duration_s: float
    fit_rmse_k: float

    @property
    def rmse_k(self) -> float:
        """Root mean square error on trips left out [K]; NaN if too few trips to leave one out."""
        return rms([trip.error_k for trip in graded(self.left_out)])

    @property
    def worst_k(self) -> float:
        """Largest error on a trip left out [K]; NaN without."""
        return max((abs(trip.error_k) for trip in graded(self.left_out)), default=math.nan)

    @property
    def is_useful(self) -> bool:
        """Whether unseen trips are predicted, or few trips explained, well enough for a vehicle file."""
        return (self.rmse_k if self.left_out else self.fit_rmse_k) <= POOR_RMSE_K

    @property
    def verdict(self) -> tuple[str, ...]:
        """The sentences on how far the file can be trusted, the most important first."""
        return tuple(verdict_of(self))

    @property
    def record_next(self) -> tuple[str, ...]:
        """The recordings that would determine most, the most valuable first."""
        return tuple(missing_recordings(self))

    def as_dictionary(self) -> dict[str, Any]:
        """Return the result in JSON form."""
        curve, electrical = self.resistance, self.electrical
        return {
            'vehicle': self.vehicle.name, 'start': self.start_name, 'structure': self.structure,
            'parameters': [asdict(item) for item in self.estimates],
            'unidentified': [item.label for item in self.estimates if not item.is_identified],
            'resistance': {name: values.tolist() for name, values in vars(curve).items()},
            'electrical': {
                'heat_factor': electrical.heat_factor, 'polarisation': electrical.polarisation,
                'polarisation_s': electrical.polarisation_s, 'residual_v': electrical.residual_v,
                'voltage_correction_v': electrical.voltage_v.tolist(), 'trips': list(electrical.used)},
            'leave_one_out': {
                'rmse_k': _or_none(self.rmse_k), 'worst_k': _or_none(self.worst_k),
                'trips': [{'name': trip.name, 'arrival_error_k': trip.error_k, 'deviation_k': trip.deviation_k,
                           'is_within_interval': trip.is_within} for trip in self.left_out]},
            'fit_rmse_k': self.fit_rmse_k,
            'structures': [_row(result) for result in self.structures],
            'baselines': [_row(result) for result in self.baselines.values()],
            'known_only_together': [list(pair) for pair in self.together],
            'coverage': self.coverage.as_dictionary(),
            'extrapolated': {'resistance_below_c': self.coverage.resistance_from_c,
                             'resistance_above_c': self.coverage.resistance_to_c},
            'check': self.check.as_dictionary(), 'remarks': list(self.remarks), 'verdict': list(self.verdict),
            'record_next': list(self.record_next), 'duration_s': self.duration_s}


def _row(result: StructureResult) -> dict[str, Any]:
    return {'structure': result.structure, 'rmse_k': _or_none(result.rmse_k), 'worst_k': _or_none(result.worst_k),
            'cost': _or_none(result.cost), 'misfits': list(result.misfits),
            'errors_k': list(map(float, result.errors_k))}


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value


TEMPLATE = Path(__file__).with_name('report.html')


def report_text(result: Identification, pictures: Mapping[str, str]) -> str:
    """Return the report on an Identification with `pictures` (SVG elements by name)."""
    from jinja2 import Environment, StrictUndefined
    # Names of trips and vehicles come from files, so they are escaped.
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters['figure'] = lambda value: figure(value, 4)
    template = environment.from_string(TEMPLATE.read_text(encoding='utf-8'))
    return template.render(result=result, pictures=pictures, quantile=QUANTILE)
