# SPDX-License-Identifier: Apache-2.0
"""Draw days: chains of trips with charging and parking in between, of cars as in `drawn_cars`."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from bev_preheat.numerics import FLOATS
from bev_preheat.route.segments import Route
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.phases import Charge, DrivePhase, Park, Phase
from bev_preheat.simulation.sensors import PositionReports
from bev_preheat.simulation.traffic import Event, Kind
from bev_preheat_studies.robustness.drawn_cars import Conditions, draw_car, DrawnCar, pace_events, POSITION_NOISE_M

# Days have their own random stream, so that the cars are those of the study of single trips.
DAY_STREAM = 2
# Uniform distributions; the charger's power [W] is log-uniform.
TRIPS = (2, 5)
LOG_CHARGER_W = (math.log(11e3), math.log(150e3))
CHARGED_TO = (0.6, 0.95)
PARKED_S = (0.5 * 3600.0, 12.0 * 3600.0)
AWAKE_S = (60.0, 1200.0)
# Air temperature while parked or charging, above that of the next route [K].
AMBIENT_BEYOND_K = (-2.0, 2.0)
# Probabilities: voltage and current are known; the position is known; power_supply_status is set; the car
# heats itself at chargers; a trip is early or late; it ends halfway, and the car is parked; the car charges
# after a trip; it is parked after that; the next route has the standing time.
KNOWS_POWER, TELLS_POSITION, TELLS_SUPPLY, HEATS_ITSELF = 0.67, 0.5, 0.33, 0.33
OFF_PACE, CUT_SHORT, CHARGES, PARKS, TELLS_STANDING = 0.67, 0.15, 0.8, 0.8, 0.5
# Largest relative deviation of a trip's duration from its route's.
MOST_OFF_PACE = 0.1
# Share of the route after which a trip that is cut short ends.
CUT_AT = (0.3, 0.8)
# Each drive starts with at least the charge that it needs plus this reserve.
RESERVE_SOC = 0.2
LEAST_CHARGED, MOST_SOC = 0.05, 0.97
LONGEST_CHARGE_S = 10 * 3600.0


@dataclass(frozen=True)
class DrawnDay:
    """
    A drawn chain, reproducible from `seed` and `number` of its `drawn` car.

    The first of the `phases` is a drive. For each drive, `route_numbers` has the index into the routes of
    the conditions, and `paces` its duration as a multiple of the route's. `conditions` are those of this day.
    """

    drawn: DrawnCar
    conditions: Conditions
    phases: tuple[Phase, ...]
    route_numbers: tuple[int, ...]
    paces: tuple[float, ...]
    tells_supply: bool

    def car(self) -> ImperfectCar:
        """Return the car at the start of its day."""
        first, *following = self.phases
        assert isinstance(first, DrivePhase)
        drawn, conditions = self.drawn, self.conditions
        sensors = replace(drawn.sensors(), reports_power=conditions.reports_power,
                          supply_status='plugged' if self.tells_supply else 'unknown')
        return ImperfectCar(
            conditions.vehicle, first, conditions.state,
            Imperfections(drawn.mismatch, drawn.heat_path, sensors, drawn.heater_faults),
            [drawn.seed, drawn.number], following=following)


def draw_day(conditions: Conditions, seed: int, number: int) -> DrawnDay:
    """Return day `number` of a study; whether power and position are known is drawn, too."""
    random = np.random.default_rng([seed, number, DAY_STREAM])
    conditions = replace(conditions, reports_power=bool(random.random() < KNOWS_POWER),
                         tells_position=bool(random.random() < TELLS_POSITION), traffic=0.0)
    tells_supply, heats_itself = random.random() < TELLS_SUPPLY, random.random() < HEATS_ITSELF
    drawn = draw_car(conditions, seed, number)
    trips = int(random.integers(TRIPS[0], TRIPS[1] + 1))
    route_numbers = tuple(int(each) for each in random.integers(0, len(conditions.routes), trips))
    if drawn.heater_faults:
        # Drawn for the route of a single trip; the day's first trip may use another route.
        share = drawn.heater_faults[0].from_s / drawn.route.total_duration_s
        drawn = replace(drawn, heater_faults=(replace(
            drawn.heater_faults[0],
            from_s=share * conditions.routes[route_numbers[0]].total_duration_s),))
    day = _Day(conditions, random, bool(heats_itself))
    for number_of_route, following in zip(route_numbers, (*route_numbers[1:], None)):
        day.drive(conditions.routes[number_of_route])
        if following is not None:
            day.stay(conditions.routes[following])
    return DrawnDay(drawn, conditions, tuple(day.phases), route_numbers, tuple(day.paces), bool(tells_supply))


class _Day:
    """Draws the phases of a day in order."""

    def __init__(self, conditions: Conditions, random: np.random.Generator, heats_itself: bool) -> None:
        self._conditions, self._random, self._heats_itself = conditions, random, heats_itself
        self.phases: list[Phase] = []
        self.paces: list[float] = []
        # Estimated state of charge, time parked [s], whether the latest drive was cut short.
        self._soc, self._parked_s, self._is_cut = conditions.state.soc, 0.0, False

    def _between(self, span: tuple[float, float]) -> float:
        return float(self._random.uniform(*span))

    def _happens(self, probability: float) -> bool:
        return bool(self._random.random() < probability)

    def drive(self, route: Route) -> None:
        """Drive a route."""
        pace = 1.0 + (self._between((-MOST_OFF_PACE, MOST_OFF_PACE)) if self._happens(OFF_PACE) else 0.0)
        # An early end is reported by no route plan either.
        early = Event(Kind.ARRIVE_EARLY, self._between(CUT_AT) * pace * route.total_duration_s, None)
        self._is_cut = self._happens(CUT_SHORT)
        conditions = self._conditions
        self.phases.append(DrivePhase(
            route, conditions.goal, self._parked_s if self._happens(TELLS_STANDING) else 0.0,
            (*pace_events(route, pace), *([early] if self._is_cut else [])),
            PositionReports(conditions.period_s, POSITION_NOISE_M) if conditions.tells_position else None))
        self.paces.append(pace)
        self._soc -= _needed_soc(conditions, route)

    def stay(self, following: Route) -> None:
        """Charge, park, or both, before the next route."""
        ambient_c = float(following.ambient_temperature_c[0]) + self._between(AMBIENT_BEYOND_K)
        least_soc = _needed_soc(self._conditions, following) + RESERVE_SOC
        wants_to_charge, wants_to_park = self._happens(CHARGES), self._happens(PARKS)
        until_soc = min(max(self._between(CHARGED_TO), self._soc + LEAST_CHARGED, least_soc), MOST_SOC)
        charge = Charge(math.exp(self._between(LOG_CHARGER_W)), LONGEST_CHARGE_S, ambient_c, until_soc,
                        heats_itself=self._heats_itself)
        park = Park(self._between(PARKED_S), ambient_c, self._between(AWAKE_S))
        must_charge = self._soc < least_soc
        # A car that is parked halfway is not at a charger.
        phases: tuple[Phase, ...] = (park, charge) if self._is_cut else (charge, park)
        if self._is_cut:
            is_kept = {Charge: must_charge, Park: True}
        else:
            is_kept = {Charge: wants_to_charge or must_charge,
                       Park: wants_to_park or not (wants_to_charge or must_charge)}
        phases = tuple(phase for phase in phases if is_kept[type(phase)])
        if charge in phases:
            self._soc = charge.until_soc
        self._parked_s = park.duration_s if phases[-1] is park else 0.0
        self.phases += phases


def _needed_soc(conditions: Conditions, route: Route) -> float:
    """Estimate the state of charge that a drive needs with full heating throughout."""
    battery = conditions.vehicle.battery
    power_w = (route.propulsion_power_w + route.auxiliary_power_w
               + np.maximum(route.cabin_heating_power_w, conditions.vehicle.hvch.maximum_power_w))
    voltage_v = battery.open_circuit_voltage.function(FLOATS)(0.5, 10.0)
    return float(route.duration_s @ power_w) / (voltage_v * battery.capacity_as)
