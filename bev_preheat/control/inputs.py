# SPDX-License-Identifier: Apache-2.0
"""Stamped inputs of the supervisor: battery state, trip with its terms and planning steps, the vehicle's place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property, partial
import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.charging.stop import CERTAIN, Charger, ChargingProspect
from bev_preheat.control.departures import GridPrices, in_words
from bev_preheat.control.settings import defaults_of, Settings
from bev_preheat.errors import InvalidInput
from bev_preheat.estimation.signal_checks import SeenState
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import OF_GOAL
from bev_preheat.planning.full_power import FullPower
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, check_situation, Goal, Uncertainty
from bev_preheat.route.segments import LIMITS, Places, Route
from bev_preheat.tunables import LEAST_HELD_S, MOST_PLANNED_STEPS, WIDEST_CELL_SPREAD_K
from bev_preheat.vehicle.variants import grid_fed

if TYPE_CHECKING:
    from bev_preheat.control.decision import Decision
    from bev_preheat.control.target import TargetChoice
    from bev_preheat.planning.plan import Plan
    from bev_preheat.planning.schedule import StepPrices
    from bev_preheat.vehicle.description import Vehicle

# Start of every sentence for a goal that is no trip.
PREPARING = 'Preparing the battery.'


class Terms(NamedTuple):
    """
    How a goal is planned; the defaults are those of a route plan.

    `is_trip`: the vehicle drives the route, may stand on it, and may charge at its end; else the battery is wanted
    warm at an instant, wherever the vehicle is, and the goal's reserve has the route's margin already.
    `is_at_once`: it is heated at full power from now on. `is_from_grid`: the grid feeds the heater, and the
    battery's charge does not change; then `prices` are those of its energy until `ready_ns` [ns], the end of the
    route; None: heating is as late as possible. `target` is the TargetChoice; None: it is chosen.
    """

    is_trip: bool = True
    is_at_once: bool = False
    is_from_grid: bool = False
    prices: GridPrices | None = None
    ready_ns: int = 0
    target: TargetChoice | None = None

    def vehicle(self, vehicle: Vehicle) -> Vehicle:
        """Return the Vehicle to plan with."""
        return grid_fed(vehicle) if self.is_from_grid else vehicle

    def step_prices(self, route: Route) -> StepPrices | None:
        """Return the mean prices of the steps of a Route; None if no price until its end is known."""
        start_ns = self._start_ns(route)
        if self.prices is None or not self.prices.is_known(start_ns, self.ready_ns):
            return None
        return partial(self.prices.step_prices, start_ns)

    def in_price_steps(self, route: Route) -> Route:
        """Return a Route that is divided where the price of energy from the grid changes."""
        if self.prices is None or self.step_prices(route) is None:
            return route
        start_ns, shortest_s = self._start_ns(route), LIMITS['duration_s'][0]
        for period in self.prices.periods(start_ns, self.ready_ns)[:-1]:
            at_s = (period.until_ns - start_ns) / NS_PER_S
            if np.abs(route.time_s - at_s).min() > shortest_s:
                route = route.before(at_s).followed_by(route.after(at_s))
        return route

    def plan(self, vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal, method: str,
             uncertainty: Uncertainty | None = None) -> Plan:
        """Return the Plan for a vehicle, None: in which everything is known; raises as plan_preheating does."""
        vehicle = self.vehicle(vehicle)
        if self.is_at_once:
            plan = FullPower(vehicle, route, state).plan(vehicle, goal, lambda part: plan_preheating(
                vehicle, part, state, goal, method, uncertainty))
        else:
            plan = plan_preheating(vehicle, route, state, goal, method, uncertainty,
                                   step_prices=self.step_prices(route))
        return self.accounted(plan, state.soc)

    def accounted(self, plan: Plan, soc: float) -> Plan:
        """Return the Plan with the battery's own energy: its charge stays if the grid feeds the heater."""
        if not self.is_from_grid:
            return plan
        return replace(plan, soc=np.full(len(plan.soc), soc),
                       energy_wh=replace(plan.energy_wh, joule=0.0, battery_total=0.0))

    def in_words(self, decision: Decision) -> Decision:
        """Return the Decision in the words of the goal: only a trip has an arrival."""
        if self.is_trip:
            return decision
        plan = decision.plan
        if plan is None:
            return replace(decision, sentence=f'{PREPARING} {decision.explanation}')
        plan = plan.told(plan.status, partial(plan.sentence, words=OF_GOAL))
        plan = replace(plan, note=' '.join(filter(None, (plan.note, self._price_note(decision.plan_start_ns)))))
        return replace(decision, sentence=f'{PREPARING} {plan.explanation}', plan=plan)

    def _start_ns(self, route: Route) -> int:
        return self.ready_ns - round(route.total_duration_s * NS_PER_S)

    def _price_note(self, from_ns: int) -> str:
        """Return the sentence on the prices from an instant [ns] on; '' if they do not count."""
        if self.prices is None:
            return ''
        unknown_ns = self.prices.unknown_from_ns(from_ns, self.ready_ns)
        if unknown_ns is None:
            return 'The grid supplies the heat in the cheapest hours.'
        if not self.prices.is_known(from_ns, self.ready_ns):
            return 'No price of energy is known until then: heating is as late as possible.'
        return ('The grid supplies the heat in the cheapest hours; no price is known from '
                f'{in_words(unknown_ns, self.prices.zone)} on, and such an hour counts as the dearest.')


