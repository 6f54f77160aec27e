# SPDX-License-Identifier: Apache-2.0
"""
Sensitivity of a plan to the battery's temperature at its start, and what not heating would change.

Everything is found with the planner: plans for the same trip and target from other temperatures.
It takes about 25 plans.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
import math
from typing import Any

from bev_preheat.errors import PlanningFailure
from bev_preheat.planning.bracketing import halve
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import METHODS, plan_preheating, plan_unheated
from bev_preheat.planning.schedule import Reason
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import Route
from bev_preheat.tunables import LEAST_TOLD_WH, RESOLUTION_K, SHORTFALL_TOLERANCE_K
from bev_preheat.vehicle.description import Vehicle

# Statuses of plans that have no target.
WITHOUT_TARGET = Status.NO_CHARGING_PLANNED, Status.NOT_WORTH_IT
KELVIN_K = 1.0


@dataclass(frozen=True)
class Sensitivity:
    """
    Sensitivity of a plan.

    With one more kelvin in the battery at the start, the plan takes `kelvin_saves_wh` less battery energy until
    arrival [Wh], and the battery arrives `kelvin_arrives_k` warmer [K]. Heating is needed from temperatures at the
    start below `needed_below_c`, and the target is reached from `reached_from_c` on [deg C]; -inf: below the
    battery's lowest temperature, inf: above its highest, which are `range_c`. Without heating the battery arrives
    `unheated_colder_k` colder [K], and the drive takes `unheated_saves_wh` less battery energy [Wh]. `is_heated`:
    the plan heats with more than surplus regeneration.

    Energies and kelvins are NaN if the compared drive cannot be planned, or its charge does not last.
    """

    kelvin_saves_wh: float
    kelvin_arrives_k: float
    needed_below_c: float
    reached_from_c: float
    range_c: tuple[float, float]
    unheated_colder_k: float
    unheated_saves_wh: float
    is_heated: bool

    def in_words(self, at_charger: str = '') -> str:
        """Return the sentences; `at_charger` is added to that on not heating: its cost at the charger."""
        return ' '.join(filter(None, (
            self._kelvin_sentence(), self._bounds_sentence(), self._unheated_sentence(at_charger))))

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as in the JSON: NaN and infinity are None."""
        figures = {name: getattr(self, name) for name in (
            'kelvin_saves_wh', 'kelvin_arrives_k', 'needed_below_c', 'reached_from_c', 'unheated_colder_k',
            'unheated_saves_wh')}
        return {**{name: value if math.isfinite(value) else None for name, value in figures.items()},
                'sentence': self.in_words()}

    def _kelvin_sentence(self) -> str:
        if math.isnan(self.kelvin_saves_wh):
            return ''
        left = ('' if self.kelvin_arrives_k < RESOLUTION_K else
                f', and the battery would arrive {self.kelvin_arrives_k:.2f} K warmer')
        verb = 'cost' if self.kelvin_saves_wh <= -LEAST_TOLD_WH else 'save'
        return (f'One more kelvin in the battery now would {verb} {abs(self.kelvin_saves_wh):.1f} Wh until '
                f'arrival{left}.')

    def _bounds_sentence(self) -> str:
        lowest_c, highest_c = self.range_c
        if self.reached_from_c == math.inf:
            return f'The target is missed even from {highest_c:g} degC in the battery now.'
        if self.needed_below_c == -math.inf:
            return f'Heating is not needed even from {lowest_c:g} degC in the battery now.'
        if self.needed_below_c <= self.reached_from_c + RESOLUTION_K:
            return (f'The target is reached only from {self.reached_from_c:.1f} degC in the battery now on, '
                    'without heating.')
        needed = (f'Heating is needed even from {highest_c:g} degC in the battery now'
                  if self.needed_below_c == math.inf else
                  f'Heating is needed if the battery is below {self.needed_below_c:.1f} degC now')
        reached = (f'even from {lowest_c:g} degC the target is reached' if self.reached_from_c == -math.inf else
                   f'below {self.reached_from_c:.1f} degC the target is out of reach')
        return f'{needed}; {reached}.'

    def _unheated_sentence(self, at_charger: str) -> str:
        if not self.is_heated or math.isnan(self.unheated_colder_k):
            return ''
        energy = f'{abs(self.unheated_saves_wh):.0f} Wh {"less" if self.unheated_saves_wh >= 0.0 else "more"}'
        charger = f'; {at_charger}' if at_charger else ''
        return (f'Without heating the battery would arrive {self.unheated_colder_k:.1f} K colder and the drive '
                f'would take {energy}{charger}.')


