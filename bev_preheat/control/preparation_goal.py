# SPDX-License-Identifier: Apache-2.0
"""A goal of ~/prepare_battery, its progress and its end; instants are integers, in nanoseconds."""
from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
import math
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.control.expected_drive import drives_between
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.tunables import (
    CHARGE_FALLS_BY,
    LONGEST_SOONEST_S,
    OBSTACLE_ENDS_GOAL_S,
    SHORTFALL_TOLERANCE_K,
    SOONEST_WITHIN_K,
)

if TYPE_CHECKING:
    from bev_preheat.control.decision import Decision, Moment
    from bev_preheat.control.departures import GridPrices
    from bev_preheat.planning.plan import Plan


class PreparationEnding(IntEnum):
    """Why a goal ended; the values of PrepareBattery's `code`."""

    REACHED = 1
    MISSED = 2
    CANCELED = 3
    REFUSED = 4
    REPLACED = 5
    DISABLED = 6
    INPUT_LOST = 7
    UNPLUGGED = 8
    SHUTTING_DOWN = 9


# None: the preparation continues.
Conclusion = tuple[PreparationEnding, str] | None


@dataclass(frozen=True, eq=False)
class PreparationGoal:
    """
    A request for a warm battery at an instant [ns of the node's clock]; it equals only itself.

    `ready_at_ns` 0: as soon as possible. `target_c` [deg C] None: the planner's default.
    `is_plugged_in`: the vehicle stands, and the grid feeds the heater. `ambient_c` [deg C] None: that
    of the route, or the last known; `assumed_ambient_c` [deg C] counts if none is known. `prices` are those of
    energy from the grid: a plugged-in vehicle is heated when it costs the least; None: as late as possible. The
    battery is cooled to `maximum_arrival_temperature_c` [deg C]; None: it may be warmer.
    """

    ready_at_ns: int = 0
    target_c: float | None = None
    is_plugged_in: bool = False
    ambient_c: float | None = None
    assumed_ambient_c: float | None = None
    prices: GridPrices | None = None
    maximum_arrival_temperature_c: float | None = None

    @property
    def most_c(self) -> float:
        """The highest temperature at the instant [deg C]; inf: any."""
        most_c = self.maximum_arrival_temperature_c
        return math.inf if most_c is None else most_c

    @property
    def is_soonest(self) -> bool:
        """Whether the battery is wanted warm as soon as possible."""
        return self.ready_at_ns == 0


class PreparationOutcome(NamedTuple):
    """
    The ending of a PreparationGoal, with the reason as a sentence.

    `shortfall_k` is by how much the battery is too cold or too warm [K], `temperature_c` its temperature [deg C];
    NaN if unknown.
    """

    preparation_goal: PreparationGoal
    ending: PreparationEnding
    explanation: str
    shortfall_k: float = math.nan
    temperature_c: float = math.nan


@dataclass(frozen=True)
class PreparationProgress:
    """
    Progress of the current PreparationGoal: target and ambient temperature [deg C], and start [ns].

    `highest_soc` is the highest state of charge since the start. `expected_ns` is the instant at which the
    battery is predicted to be warm, None: unknown; `held_off_ns` the instant since which no plan can be made,
    None: a plan can be made.
    """

    goal: PreparationGoal
    target_c: float
    started_ns: int
    highest_soc: float
    ambient_c: float | None = None
    expected_ns: int | None = None
    held_off_ns: int | None = None


def conclusion(progress: PreparationProgress, moment: Moment, decision: Decision,
               obstacle: Decision | None) -> tuple[PreparationProgress, Conclusion]:
    """Return the progress, and (PreparationEnding, sentence) if it is over at a Moment; None if it continues."""
    if not moment.is_enabled:
        return progress, (PreparationEnding.DISABLED, 'Preheating was switched off through ~/enable.')
    if moment.measurement is not None:
        progress = replace(progress, highest_soc=max(progress.highest_soc, moment.measurement.state.soc))
    objection = contradiction(progress, moment)
    if objection:
        return progress, (PreparationEnding.UNPLUGGED, f'The vehicle is no longer plugged in: {objection}.')
    if decision.plan is not None:
        progress = replace(progress, held_off_ns=None, expected_ns=decision.plan_start_ns + round(
            decision.plan.arrival_time_s * NS_PER_S))
    elif progress.held_off_ns is None:
        progress = replace(progress, held_off_ns=moment.now_ns)
    return progress, _conclusion(progress, moment, decision, obstacle)


