# SPDX-License-Identifier: Apache-2.0
"""
Expected cost of a target if it is not certain that the vehicle charges, or when it arrives.

    expected cost = p · cost(charged) + (1 - p) · cost(not charged),   averaged over the arrival time

A vehicle that charges pays as in `worth`. A vehicle that drives on has lost its heat: it buys the energy again
elsewhere, at the same price. Heating after the instant at which the driver knows is no part of that loss. If the
charger is taken for a while, the vehicle waits and charges then, and time and cooling count instead.

The arrival varies with the pace of the drive: each segment takes longer or shorter by the same factor, its
energy per metre stays. The heater follows the plan by the clock and is off from the planned arrival on, as the
planner switches it off then. So an early arrival cuts the heat, and after a late one the battery has cooled. A
warmer target, whose heating starts earlier, makes up for both.
"""
from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
import math
from typing import NamedTuple

import numpy as np

from bev_preheat.charging.equations import heated_c
from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.session import charge, LONGEST_SESSION_S
from bev_preheat.charging.stop import ChargingProspect, ChargingStop, stop_after
from bev_preheat.charging.target_worth import pays_from_per_h, Prices, TargetWorth
from bev_preheat.estimation.estimate import HEAT_CAPACITY, HEATER, LEAKAGE, PROPULSION, RESISTANCE, SOURCE_HEAT
from bev_preheat.estimation.prior import factor_deviations, temperature_after
from bev_preheat.numerics import FloatArray, FLOATS, JOULES_PER_WH
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.trip import make_trip, Trip
from bev_preheat.route.segments import Route
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

# Abscissas and weights of Gauss and Hermite for a normal distribution (Abramowitz & Stegun 25.4.46, n = 7).
ABSCISSAS, WEIGHTS = np.polynomial.hermite_e.hermegauss(7)
WEIGHTS = WEIGHTS / WEIGHTS.sum()
# Drivers are not faster than this multiple of the planned pace.
FASTEST_PACE = 2.0
# Spacing of the states on arrival whose sessions are simulated [K] and (0 ... 1); the cost is linear between them.
SPACING_K, SPACING_SOC = 1.0, 0.02


class _Arrival(NamedTuple):
    """One arrival time: its weight, the Trip to it, and the state of charge of the unheated drive."""

    weight: float
    trip: Trip
    unheated_soc: float


class Expectation:
    """Makes the cost of each target of one drive an expected one; its inputs are those of the plans."""

    def __init__(self, vehicle: Vehicle, route: Route, state: BatteryState, stop: ChargingStop,
                 prospect: ChargingProspect, prices: Prices, unheated: Plan,
                 heater_share: float = 1.0) -> None:
        """Take the inputs; nothing is driven yet."""
        self.prospect = prospect
        self._vehicle, self._state, self._prices, self._stop = vehicle, state, prices, stop
        self._heater_share = heater_share
        self._unheated, self._route = unheated, route
        self._sessions = SessionCosts(vehicle, stop, prices)

    @cached_property
    def _arrivals(self) -> list[_Arrival]:
        """The arrival times, with the unheated drive to each."""
        arrivals: list[_Arrival] = []
        if self.prospect.arrival_deviation_s <= 0.0:
            return arrivals
        for abscissa, weight in zip(ABSCISSAS.tolist(), WEIGHTS.tolist()):
            trip = make_trip(self._vehicle, at_arrival(
                self._route, abscissa * self.prospect.arrival_deviation_s), self._heater_share)
            unheated = drive_as_planned(trip, self._state, np.zeros(len(trip.route)))
            arrivals.append(_Arrival(weight, trip, float(unheated.soc[-1])))
        return arrivals

    def of(self, item: TargetWorth, plan: Plan) -> TargetWorth:
        """Return a TargetWorth, whose cost is that of certain charging after a Plan, with the expected cost."""
        charged, not_charged = self._over_arrivals(plan) if self._arrivals else self._in_time(item, plan)
        return self.revised(replace(item, charged_cost=charged, not_charged_cost=not_charged))

    def revise(self, probability: float) -> None:
        """Count with another probability of charging (above 0 ... 1) from now on."""
        self.prospect = replace(self.prospect, probability=probability)

    def revised(self, item: TargetWorth) -> TargetWorth:
        """Return a TargetWorth of `of` for the probability of now."""
        probability = self.prospect.probability
        return replace(item, cost=probability * item.charged_cost + (1.0 - probability) * item.not_charged_cost)

    def pays_from_per_h(self, item: TargetWorth, without: TargetWorth) -> float:
        """Return the value of time [per h] from which on a target costs less than no heating, or infinity."""
        # A vehicle that waits for the charger charges in any case.
        probability = self.prospect.probability if self.prospect.wait_s is None else 1.0
        return pays_from_per_h(item, without, self._prices.energy_per_kwh, probability,
                               item.not_charged_cost - without.not_charged_cost)

    def _in_time(self, item: TargetWorth, plan: Plan) -> tuple[float, float]:
        """Return the costs after a Plan that arrives as planned: if the vehicle charges on arrival, and if not."""
        charged = self._sessions.of_endless(plan.arrival_soc) if math.isinf(item.cost) else item.cost
        return charged, self._not_charged(
            plan.arrival_state, self._unheated.arrival_soc - self._soc_when_known(plan))

    def _over_arrivals(self, plan: Plan) -> tuple[float, float]:
        """Return both costs after a Plan as means over all arrival times."""
        charged, not_charged = 0.0, 0.0
        for arrival in self._arrivals:
            driven = drive_as_planned(arrival.trip, self._state, by_the_clock(plan, arrival.trip))
            state, known = driven.arrival_state, driven
            if self.prospect.known_before_arrival_s > 0.0:
                known = drive_as_planned(arrival.trip, self._state, by_the_clock(
                    plan, arrival.trip, self._known_at_s(arrival.trip.route.total_duration_s)))
            charged += arrival.weight * self._sessions.cost(state)
            not_charged += arrival.weight * self._not_charged(
                state, arrival.unheated_soc - float(known.soc[-1]))
        return charged, not_charged

    def _known_at_s(self, arrival_s: float) -> float:
        return max(0.0, arrival_s - self.prospect.known_before_arrival_s)

    def _soc_when_known(self, plan: Plan) -> float:
        """Return the state of charge on arrival if heating ends when it is known that the car does not charge."""
        if self.prospect.known_before_arrival_s == 0.0 or plan.heating_start_s is None:
            return plan.arrival_soc
        trip = make_trip(self._vehicle, self._route, self._heater_share)
        return float(drive_as_planned(trip, self._state, by_the_clock(
            plan, trip, self._known_at_s(plan.arrival_time_s))).soc[-1])

    def _not_charged(self, state: BatteryState, lost_soc: float) -> float:
        """Return the cost if the vehicle does not charge on arrival in a state, with `lost_soc` spent on heat."""
        wait_s = self.prospect.wait_s
        if wait_s is None:
            return self._prices.cost(spent_wh(self._vehicle, state.soc, state.temperature_c, lost_soc), 0.0)
        cooled = replace(state, heater_power_w=0.0, coolant_excess_k=0.0, temperature_c=temperature_after(
            self._vehicle, state.temperature_c, self._stop.ambient_c, wait_s))
        return self._sessions.cost(cooled) + self._prices.cost(0.0, wait_s)


