# SPDX-License-Identifier: Apache-2.0
"""When the pursuit of a Wish is over, and why; instants are integers, in nanoseconds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.planner import SHORTFALL_TOLERANCE_K
from bev_preheat.supervision.assumed_drive import drives_between
from bev_preheat.supervision.command import find_obstacle
from bev_preheat.supervision.inputs import NS_PER_S
from bev_preheat.supervision.wish import Ending

if TYPE_CHECKING:
    from bev_preheat.planning.plan import Plan
    from bev_preheat.supervision.decision import Decision
    from bev_preheat.supervision.inbox import Inbox
    from bev_preheat.supervision.wish import Wish

    # None: it goes on.
    Conclusion = tuple[Ending, str] | None

# For how long "as soon as possible" may heat [s].
LONGEST_SOONEST_S = 6 * 3600.0
# What keeps the heater off for so long ends a goal [s].
PATIENCE_S = 60.0
# A battery that is heated as soon as possible is warm when it is this near to its target [K].
SOONEST_WITHIN_K = 0.1
# Of a vehicle that is plugged in the charge does not fall by more than this.
CHARGE_FALLS_BY = 0.02


@dataclass
class Pursuit:
    """
    A Wish that is pursued: its target and ambient temperature [deg C], and when it began [ns].

    `highest_soc` is the most charge that there has been since. `expected_ns` is the instant at which
    the battery is predicted to be warm, `held_off_ns` since when nothing can be planned; None: neither
    is known.
    """

    wish: Wish
    target_c: float
    started_ns: int
    highest_soc: float
    ambient_c: float | None = None
    expected_ns: int | None = None
    held_off_ns: int | None = None


def conclusion(pursuit: Pursuit, inbox: Inbox, now_ns: int, decision: Decision,
               temperature_c: float | None) -> Conclusion:
    """
    Return (Ending, sentence) where a Pursuit is over at an instant [ns]; None where it goes on.

    `decision` is the one that holds now, `temperature_c` the battery's temperature [deg C]. What it
    tells of the pursuit is noted in it.
    """
    if not inbox.is_enabled:
        return Ending.DISABLED, 'Preheating was switched off through ~/enable.'
    objection = contradiction(pursuit, inbox, now_ns)
    if objection:
        return Ending.UNPLUGGED, f'The vehicle is not plugged in any more: {objection}.'
    if decision.plan is not None:
        pursuit.held_off_ns = None
        pursuit.expected_ns = decision.plan_start_ns + round(decision.plan.arrival_time_s * NS_PER_S)
    elif pursuit.held_off_ns is None:
        pursuit.held_off_ns = now_ns
    is_time = 0 < pursuit.wish.ready_at_ns <= now_ns
    if find_obstacle(inbox, now_ns) is not None or temperature_c is None or (
            decision.plan is None and not is_time):
        held_off_s = (now_ns - (pursuit.held_off_ns or now_ns)) / NS_PER_S
        if is_time:
            return Ending.INPUT_LOST, f'The heater was off at the instant: {decision.explanation}'
        if held_off_s >= PATIENCE_S:
            return Ending.INPUT_LOST, (
                f'The heater has been off for {duration_text(held_off_s)}: {decision.explanation}')
        return None
    if pursuit.wish.is_soonest:
        assert decision.plan is not None
        return _soonest_conclusion(pursuit, now_ns, decision.plan, temperature_c)
    if not is_time:
        return None
    missed_k = pursuit.target_c - temperature_c
    return _arrived(temperature_c, pursuit.target_c, missed_k <= SHORTFALL_TOLERANCE_K)


def _soonest_conclusion(pursuit: Pursuit, now_ns: int, plan: Plan, temperature_c: float) -> Conclusion:
    target_c = pursuit.target_c
    is_idle = plan.heating_start_s is None
    if target_c - temperature_c <= SOONEST_WITHIN_K or (
            is_idle and target_c - temperature_c <= SHORTFALL_TOLERANCE_K):
        return _arrived(temperature_c, target_c, True)
    missed = (f'The battery is at {temperature_c:.1f} degC and does not get to the target of '
              f'{target_c:.1f} degC')
    if plan.arrival_time_s >= LONGEST_SOONEST_S - 1.0:
        return Ending.MISSED, f'{missed}, not even at full power for {duration_text(LONGEST_SOONEST_S)}.'
    if (now_ns - pursuit.started_ns) / NS_PER_S >= LONGEST_SOONEST_S:
        return Ending.MISSED, f'{missed} within {duration_text(LONGEST_SOONEST_S)}.'
    if is_idle and plan.shortfall_k > SHORTFALL_TOLERANCE_K:
        return Ending.MISSED, f'{missed}: {plan.explanation}'
    return None


def contradiction(pursuit: Pursuit, inbox: Inbox, now_ns: int) -> str:
    """Return what speaks against a vehicle that is plugged in, as a sentence; '': nothing."""
    mission, measurement = inbox.mission, inbox.measurement
    if not pursuit.wish.is_plugged_in:
        return ''
    if mission is not None and drives_between(mission, now_ns, pursuit.wish.ready_at_ns):
        return f'the route plan {mission.route_id!r} drives before the battery is to be warm'
    if measurement is None:
        return ''
    soc = measurement.state.soc
    pursuit.highest_soc = max(pursuit.highest_soc, soc)
    if pursuit.highest_soc - soc > CHARGE_FALLS_BY:
        return (f'the state of charge has fallen from {100 * pursuit.highest_soc:.1f} % to '
                f'{100 * soc:.1f} %')
    return ''


def _arrived(temperature_c: float, target_c: float, is_warm: bool) -> tuple[Ending, str]:
    if is_warm:
        return Ending.REACHED, (f'The battery is warm: {temperature_c:.1f} degC, target '
                                f'{target_c:.1f} degC.')
    return Ending.MISSED, (f'The battery is at {temperature_c:.1f} degC, {target_c - temperature_c:.1f} K '
                           f'below the target of {target_c:.1f} degC.')
