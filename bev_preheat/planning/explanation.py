# SPDX-License-Identifier: Apache-2.0
"""One sentence for each outcome, with the figures that decided it."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.numerics import JOULES_PER_WH
from bev_preheat.planning.schedule import HeldBack, Reason, Stranding
from bev_preheat.planning.status import Status
from bev_preheat.tunables import LEAST_HEATING_W, LEAST_TOLD_S, MOST_PHASES

if TYPE_CHECKING:
    from bev_preheat.planning.plan import Plan

# Why a plan does not heat though the battery arrives too cold.
NO_POWER, NOT_POSSIBLE = 'Cabin heating leaves no power for the battery', 'The battery cannot be heated'
TOO_LATE = 'Further heat would arrive too late'


class Words(NamedTuple):
    """The words of a sentence that depend on the plan's purpose."""

    arrival: str
    low_charge: str


OF_TRIP = Words('arrival in {time} at {temperature} degC', 'The battery arrives {missing} below')
# A preparation goal: warm at an instant, without a trip.
OF_GOAL = Words('in {time} the battery is at {temperature} degC', 'The battery will be {missing} below')


def duration_text(seconds: float) -> str:
    """Return a duration as 1:02:03 h or 12:34 min."""
    total = round(seconds)
    hours, minutes, rest = total // 3600, total // 60 % 60, total % 60
    return f'{hours}:{minutes:02d}:{rest:02d} h' if hours else f'{minutes}:{rest:02d} min'


def explain(plan: Plan, reserve: float, starts_in_s: float = 0.0, unheated: str = 'the heater stays off',
            too_cold_because: str = '',
            heated_s: float = 0.0, words: Words = OF_TRIP) -> str:
    """
    Return the sentence for a Plan's status; `reserve` is the state of charge to keep.

    Times count from now; the plan's time 0 is `starts_in_s` [s] ahead. A plan without heating is described
    as `unheated`, and as `too_cold_because` if that makes it miss the target ('': the plan's own reason).
    The battery has been heated for `heated_s` [s] on this drive.
    """
    def from_now(plan_s: float) -> str:
        return duration_text(max(0.0, plan_s + starts_in_s))

    begins = (f'The route begins in {duration_text(starts_in_s)}. '
              if starts_in_s >= LEAST_TOLD_S else '')
    note = f' {plan.note}' if plan.note else ''
    arrival = words.arrival.format(
        time=from_now(plan.arrival_time_s), temperature=f'{plan.arrival_temperature_c:.1f}')
    outcome = _cooled_in_words(plan, reserve, arrival, from_now) or _outcome(
        plan, reserve, arrival, from_now, starts_in_s > 0.0, unheated,
        too_cold_because or plan.unheated_because, heated_s, words.low_charge)
    return begins + outcome + _sources_in_words(plan) + note


def _sources_in_words(plan: Plan) -> str:
    """Return a sentence on the heat sources in the order of their use; '' for the HVCH alone, or without heat."""
    phases: list[tuple[list[str], float]] = []
    for k, start_c in enumerate(plan.battery_temperature_c[:-1].tolist()):
        names = [name for name, power_w in plan.source_power_w.items() if power_w[k] > LEAST_HEATING_W]
        if names and (not phases or phases[-1][0] != names):
            phases.append((names, start_c))
    if not phases:
        return ''
    if len(phases) > MOST_PHASES:
        sums_wh = ((name, float(power_w @ np.diff(plan.time_s)) / JOULES_PER_WH)
                   for name, power_w in plan.source_power_w.items())
        return f' Sources: {", ".join(f"{name} {sum_wh:.0f} Wh" for name, sum_wh in sums_wh if sum_wh >= 1.0)}.'
    texts = [' and '.join(names) for names, _ in phases]
    return f' Sources: {texts[0]}' + ''.join(
        f' until {start_c:.1f} degC, then {text}' for text, (_, start_c) in zip(texts[1:], phases[1:])) + '.'


