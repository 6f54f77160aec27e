# SPDX-License-Identifier: Apache-2.0
"""The verdict on an identified car in words, and the recordings that would improve it most."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.errors import figure
from bev_preheat.identification.check import rms
from bev_preheat.identification.structures import graded, LEAST_GAIN

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from bev_preheat.identification.coverage import Coverage
    from bev_preheat.identification.electrical import Electrical
    from bev_preheat.identification.result import Estimated
    from bev_preheat.identification.structures import LeftOut, StructureResult

# Errors on unseen trips [K]: a file with less can be trusted, one with more should not replace START.
GOOD_RMSE_K, POOR_RMSE_K = 0.6, 1.5
COLDEST_USEFUL_C = -10.0
LEAST_DRIVES = 6


def verdict_of(estimates: Sequence[Estimated], left_out: Sequence[LeftOut], baselines: dict[str, StructureResult],
               structures: Sequence[StructureResult], structure: str, coverage: Coverage,
               together: Sequence[tuple[str, str, float]], electrical: Electrical) -> Iterator[str]:
    """Yield the verdict's sentences, the most important first."""
    unusual = [item for item in estimates if item.is_unusual]
    if left_out:
        yield from _on_trips_left_out(left_out, baselines, unusual)
    else:
        yield (f'Only {coverage.trips} log{"" if coverage.trips == 1 else "s"}: nothing tests the file; the '
               'intervals say how far it can be trusted. Record more, and each log is predicted from the others.')
    yield from map(_on_unusual, unusual)
    yield from _resistance(coverage, electrical)
    unknown = [item.label for item in estimates if not item.is_identified]
    if unknown:
        yield f"Not told by these logs, so START's value stays: {', '.join(unknown)}."
    if coverage.heated_trips == 0:
        yield 'Without any use of the battery heater its efficiency is unknown.'
    labels = {item.name: item.label for item in estimates}
    for one, other, ratio in together:
        if one in labels and other in labels:
            yield f'Known only together (correlation {ratio:+.2f}): {labels[one]} and {labels[other]}.'
    if left_out:
        yield from _structures(structures, structure)


def _on_trips_left_out(left_out: Sequence[LeftOut], baselines: dict[str, StructureResult],
                       unusual: Sequence[Estimated]) -> Iterator[str]:
    grading = graded(left_out)
    rmse_k = rms([trip.error_k for trip in grading])
    worst = max(grading, key=lambda trip: abs(trip.error_k))
    grade = ('The file should not be trusted yet' if rmse_k > POOR_RMSE_K or unusual else
             'The file can be trusted for drives like the recorded ones' if rmse_k < GOOD_RMSE_K else
             'The file can be used with care')
    yield (f'{grade}: fitted without a trip, it predicts the arrival temperature of that trip with an RMSE of '
           f'{rmse_k:.2f} K (worst {worst.error_k:+.2f} K, {worst.name}).')
    for baseline in baselines.values():
        if rmse_k > baseline.rmse_k:
            consequence = ('these trips are too alike to test the file for others' if rmse_k < GOOD_RMSE_K else
                           'the fit has no value yet')
            yield f'A {baseline.structure} does better on these trips ({baseline.rmse_k:.2f} K): {consequence}.'
    for trip in left_out:
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


def _structures(structures: Sequence[StructureResult], structure: str) -> Iterator[str]:
    own = next(result for result in structures if result.structure == structure)
    better = [result for result in structures if not result.in_the_file
              and result.rmse_k < own.rmse_k * (1.0 - LEAST_GAIN)]
    diverging = [result.structure for result in structures if result.diverges]
    if better:
        best = min(better, key=lambda result: result.rmse_k)
        yield (f'Structure: {structure} (RMSE {own.rmse_k:.2f} K, worst {own.worst_k:.2f} K on trips left out). '
               f'{best.structure} predicts them with {best.rmse_k:.2f} K (worst {best.worst_k:.2f} K), but plans, '
               'program and core have one mass, so it stays out of the file.')
    else:
        yield (f'Structure: {structure} (RMSE {own.rmse_k:.2f} K, worst {own.worst_k:.2f} K on trips left out); '
               'no other structure predicts unseen trips clearly better.')
    if diverging:
        yield f'On these trips the fit diverges: {", ".join(diverging)}.'


def record_next(estimates: Sequence[Estimated], coverage: Coverage, electrical: Electrical) -> Iterator[str]:
    """Yield the recordings that would tell most, the most valuable first."""
    widths = {item.name: item for item in estimates}
    if not electrical.used:
        yield 'Voltage and current of the battery, once a second: they tell the resistance.'
    if coverage.heated_trips == 0:
        yield ('Two drives with the battery heater on, with its power (battery_heater_w): they tell its '
               'efficiency and the lag of its heat.')
    elif coverage.unheated_drives == 0:
        yield 'Two drives without battery heating: they separate the heater from the Joule heat.'
    if coverage.telling_nights == 0 and not widths['leakage'].is_identified:
        yield ('A night at stand: the battery at least 10 K warmer than the air, one reading a minute for six '
               'hours or more; it tells the leakage.')
    if coverage.battery_c[0] > COLDEST_USEFUL_C:
        yield (f'A drive with a battery below {min(COLDEST_USEFUL_C, coverage.battery_c[0] - 5.0):.0f} degC: it '
               'tells the resistance in the cold.')
    elif coverage.resistance_from_c is not None and coverage.coldest_c < coverage.resistance_from_c - 1.0:
        yield f'A second drive below {coverage.resistance_from_c:.0f} degC: the resistance there rests on one.'
    if coverage.drives < LEAST_DRIVES:
        yield f'{LEAST_DRIVES - coverage.drives} more drives of at least 20 min: intervals rest on whole trips.'
    if not widths['drivetrain_heat'].is_identified:
        yield 'A drive on a motorway and one in a town: they separate drivetrain heat from Joule heat.'