def spent_wh(vehicle: Vehicle, soc: float, temperature_c: float, lost_soc: float) -> float:
    """Return the battery energy of `lost_soc` (0 ... 1) that was spent before a state [deg C] was reached [Wh]."""
    battery = vehicle.battery
    voltage_v = battery.open_circuit_voltage.function(FLOATS)(soc + 0.5 * lost_soc, temperature_c)
    return lost_soc * battery.capacity_as * voltage_v / JOULES_PER_WH


class SessionCosts:
    """
    Cost of the session after an arrival, over the state on arrival.

    Sessions are simulated on a grid of temperatures and states of charge as they are asked for. A session that
    never ends counts as the longest one, so that the mean over several arrivals stays finite.
    """

    def __init__(self, vehicle: Vehicle, stop: ChargingStop, prices: Prices) -> None:
        """Begin without any session."""
        self._vehicle, self._stop, self._prices = vehicle, stop, prices
        self._heating = ChargerHeating(vehicle, stop, prices)
        self._costs: dict[tuple[int, int], float] = {}

    def cost(self, state: BatteryState) -> float:
        """Return the cost after arriving with a BatteryState, including its heat under way."""
        warm_c = heated_c(self._vehicle, state.temperature_c, state.heater_power_w, state.coolant_excess_k)
        kelvins, charges = warm_c / SPACING_K, state.soc / SPACING_SOC
        low_k, low_s = math.floor(kelvins), math.floor(charges)
        share_k, share_s = kelvins - low_k, charges - low_s
        return math.fsum(weight * self._at(at_k, at_s) for at_k, at_s, weight in (
            (low_k, low_s, (1.0 - share_k) * (1.0 - share_s)), (low_k + 1, low_s, share_k * (1.0 - share_s)),
            (low_k, low_s + 1, (1.0 - share_k) * share_s), (low_k + 1, low_s + 1, share_k * share_s))
            if weight > 0.0)

    def of_endless(self, soc: float) -> float:
        """Return the cost of a session that never ends, from a state of charge (0 ... 1): as the longest."""
        battery = self._vehicle.battery
        voltage_v = battery.open_circuit_voltage.function(FLOATS)(soc, self._stop.ambient_c)
        wanted_wh = max(self._stop.departure_soc - soc, 0.0) * battery.capacity_as * voltage_v / JOULES_PER_WH
        return self._prices.cost(wanted_wh, LONGEST_SESSION_S)

    def _at(self, at_k: int, at_s: int) -> float:
        if (at_k, at_s) not in self._costs:
            lowest_c, highest_c = self._vehicle.battery.temperature_range_c
            soc = min(max(SPACING_SOC * at_s, 0.0), self._stop.departure_soc)
            cost = self._heating.choose(BatteryState(
                min(max(SPACING_K * at_k, lowest_c), highest_c), soc)).cost
            self._costs[at_k, at_s] = cost if math.isfinite(cost) else self.of_endless(soc)
        return self._costs[at_k, at_s]