def _outcome(plan: Plan, reserve: float, arrival: str, from_now: Callable[[float], str], is_ahead: bool,
             unheated: str, too_cold_because: str, heated_s: float, low_charge: str) -> str:
    status = plan.status
    target = f'target {plan.target_temperature_c:.1f} degC'
    if status is Status.NO_CHARGING_PLANNED:
        if plan.stranding is not None:
            return (f'No fast charging at the end of this route: {unheated}. '
                    f'{_stranding_sentence(plan.stranding, from_now)}')
        return f'No fast charging at the end of this route: {unheated}; {arrival}.'
    if status is Status.OUT_OF_CHARGE and plan.stranding is not None:
        heating = (unheated if plan.heating_start_s is None else
                   'only surplus regeneration heats the battery'
                   if all(interval.reason is Reason.SURPLUS for interval in plan.intervals) else
                   "this plan's heating increases the deficit")
        return f'{_stranding_sentence(plan.stranding, from_now)[:-1]}; {heating}.'
    if status is Status.NOT_WORTH_IT:
        return f'{unheated.capitalize()}: {arrival}.'
    if status is Status.NOT_NEEDED and plan.held_back is HeldBack.START and plan.shortfall_k > 0.0:
        return f'The heater is not switched on for {plan.shortfall_k:.1f} K: {arrival}, {target}.'
    if status is Status.NOT_NEEDED:
        if heated_s > 0.0:
            return f'Heating finished after {duration_text(heated_s)}: {arrival}, {target}.'
        return f'The battery gets warm enough without further heating: {arrival}, {target}.'
    if status is Status.WAITING and plan.heating_start_s is not None:
        verb = 'resumes' if heated_s > 0.0 else 'starts'
        return f'Heating {verb} in {from_now(plan.heating_start_s)}: {arrival}, {target}.'
    if status is Status.HEATING:
        return f'Heating: {arrival}, {target}.'
    if status is Status.TARGET_UNREACHABLE:
        means = (too_cold_because if plan.heating_start_s is None else
                 'Heating whenever cabin heating and limits allow is not enough' if _pauses(plan) else
                 'Heating all the way is not enough' if plan.heating_start_s == 0.0 else
                 f'Heating from {from_now(plan.heating_start_s)} on is not enough')
        return f'{means}: {arrival}, {plan.shortfall_k:.1f} K below the {target}.'
    heating = (unheated if plan.heating_start_s is None else
               'heating is on' if plan.heating_start_s == 0.0 and not is_ahead else
               f'heating starts in {from_now(plan.heating_start_s)}')
    if status is Status.SOC_LIMITED:
        reserve_text = f'{100 * reserve:.1f} %'
        if plan.soc_shortfall > 0.0:
            missing = low_charge.format(missing=f'{100 * plan.soc_shortfall:.1f} %')
            return f'{missing} the {reserve_text} reserve: {heating}; {arrival}, {target}.'
        if plan.held_back is HeldBack.POWER:
            return (f'More heating would leave the battery unable to deliver the power of the route; the target '
                    f'is missed by {plan.shortfall_k:.1f} K: {heating}; {arrival}, {target}.')
        return (f'To keep the {reserve_text} reserve, the target is missed by {plan.shortfall_k:.1f} K: '
                f'{heating}; {arrival}, {target}.')
    if status is Status.POWER_LIMITED and plan.undeliverable_at_s is not None:
        return (f'In {from_now(plan.undeliverable_at_s)} the route needs '
                f'{plan.undeliverable_power_w / 1000:.1f} kW more than the battery can deliver; '
                f'{heating}; {arrival}, {target}.')
    raise ValueError(f'{status!r} is not an outcome of planning')


def _pauses(plan: Plan) -> bool:
    """Return whether heating pauses after its start; at the end, heat that would arrive too late is left out."""
    start_s = plan.heating_start_s or 0.0
    heated = [each for each in plan.intervals if each.end_s > start_s]
    end_s = plan.arrival_time_s if plan.heat is None else max((each.end_s for each in heated), default=start_s)
    return end_s - start_s - sum(each.end_s - each.start_s for each in heated) > LEAST_TOLD_S


def _cooled_in_words(plan: Plan, reserve: float, arrival: str, from_now: Callable[[float], str]) -> str:
    """Return the sentence on a plan that cools, or whose battery arrives too hot; '' for any other."""
    most_c, start_s = plan.maximum_arrival_temperature_c, plan.cooling_start_s
    starts_in = from_now(start_s or 0.0)
    if plan.status in (Status.WAITING_TO_COOL, Status.COOLING):
        starts = '' if plan.status is Status.COOLING else f' starts in {starts_in}'
        at_most = '' if math.isinf(most_c) else f', at most {most_c:.1f} degC'
        return f'Cooling{starts}: {arrival}{at_most}.'
    if plan.status is Status.NOT_NEEDED and math.isfinite(most_c):
        return f'Neither heating nor further cooling is needed: {arrival}, at most {most_c:.1f} degC.'
    if plan.arrival_temperature_c > most_c and plan.status in (Status.TARGET_UNREACHABLE, Status.SOC_LIMITED):
        means = ('The battery cannot be cooled' if not plan.source_power_w else
                 'Without further cooling' if start_s is None else
                 'Cooling all the way is not enough' if start_s == 0.0 else
                 f'Cooling from {starts_in} on is not enough')
        if plan.held_back is HeldBack.RESERVE:
            means = f'To keep the {100 * reserve:.1f} % reserve, the battery is cooled less'
        return f'{means}: {arrival}, {plan.shortfall_k:.1f} K above the {most_c:.1f} degC allowed.'
    return ''


def _stranding_sentence(stranding: Stranding, from_now: Callable[[float], str]) -> str:
    """Return the sentence on where the charge runs out, with the deficit."""
    return (f'The battery will be empty in {from_now(stranding.at_s)}, at km {stranding.at_m / 1000.0:.1f} '
            f'({stranding.deficit_wh / 1000.0:.2f} kWh short).')
