# SPDX-License-Identifier: Apache-2.0
"""The preparations of the next week's departures, as the planner would plan them from now."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bev_preheat.control.departures import DAYS_A_WEEK
from bev_preheat.control.expected_drive import steady_drive
from bev_preheat.control.inputs import in_planning_steps
from bev_preheat.control.terms import Terms
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.plan import cost_of
from bev_preheat.planning.planner import DEFAULT_METHOD
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import LIMITS
from bev_preheat.tunables import BEGINS_S, BEGINS_WITH_PRICES_S, PLANNING_STEP_S

if TYPE_CHECKING:
    from typing import Any

    from bev_preheat.control.departures import Departures, GridPrices, Occurrence
    from bev_preheat.planning.plan import Plan
    from bev_preheat.vehicle.description import Vehicle

WEEK_NS = DAYS_A_WEEK * 86400 * NS_PER_S


@dataclass(frozen=True)
class PreparedDeparture:
    """
    A departure and its Plan, which starts at `start_ns` [ns].

    `cost` is that of the energy from the grid, `latest_cost` that of heating as late as possible, both in the
    currency of the prices; None for a vehicle that is not plugged in, and without prices.
    """

    occurrence: Occurrence
    start_ns: int
    plan: Plan
    cost: float | None
    latest_cost: float | None

    def heating_ns(self) -> list[tuple[int, int]]:
        """Return (begin, end) [ns] of each heating interval."""
        return [(self.start_ns + round(interval.start_s * NS_PER_S),
                 self.start_ns + round(interval.end_s * NS_PER_S)) for interval in self.plan.intervals]

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as JSON-compatible numbers, texts and lists; instants in seconds since 1970."""
        departure, plan = self.occurrence.departure, self.plan
        return {
            'name': departure.name, 'departure_s': self.occurrence.instant_ns / NS_PER_S,
            'plugged_in': departure.is_plugged_in, 'status': plan.status.name,
            'target_c': plan.target_temperature_c, 'temperature_c': plan.arrival_temperature_c,
            'hvch_electric_wh': plan.energy_wh.hvch_electric,
            'heating_s': [[begin / NS_PER_S, end / NS_PER_S] for begin, end in self.heating_ns()],
            'cost': self.cost, 'latest_cost': self.latest_cost}


def prepare_week(vehicle: Vehicle, departures: Departures, prices: GridPrices | None, from_ns: int,
                 soc: float, ambient_c: float | None = None,
                 temperature_c: float | None = None) -> list[PreparedDeparture]:
    """
    Return the PreparedDeparture of each departure within a week of an instant [ns].

    When a preparation may begin, the battery has `soc` (0 ... 1) and `temperature_c` [deg C], None: the ambient
    temperature. `ambient_c` [deg C] None: that of the file. Raises InvalidInput if something is out of range.
    """
    ambient_c = departures.ambient_c if ambient_c is None else ambient_c
    if ambient_c is None:
        raise InvalidInput('--ambient: is missing, and the file of departures has no ambient_temperature_c')
    low_c, high_c = LIMITS['ambient_temperature_c']
    if not low_c <= ambient_c <= high_c:
        raise InvalidInput(
            f'--ambient: {ambient_c:g} degC is not allowed; it must be {low_c:g} ... {high_c:g} degC')
    state = BatteryState(ambient_c if temperature_c is None else temperature_c, soc)
    prepared, free_ns = [], from_ns
    for occurrence in departures.until(from_ns, from_ns + WEEK_NS):
        prepared.append(_prepared(vehicle, occurrence, prices, free_ns, state, ambient_c))
        # The planner prepares one departure at a time.
        free_ns = occurrence.instant_ns
    return prepared


def _prepared(vehicle: Vehicle, occurrence: Occurrence, prices: GridPrices | None, free_ns: int,
              state: BatteryState, ambient_c: float) -> PreparedDeparture:
    departure, ready_ns = occurrence.departure, occurrence.instant_ns
    terms = Terms(is_trip=False, is_from_grid=departure.is_plugged_in, ready_ns=ready_ns,
                  prices=prices if departure.is_plugged_in else None)
    begins_s = BEGINS_S if terms.prices is None else BEGINS_WITH_PRICES_S
    start_ns = max(free_ns, ready_ns - round(begins_s * NS_PER_S))
    route = terms.in_price_steps(in_planning_steps(steady_drive(
        (ready_ns - start_ns) / NS_PER_S, ambient_c, vehicle.defaults), PLANNING_STEP_S))
    target_c = vehicle.defaults.target_battery_temperature_c if departure.target_c is None else departure.target_c
    situation = vehicle, route, state, Goal(target_c), DEFAULT_METHOD
    try:
        plan, step_prices = terms.plan(*situation), terms.step_prices(route)
        if step_prices is None:
            return PreparedDeparture(occurrence, start_ns, plan, None, None)
        latest = terms._replace(prices=None).plan(*situation)
    except InvalidInput as error:
        raise InvalidInput([f'departure {departure.name}: {problem}' for problem in error.problems]) from error
    return PreparedDeparture(occurrence, start_ns, plan, cost_of(plan, step_prices), cost_of(latest, step_prices))