def find_sensitivity(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal,
                     plan: Plan) -> Sensitivity | None:
    """Return the Sensitivity of a Plan of `plan_preheating` for these inputs; None if it has none."""
    # Methods of other packages may be slow; the bounds are those of heating.
    if (plan.status in WITHOUT_TARGET or plan.stranding is not None or plan.method not in METHODS
            or math.isfinite(goal.maximum_arrival_temperature_c)):
        return None
    range_c = lowest_c, highest_c = vehicle.battery.temperature_range_c

    def plan_from(temperature_c: float) -> Plan | None:
        try:
            return plan_preheating(vehicle, route, replace(state, temperature_c=temperature_c), goal, plan.method)
        except PlanningFailure:
            return None

    # At the upper end of the range: one kelvin less.
    step_k = KELVIN_K if state.temperature_c + KELVIN_K <= highest_c else -KELVIN_K
    saved_wh, arriving_k = _beyond(plan, plan_from(state.temperature_c + step_k))
    needed_below_c = _change(_is_warm_enough, plan, state.temperature_c, plan_from, lowest_c, highest_c)
    reached_from_c = _change(_is_reached, plan, state.temperature_c, plan_from, lowest_c, highest_c)
    saves_wh, warmer_k = _beyond(plan, plan_unheated(vehicle, route, state, goal))
    return Sensitivity(
        saved_wh / step_k, arriving_k / step_k, needed_below_c, reached_from_c, range_c, -warmer_k, saves_wh,
        _is_heated(plan))


def _is_heated(plan: Plan) -> bool:
    """Return whether a Plan heats with more than surplus regeneration."""
    return any(interval.reason is not Reason.SURPLUS for interval in plan.intervals)


def _is_warm_enough(plan: Plan | None) -> bool:
    """Return whether a Plan reaches its target without heating; None, a failed plan, does not."""
    return plan is not None and not _is_heated(plan) and _is_reached(plan)


def _is_reached(plan: Plan | None) -> bool:
    return plan is not None and plan.shortfall_k <= SHORTFALL_TOLERANCE_K


def _beyond(plan: Plan, other: Plan | None) -> tuple[float, float]:
    """Return the battery energy that another Plan saves [Wh], and how much warmer it arrives [K]; NaN: unknown."""
    if other is None or other.stranding is not None:
        return math.nan, math.nan
    return (plan.energy_wh.battery_total - other.energy_wh.battery_total,
            other.arrival_temperature_c - plan.arrival_temperature_c)


def _change(holds: Callable[[Plan | None], bool], plan: Plan, at_c: float,
            plan_from: Callable[[float], Plan | None], lowest_c: float,
            highest_c: float) -> float:
    """
    Return the temperature at the start from which `holds` is true of the plan, to RESOLUTION_K.

    `plan` starts from `at_c`. -inf: it is true at the lowest temperature [deg C] already, inf: not at the highest.
    """
    is_held = holds(plan)
    end_c = lowest_c if is_held else highest_c
    if holds(plan_from(end_c)) == is_held:
        return -math.inf if is_held else math.inf
    true_c, false_c = (at_c, end_c) if is_held else (end_c, at_c)
    halvings = math.ceil(math.log2(max((true_c - false_c) / RESOLUTION_K, 1.0)))
    return halve(true_c, false_c, lambda middle_c: holds(plan_from(middle_c)), halvings)