def at_arrival(route: Route, later_s: float) -> Route:
    """Return a Route driven at another pace, so that it ends later by `later_s` [s]; negative: earlier."""
    factor = max(1.0 + later_s / route.total_duration_s, 1.0 / FASTEST_PACE)
    return replace(route.with_propulsion(1.0 / factor), duration_s=factor * route.duration_s,
                   speed_mps=route.speed_mps / factor)


def by_the_clock(plan: Plan, trip: Trip, until_s: float = math.inf) -> FloatArray:
    """Return a Plan's heater power [W] at the instants of a Trip of another pace (N,), 0 from `until_s` [s] on."""
    energy_j = np.concatenate(([0.0], np.cumsum(plan.command_w * np.diff(plan.time_s))))
    knots_s = plan.time_s
    for instant_s, side in ((plan.heating_start_s, 'right'), (plan.heating_end_s, 'left')):
        if instant_s is not None and plan.time_s[0] < instant_s < plan.time_s[-1]:
            # In the step of a switching the heater is off before its start, or after its end.
            step = int(np.searchsorted(plan.time_s, instant_s, side='right')) - 1
            at = int(np.searchsorted(knots_s, instant_s, side='right'))
            cumulated_j = float(np.sum(plan.command_w[:step + (side == 'left')]
                                       * np.diff(plan.time_s)[:step + (side == 'left')]))
            knots_s, energy_j = np.insert(knots_s, at, instant_s), np.insert(energy_j, at, cumulated_j)
    taken_j = np.interp(np.minimum(trip.time_s, until_s), knots_s, energy_j)
    power_w: FloatArray = np.minimum(np.diff(taken_j) / trip.route.duration_s, trip.heater_limit_w)
    return power_w


@dataclass(frozen=True)
class TimeDeviation:
    """Standard deviations [s] of the charging times and of the time saved; infinite if a session never ends."""

    without_heating_s: float
    heated_s: float
    saved_s: float


def arrival_of(vehicle: Vehicle, plan: Plan) -> BatteryState:
    """Return the state in which a Plan arrives; a car that cools holds its battery at the highest temperature."""
    state, highest_c = plan.arrival_state, vehicle.battery.temperature_range_c[1]
    return replace(state, temperature_c=min(state.temperature_c, highest_c)) if vehicle.cools else state


def time_deviation(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal,
                   charger_power_w: float, departure_soc: float, prices: Prices) -> TimeDeviation:
    """
    Return the TimeDeviation of heating to the target of a Goal.

    The spreads are those of a car known only from its file (`estimation.prior`): heat capacity, leakage,
    resistance, heater, other heat sources and consumption, each varied alone, with their squares added. The
    planner learns these on the way and still reaches its target, so each car is planned as it is. The map of the
    charging power is that of the file. At the charger each car heats as the file's car would, by its HeatingChoice
    under Prices.
    """
    heating = ChargerHeating(vehicle, stop_after(route, charger_power_w, departure_soc), prices)
    limits = [heating.choose(arrival_of(vehicle, plan)).limit for plan in (
        plan_unheated(vehicle, route, state, goal), plan_preheating(vehicle, route, state, goal))]
    squares = [0.0, 0.0, 0.0]
    for index, deviation in factor_deviations(vehicle.uncertainty).items():
        if index == SOURCE_HEAT and not vehicle.heat_sources:
            continue
        ends = []
        for factor in (math.exp(-deviation), math.exp(deviation)):
            car = corrected_vehicle(vehicle, Corrections(**{
                name: factor if index == at else 1.0 for name, at in (
                    ('heat_capacity', HEAT_CAPACITY), ('leakage', LEAKAGE),
                    ('resistance', RESISTANCE), ('heater_efficiency', HEATER), ('source_heat', SOURCE_HEAT))}))
            driven = route.with_propulsion(factor) if index == PROPULSION else route
            stop = stop_after(driven, charger_power_w, departure_soc)
            without_s, heated_s = (
                charge(car, stop, arrival_of(car, plan), heating=limit).charging_time_s for plan, limit in zip((
                    plan_unheated(car, driven, state, goal),
                    plan_preheating(car, driven, state, goal)), limits))
            ends.append((without_s, heated_s, without_s - heated_s))
        for at, (low_s, high_s) in enumerate(zip(*ends)):
            squares[at] += (0.5 * (high_s - low_s))**2
    return TimeDeviation(*(math.sqrt(value) if math.isfinite(value) else math.inf
                           for value in squares))