def _conclusion(progress: PreparationProgress, moment: Moment, decision: Decision,
                obstacle: Decision | None) -> Conclusion:
    now_ns, temperature_c = moment.now_ns, moment.temperature_c
    is_time = 0 < progress.goal.ready_at_ns <= now_ns
    if obstacle is not None or temperature_c is None or (
            decision.plan is None and not is_time):
        held_off_s = (now_ns - (progress.held_off_ns or now_ns)) / NS_PER_S
        if is_time:
            return PreparationEnding.INPUT_LOST, (
                f'The heater was off at the requested time: {decision.explanation}')
        if held_off_s >= OBSTACLE_ENDS_GOAL_S:
            return PreparationEnding.INPUT_LOST, (
                f'The heater has been off for {duration_text(held_off_s)}: {decision.explanation}')
        return None
    if progress.goal.is_soonest:
        assert decision.plan is not None
        return _soonest_conclusion(progress, now_ns, decision.plan, temperature_c)
    if not is_time:
        return None
    most_c, missed_k = progress.goal.most_c, progress.target_c - temperature_c
    if temperature_c - most_c > SHORTFALL_TOLERANCE_K:
        return PreparationEnding.MISSED, (
            f'The battery is at {temperature_c:.1f} degC, {temperature_c - most_c:.1f} K above the {most_c:.1f} '
            'degC allowed.')
    return _arrived(temperature_c, progress.target_c, missed_k <= SHORTFALL_TOLERANCE_K)


def _soonest_conclusion(progress: PreparationProgress, now_ns: int, plan: Plan,
                        temperature_c: float) -> Conclusion:
    target_c = progress.target_c
    is_idle = plan.heating_start_s is None
    if target_c - temperature_c <= SOONEST_WITHIN_K or (
            is_idle and target_c - temperature_c <= SHORTFALL_TOLERANCE_K):
        return _arrived(temperature_c, target_c, True)
    missed = (f'The battery is at {temperature_c:.1f} degC and does not reach the target of '
              f'{target_c:.1f} degC')
    if plan.arrival_time_s >= LONGEST_SOONEST_S - 1.0:
        return PreparationEnding.MISSED, (
            f'{missed}, not even at full power for {duration_text(LONGEST_SOONEST_S)}.')
    if (now_ns - progress.started_ns) / NS_PER_S >= LONGEST_SOONEST_S:
        return PreparationEnding.MISSED, f'{missed} within {duration_text(LONGEST_SOONEST_S)}.'
    if is_idle and plan.shortfall_k > SHORTFALL_TOLERANCE_K:
        return PreparationEnding.MISSED, f'{missed}: {plan.explanation}'
    return None


def contradiction(progress: PreparationProgress, moment: Moment) -> str:
    """Return the evidence that the vehicle is not plugged in, as a sentence; '' without evidence."""
    mission, measurement = moment.mission, moment.measurement
    if not progress.goal.is_plugged_in:
        return ''
    if mission is not None and drives_between(mission, moment.now_ns, progress.goal.ready_at_ns):
        return f'the route plan {mission.route_id!r} drives before the battery is to be warm'
    if measurement is None:
        return ''
    soc = measurement.state.soc
    if progress.highest_soc - soc > CHARGE_FALLS_BY:
        return (f'the state of charge has fallen from {100 * progress.highest_soc:.1f} % to '
                f'{100 * soc:.1f} %')
    return ''


def _arrived(temperature_c: float, target_c: float, is_warm: bool) -> tuple[PreparationEnding, str]:
    if is_warm:
        return PreparationEnding.REACHED, (
            f'The battery is warm: {temperature_c:.1f} degC, target {target_c:.1f} degC.')
    return PreparationEnding.MISSED, (
        f'The battery is at {temperature_c:.1f} degC, {target_c - temperature_c:.1f} K below the target of '
        f'{target_c:.1f} degC.')