# Those of a route plan.
OF_ROUTE = Terms()


class SupplyStatus(IntEnum):
    """`power_supply_status` of sensor_msgs/BatteryState; the numbers are those of the message."""

    UNKNOWN = 0
    CHARGING = 1
    DISCHARGING = 2
    NOT_CHARGING = 3
    FULL = 4


@dataclass(frozen=True)
class Measurement:
    """
    The battery's state at an instant [ns of the node's clock], as measured.

    None stands for an unknown terminal voltage [V], current [A], positive = discharging, temperature of
    the coldest cell [deg C], and difference between the warmest and the coldest cell [K]. `location` and
    `serial_number` distinguish batteries ('': not given); their lengths are not bounded, so quote them
    with `errors.quoted`. `arrived_ns` is the instant [ns] at which it was admitted; None: not yet.
    """

    state: BatteryState
    stamp_ns: int
    voltage_v: float | None = None
    current_a: float | None = None
    coldest_cell_c: float | None = None
    cell_spread_k: float | None = None
    supply_status: SupplyStatus = SupplyStatus.UNKNOWN
    location: str = ''
    serial_number: str = ''
    arrived_ns: int | None = field(default=None, compare=False)

    def expires_ns(self, timeout_s: float) -> int:
        """Return when it becomes stale [ns]: `timeout_s` [s] after its stamp, or later if it came late."""
        expires_ns = self.stamp_ns + round(timeout_s * NS_PER_S)
        if self.arrived_ns is None:
            return expires_ns
        return max(expires_ns, self.arrived_ns + round(min(LEAST_HELD_S, timeout_s / 2.0) * NS_PER_S))

    @property
    def power_w(self) -> float | None:
        """Power that the battery delivers at its terminals [W]; None if unknown."""
        if self.voltage_v is None or self.current_a is None:
            return None
        return self.voltage_v * self.current_a

    @property
    def seen(self) -> SeenState:
        """The measurement as the checks of its source compare it."""
        return SeenState(self.stamp_ns / NS_PER_S, self.state.temperature_c, self.state.soc, self.voltage_v,
                         self.serial_number or self.location)

    @property
    def cell_warning(self) -> str:
        """A sentence on cells that differ by more than WIDEST_CELL_SPREAD_K; '' for no more."""
        if self.coldest_cell_c is None or self.cell_spread_k is None or (
                self.cell_spread_k <= WIDEST_CELL_SPREAD_K):
            return ''
        return (f'cell_temperature: the cells differ by {self.cell_spread_k:.1f} K, the coldest is at '
                f'{self.coldest_cell_c:.1f} degC; at most {WIDEST_CELL_SPREAD_K:g} K are expected')


class Progress(NamedTuple):
    """
    The vehicle's place on its route: the distance [m] from its start at an instant [ns].

    `route_start_ns` is the stamp of the route plan from whose start it counts; None: the latest.
    """

    distance_m: float
    stamp_ns: int
    route_id: str = ''
    route_start_ns: int | None = None


@dataclass(frozen=True, eq=False)
class Leg:
    """
    A drive without a stop, and the requests at its end; segment 0 starts at `start_ns` [ns].

    `target_temperature_c` [deg C] None: the planner's default, or its choice without
    `maximum_arrival_temperature_c` [deg C]. `departure` is the battery's state after the preceding stop; None
    without one. `places` are those of the route before it was put into planning steps; None: its own. `charger` is
    the Charger at its end; None: unknown. `terms` are those of the goal's source. `prospect` is the
    ChargingProspect at its end. A leg equals only itself.
    """

    route: Route
    start_ns: int = 0
    charging_planned: bool = True
    target_temperature_c: float | None = None
    minimum_arrival_soc: float = 0.0
    departure: BatteryState | None = None
    places: Places | None = None
    charger: Charger | None = None
    terms: Terms = OF_ROUTE
    prospect: ChargingProspect = CERTAIN
    maximum_arrival_temperature_c: float = math.inf

    def in_planning_steps(self, planning_step_s: float) -> Leg:
        """Return the Leg in steps of `planning_step_s` seconds or longer, with the same places."""
        return replace(self, route=in_planning_steps(self.route, planning_step_s),
                       places=self.places or Places.of_route(self.route))

    def goal(self, default_target_c: float) -> Goal:
        """Return the Goal of the leg; `default_target_c` [deg C] is for one without a target."""
        target_c = self.target_temperature_c
        return Goal(default_target_c if target_c is None else target_c, self.minimum_arrival_soc,
                    self.charging_planned, maximum_arrival_temperature_c=self.maximum_arrival_temperature_c)

    @property
    def arrival_ns(self) -> int:
        """Instant at which the leg ends [ns]."""
        return self.start_ns + round(self.route.total_duration_s * NS_PER_S)

    def ended_for_s(self, instant_ns: int) -> float:
        """Return how long ago [s] the leg ended, at an instant [ns]; negative before its end."""
        return (instant_ns - self.start_ns) / NS_PER_S - self.route.total_duration_s

    def route_ahead(self, instant_ns: int) -> Route | None:
        """Return the Route from an instant [ns] on: all before the start, None after the end."""
        elapsed_s = (instant_ns - self.start_ns) / NS_PER_S
        if elapsed_s >= self.route.total_duration_s:
            return None
        return self.route.after(elapsed_s) if elapsed_s > 0.0 else self.route


