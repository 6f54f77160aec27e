# SPDX-License-Identifier: Apache-2.0
"""From trips and a START vehicle to an identified car."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
import math
import time

import numpy as np
from scipy.special import gammaincinv

from bev_preheat.identification.check import check_trips
from bev_preheat.identification.curves import CorrectedResistance, knot_weights, KNOTS_C
from bev_preheat.identification.electrical import CAPACITY_DEVIATION, Electrical, fit_electrical
from bev_preheat.identification.fit import Fitter, ThermalFit
from bev_preheat.identification.parameters import IN_CORE, NAMES, Parameter, STRUCTURES, structures_of
from bev_preheat.identification.result import coverage_of, Estimated, Identification, ResistanceCurve
from bev_preheat.identification.structures import (
    baselines,
    chosen_structure,
    leave_each_out,
    try_structures,
)
from bev_preheat.identification.trips import common_remarks, refuse_poor, Trip
from bev_preheat.identification.uncertainty import (
    correlations,
    Interval,
    intervals_of,
    MOST_OF_PRIOR,
    PROBABILITY,
    QUANTILE,
    uncertainty_of,
    wider,
)
from bev_preheat.identification.vehicle_file import identified_vehicle
from bev_preheat.numerics import ARRAYS
from bev_preheat.vehicle.description import Vehicle

# Least share of START's capacity that an aged battery has; makers guarantee 0.7 for eight years.
OF_AGED = 0.6


def identify(vehicle: Vehicle, trips: Sequence[Trip], name: str,
             tell: Callable[[str], None] = lambda stage: None,
             structures_tried: Sequence[str] = ()) -> Identification:
    """
    Return the Identification of the car that drove the Trips, from a START vehicle; it is called `name`.

    `tell` gets each stage; without `structures_tried` they are those of START. Raises InvalidInput with
    reasons if the trips determine too little, and names the recordings that are missing.
    """
    began_s = time.perf_counter()
    refuse_poor(trips)
    fitter = Fitter(vehicle, trips)
    tell('voltage and current')
    electrical = fit_electrical(vehicle, trips)
    electricals = [fit_electrical(vehicle, [trip for trip in trips if trip is not left_out]) for left_out in trips]
    tried = structures_tried or structures_of(vehicle, any(trip.heats for trip in trips))
    fitter.find_dispersion(electrical, tried)
    structures, fits = try_structures(fitter, tried, electrical, electricals, tell)
    structure = chosen_structure(structures, [trip.kind for trip in trips])
    tell('intervals')
    full = fits[structure]
    intervals = intervals_of(fitter, full)
    if STRUCTURES[structure].has_shell:
        intervals = wider(fitter, intervals, fitter.fit(structure + IN_CORE, electrical, full))
    held, fit = keep_start(fitter, full, intervals)
    if held:
        intervals = wider(fitter, intervals, fit)
    tell('leaving each trip out')
    left_out = leave_each_out(fitter, fit, electricals, held, tell)
    estimates = (*_thermal_estimates(fitter, fit, intervals, held), _capacity(vehicle, electrical))
    resistance = _resistance(vehicle, full)
    driven_mps = [trip.speed_mps for trip in trips if trip.kind == 'drive']
    car = replace(identified_vehicle(fitter, fit), name=name, uncertainty=uncertainty_of(
        vehicle.uncertainty, estimates, resistance if electrical.used else None,
        float(np.concatenate(driven_mps).mean()) if driven_mps else 0.0))
    coverage = coverage_of(trips, electrical)
    tell('checking the file')
    check = check_trips(car, [trip.settled for trip in trips], replays=False)
    together = tuple(pair for pair in correlations(full) if pair[0] not in held and pair[1] not in held)
    return Identification(
        car, vehicle.name, estimates, resistance, electrical, structure, tuple(structures), baselines(fitter),
        tuple(left_out), together, coverage, check, common_remarks(trips), time.perf_counter() - began_s,
        fitter.residual_k(fit))


def keep_start(fitter: Fitter, full: ThermalFit,
               intervals: dict[str, Interval]) -> tuple[dict[str, float], ThermalFit]:
    """
    Return the coordinates of the parameters that keep START's values, and the fit of all others beside them.

    They are those that the trips do not give: their intervals are hardly narrower than the priors'. Values that
    the trips refute together do not stay: as long as the fit explains the readings worse than `full` by more than
    it may at random, the parameter whose release helps most is released.
    """
    def beside(kept: dict[str, float]) -> ThermalFit:
        return fitter.fit(full.structure, full.electrical, full, kept)

    held = _untold(fitter, intervals)
    fit = beside(held)
    while held and fit.cost - full.cost > float(gammaincinv(0.5 * len(held), PROBABILITY)):
        # Half of the quantile of a chi-squared distribution.
        fits = {name: beside({other: at for other, at in held.items() if other != name}) for name in held}
        released = min(fits, key=lambda name: fits[name].cost)
        fit = fits[released]
        del held[released]
    return held, fit


def _untold(fitter: Fitter, intervals: dict[str, Interval]) -> dict[str, float]:
    """Return the priors' centres of the parameters whose intervals are hardly narrower than the priors'."""
    priors = {name: _prior_interval(fitter.parameters[name]) for name in intervals}
    return {name: fitter.parameters[name].prior for name, interval in intervals.items()
            if interval.high - interval.low > MOST_OF_PRIOR * (priors[name].high - priors[name].low)}


def _prior_interval(parameter: Parameter) -> Interval:
    reach = QUANTILE * parameter.deviation
    return Interval(max(parameter.prior - reach, parameter.low), min(parameter.prior + reach, parameter.high))


def _thermal_estimates(fitter: Fitter, fit: ThermalFit, intervals: dict[str, Interval],
                       held: dict[str, float]) -> list[Estimated]:
    slopes = _arrival_slopes(fitter, fit)
    estimates = []
    for name, interval in intervals.items():
        parameter, at = fitter.parameters[name], NAMES.index(name)
        coordinate = float(fit.theta[at])
        estimate, low, high, prior_low, prior_high = (
            float(parameter.value(end)) for end in (coordinate, *interval, *_prior_interval(parameter)))
        bound = parameter.bound_at(coordinate)
        estimates.append(Estimated(
            name, parameter.label, parameter.unit, parameter.start, estimate, min(low, estimate),
            max(high, estimate), prior_low, prior_high, name not in held,
            float(0.5 * (interval.high - interval.low) * slopes[at]), parameter.reason, parameter.key,
            None if bound is None else float(parameter.value(bound)),
            not parameter.is_log and parameter.low == 0.0))
    return estimates


def _arrival_slopes(fitter: Fitter, fit: ThermalFit) -> list[float]:
    """Return the root mean square over trips of the arrival temperature's slope over each coordinate."""
    model = fitter.models[fit.structure]
    last = np.array([model.course(course, fit.theta, start_c, fit.electrical)[1][-1]
                     for course, start_c in zip(fitter.courses, fit.starts_c)])
    return [float(value) for value in np.sqrt(np.mean(last**2, axis=0))]


