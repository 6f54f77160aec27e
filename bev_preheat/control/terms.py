# SPDX-License-Identifier: Apache-2.0
"""The terms of a goal's source for its plans, beside route and target; behind them all sources are alike."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.control.departures import in_words
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import OF_GOAL
from bev_preheat.planning.full_power import FullPower
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.route.segments import LIMITS
from bev_preheat.vehicle.variants import grid_fed

if TYPE_CHECKING:
    from bev_preheat.control.decision import Decision
    from bev_preheat.control.departures import GridPrices
    from bev_preheat.control.target_choice import TargetChoice
    from bev_preheat.planning.plan import Plan
    from bev_preheat.planning.schedule import StepPrices
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.route.segments import Route
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

    def plan(self, vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal, method: str) -> Plan:
        """Return the Plan for a vehicle, in which everything is known; raises as plan_preheating does."""
        vehicle = self.vehicle(vehicle)
        if self.is_at_once:
            plan = FullPower(vehicle, route, state).plan(vehicle, goal, lambda part: plan_preheating(
                vehicle, part, state, goal, method))
        else:
            plan = plan_preheating(vehicle, route, state, goal, method, step_prices=self.step_prices(route))
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