@dataclass(frozen=True)
class Mission:
    """
    A trip: at least one Leg, in driving order, with a stop between each and the next.

    The vehicle stood for `standing_time_s` [s] before it; 0: unknown. The legs' instants include `delay_ns` [ns],
    their delay against the route plan. `power_source` is the source of the legs' propulsion power, as text; '' if
    the planner made the trip.
    """

    route_id: str
    legs: tuple[Leg, ...]
    standing_time_s: float = 0.0
    delay_ns: int = 0
    power_source: str = ''

    @property
    def start_ns(self) -> int:
        """Instant at which the first leg starts [ns]."""
        return self.legs[0].start_ns

    @property
    def arrival_ns(self) -> int:
        """Instant at which the last leg ends [ns]."""
        return self.legs[-1].arrival_ns

    @cached_property
    def places(self) -> Places:
        """The Places of the whole trip; its stops are spans in which the vehicle stands."""
        return Places.joined(((leg.start_ns - self.start_ns) / NS_PER_S, leg.places or Places.of_route(leg.route))
                             for leg in self.legs)

    def has_instants_of(self, other: Mission) -> bool:
        """Return whether each leg starts and ends when that of another Mission does."""
        return [(leg.start_ns, leg.arrival_ns) for leg in self.legs] == [
            (leg.start_ns, leg.arrival_ns) for leg in other.legs]

    @property
    def stamp_ns(self) -> int:
        """Stamp of its route plan [ns]."""
        return self.start_ns - self.delay_ns

    def in_planning_steps(self, planning_step_s: float) -> Mission:
        """Return the Mission with its legs in steps of `planning_step_s` seconds or longer."""
        return replace(self, legs=tuple(
            leg.in_planning_steps(planning_step_s) for leg in self.legs))

    def delayed(self, by_ns: int) -> Mission:
        """Return the Mission delayed by `by_ns` [ns], stops included; negative: earlier."""
        return self if by_ns == 0 else replace(self, delay_ns=self.delay_ns + by_ns, legs=tuple(
            replace(leg, start_ns=leg.start_ns + by_ns) for leg in self.legs))

    def leg_number(self, instant_ns: int) -> int:
        """Return the index of the latest leg begun at an instant [ns]; 0 before the trip."""
        return max((number for number, leg in enumerate(self.legs) if leg.start_ns <= instant_ns), default=0)


def goal_of_leg(leg: Leg, vehicle: Vehicle, settings: Settings) -> Goal:
    """Return the Goal of a leg; settings and vehicle complete it."""
    goal = leg.goal(defaults_of(vehicle, settings).target_battery_temperature_c)
    if goal.minimum_arrival_soc > 0.0 and leg.terms.is_trip:
        reserve = min(goal.minimum_arrival_soc + settings.arrival_soc_margin, 1.0)
        goal = replace(goal, minimum_arrival_soc=reserve)
    return goal


def in_planning_steps(route: Route, planning_step_s: float) -> Route:
    """Return the Route in steps of `planning_step_s` seconds, or longer steps for a long route."""
    return route.resampled(max(planning_step_s, route.total_duration_s / MOST_PLANNED_STEPS))


def with_stops(legs: Sequence[Leg], stop_durations_s: Sequence[float]) -> tuple[Leg, ...]:
    """Return the Legs with each one starting [s] after the end of the one before it."""
    placed = list(legs[:1])
    for leg, stop_s in zip(legs[1:], stop_durations_s):
        before = placed[-1]
        gap_ns = round((before.route.total_duration_s + stop_s) * NS_PER_S)
        placed.append(replace(leg, start_ns=before.start_ns + gap_ns))
    return tuple(placed)


def check_mission(vehicle: Vehicle, mission: Mission, default_target_c: float) -> None:
    """Raise InvalidInput, with one problem per quantity, if the mission is outside the vehicle's model."""
    problems = []
    for number, leg in enumerate(mission.legs, start=1):
        try:
            check_situation(vehicle, leg.route, leg.departure, leg.goal(default_target_c))
        except InvalidInput as error:
            # A single leg needs no number.
            where = f'leg {number}: ' if len(mission.legs) > 1 else ''
            problems += [where + problem for problem in error.problems]
    if problems:
        raise InvalidInput(problems)