def _capacity(vehicle: Vehicle, electrical: Electrical) -> Estimated:
    start, reach = vehicle.battery.capacity_ah, QUANTILE * electrical.capacity_deviation_ah
    prior = QUANTILE * CAPACITY_DEVIATION * start
    return Estimated(
        'capacity', 'capacity', 'Ah', start, electrical.capacity_ah, electrical.capacity_ah - reach,
        electrical.capacity_ah + reach, OF_AGED * start, start + prior, reach < MOST_OF_PRIOR * prior, 0.0,
        'START within 10 %, or aged by at most 40 %', 'battery.capacity_ah')


def _resistance(vehicle: Vehicle, fit: ThermalFit) -> ResistanceCurve:
    low_c, high_c = vehicle.battery.temperature_range_c
    temperatures_c = np.arange(max(-20.0, math.ceil(low_c)), min(40.0, high_c) + 1e-9, 1.0)
    socs = np.full_like(temperatures_c, 0.5)
    curve = vehicle.battery.resistance
    start_ohm = curve.function(ARRAYS)(socs, temperatures_c) + np.zeros_like(socs)
    log_factors = fit.theta[len(NAMES):]
    estimate_ohm = CorrectedResistance(curve, log_factors.tolist(), fit.electrical.soc_factors.tolist()).function(
        ARRAYS)(socs, temperatures_c)
    weights, covariance = knot_weights(temperatures_c, KNOTS_C), fit.covariance[len(NAMES):, len(NAMES):]
    spread = np.exp(QUANTILE * np.sqrt(np.einsum('ti,ij,tj->t', weights, covariance, weights)))
    return ResistanceCurve(temperatures_c, start_ohm, estimate_ohm, estimate_ohm / spread, estimate_ohm * spread)
