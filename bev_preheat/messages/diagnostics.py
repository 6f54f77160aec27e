# SPDX-License-Identifier: Apache-2.0
"""Entries of /diagnostics: how every node writes them and a reader reads them back, and those of the planner."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from bev_preheat.estimation.estimate import FACTOR_NAMES
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.messages.fields import time_message
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.status import Level
from bev_preheat.vehicle.core_library import core_in_words, declines_in_words
from bev_preheat.vehicle.heater_controller import Refusal
from bev_preheat.vehicle.plausibility import assumed_in_words

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from bev_preheat.control.heater import HeaterAnswers
    from bev_preheat.control.preparation_goal import PreparationGoal
    from bev_preheat.control.state import State
    from bev_preheat.estimation.estimate import Estimate
    from bev_preheat.estimation.hypotheses import HeaterReport

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
LEVELS = {Level.OK: OK, Level.WARN: WARN, Level.ERROR: ERROR}
HEATER_LEVELS = {
    Heater.ANSWERS: OK,
    Heater.DERATED: WARN,
    Heater.DEAD: ERROR,
    Heater.STUCK_ON: ERROR,
}
HEATER_SENTENCES = {
    Heater.ANSWERS: 'responds normally',
    Heater.DERATED: 'it gives only {share:.0f} % of the commanded power; planned accordingly',
    Heater.DEAD: 'the battery does not get the commanded heat; it is still commanded',
    Heater.STUCK_ON: 'the battery is heated without a command',
}
# Of a heat source beside the HVCH, and of a chiller.
SOURCE_SENTENCES = {
    **HEATER_SENTENCES, Heater.DEAD: 'the battery does not get the commanded heat; it gets no command any more'}
CHILLER_SENTENCES = {
    **SOURCE_SENTENCES, Heater.DEAD: 'the battery is not cooled as commanded; it gets no command any more',
    Heater.STUCK_ON: 'the battery is cooled without a command'}
# More ignored readings than this share are worth a warning.
MOST_IGNORED_SHARE = 0.05
# The reason of a reset is shown for this time.
RESET_SHOWN_S = 60.0
# Shorter delays are not reported [s].
ON_TIME_S = 5.0


def entry(part: str, level: bytes, message: str, values: Mapping[str, str] | None = None) -> DiagnosticStatus:
    """Return the DiagnosticStatus of a part of a node with figures by name; `diagnostics` names the node."""
    return DiagnosticStatus(name=part, level=level, message=message, values=[
        KeyValue(key=key, value=value) for key, value in (values or {}).items()])


def judged(part: str, errors: Iterable[str], warnings: Iterable[str], good: str,
           values: Mapping[str, str] | None = None) -> DiagnosticStatus:
    """Return the entry of a part: ERROR with any error, else WARN with any warning, else OK; '' is ignored."""
    errors, warnings = list(filter(None, errors)), list(filter(None, warnings))
    level = ERROR if errors else WARN if warnings else OK
    return entry(part, level, '; '.join([*errors, *warnings]) or good, values)


def diagnostics(node_name: str, hardware: str, now_ns: int,
                entries: Iterable[DiagnosticStatus]) -> DiagnosticArray:
    """Return the DiagnosticArray of a node's entries at an instant [ns], each named `NODE: part`."""
    message = DiagnosticArray(status=list(entries))
    message.header.stamp = time_message(now_ns)
    for status in message.status:
        status.name, status.hardware_id = f'{node_name.lstrip("/")}: {status.name}', hardware
    return message


def values_of(status: DiagnosticStatus) -> dict[str, str]:
    """Return the figures of an entry by name."""
    return {item.key: item.value for item in status.values}


# The planner

def planner_diagnostics(state: State, now_ns: int) -> list[DiagnosticStatus]:
    """Return the entries that follow from the planner's State: status, reason and the figures behind them."""
    estimate, chillers = state.estimate, {source.name for source in state.vehicle.heat_sources if source.cools}
    entries = [_preheating(state, now_ns), _signals(state, now_ns)]
    if estimate is not None:
        entries += [heater_entry(estimate.heater), _estimation(state, estimate, now_ns)]
    if state.answers.hvch.are_there:
        entries.append(_heater_status(state, state.answers.hvch, state.heater_refusal, 'heater status'))
    entries += [heater_entry(report, f'heat source {source}',
                             CHILLER_SENTENCES if source in chillers else SOURCE_SENTENCES)
                for source, report in state.source_reports.items()]
    refusals = {each.name: each.sentence for each in state.unserved}
    entries += [_heater_status(state, each, refusals.get(each.name, ''), f'status of {each.name}')
                for each in state.answers.others if each.are_there]
    return entries + _progress(state, now_ns)


def _preheating(state: State, now_ns: int) -> DiagnosticStatus:
    decision, mission = state.decision, state.active_mission
    values = {
        'vehicle': state.vehicle.name,
        'assumed of the vehicle': assumed_in_words(state.vehicle),
        'method': state.settings.method,
        'compiled core': core_in_words(),
        'declined by the core': declines_in_words(),
        'route_id': mission.route_id if mission else '',
        'propulsion power': mission.power_source if mission else '',
        'legs after this one': str(len(decision.later_legs)),
        'enabled': str(state.is_enabled).lower(),
    }
    if state.preparation_goal is not None:
        values['goal of prepare_battery'] = _preparation_goal_in_words(state.preparation_goal, now_ns)
    if state.latest_command is not None:
        values['command [W]'] = f'{state.latest_command.battery_heating_power_w:.0f}'
        for source in state.vehicle.heat_sources:
            values[f'command to {source.name} [W]'] = f'{state.latest_command.power_w(source.name):.0f}'
    if state.measurement is not None:
        battery = state.measurement.state
        values['battery temperature [degC]'] = f'{battery.temperature_c:.2f}'
        values['state of charge [1]'] = f'{battery.soc:.4f}'
        values['battery state age [s]'] = \
            f'{(now_ns - state.measurement.stamp_ns) * 1e-9:.2f}'
    if decision.plan is not None:
        plan = decision.plan
        if decision.target is not None:
            values['target [degC]'] = f'{plan.target_temperature_c:.2f}'
            values['target because'] = decision.target.reason
        values['predicted arrival temperature [degC]'] = f'{plan.arrival_temperature_c:.2f}'
        values['predicted arrival state of charge [1]'] = f'{plan.arrival_soc:.4f}'
        values['planning time [ms]'] = f'{plan.planning_time_s * 1e3:.3f}'
    level, text = LEVELS[decision.status.meaning.level], decision.explanation
    if state.inbox.unit_warnings:
        level = max(level, WARN)
        text += f' route_plan: {"; ".join(state.inbox.unit_warnings)}.'
    refused = state.inbox.refused_route
    if refused is not None:
        # The driver's latest trip is not planned, even if the previous one continues.
        level = ERROR
        text = text if refused in text else f'{text} {refused}'
    return entry('preheating', level, f'{decision.status.name}: {text}', values)


def _signals(state: State, now_ns: int) -> DiagnosticStatus:
    """Return the entry on regime and signals; WARN while a signal is in doubt."""
    regime, estimate, measurement = state.regime, state.estimate, state.measurement
    ignored_share = 0.0 if estimate is None else estimate.ignored_share
    values = {
        'regime': regime.regime.value,
        'regime since [s]': f'{(now_ns - regime.since_ns) / NS_PER_S:.0f}' if regime.since_ns else '',
        'regime evidence': regime.suspicion or regime.evidence,
        'ignored readings [%]': f'{100.0 * ignored_share:.1f}',
        'overtaken battery states': str(state.inbox.overtaken_states)}
    sentences = []
    for verdict in state.signal_verdicts:
        values[f'{verdict.signal} in doubt since [s]'] = f'{(now_ns - verdict.since_ns) / NS_PER_S:.0f}'
        sentences.append(verdict.sentence)
    if measurement is not None and measurement.cell_warning:
        sentences.append(measurement.cell_warning)
    if ignored_share > MOST_IGNORED_SHARE:
        sentences.append(f'{100.0 * ignored_share:.0f} % of the latest readings were ignored, because they are '
                         f'far from the expected state; at most {100.0 * MOST_IGNORED_SHARE:.0f} % are usual')
    if regime.suspicion:
        sentences.append(f'suspected: {regime.suspicion}')
    return judged('signals', [], sentences, f'{regime.regime.value}, all signals valid', values)


def _preparation_goal_in_words(preparation_goal: PreparationGoal, now_ns: int) -> str:
    when = ('as soon as possible' if preparation_goal.is_soonest else
            f'ready in {duration_text(max(0.0, (preparation_goal.ready_at_ns - now_ns) / NS_PER_S))}')
    return f'{when}, plugged in' if preparation_goal.is_plugged_in else when


def heater_sentence(report: HeaterReport, sentences: Mapping[Heater, str] = HEATER_SENTENCES) -> str:
    """Return a HeaterReport as text, with the sentence of its kind."""
    sentence = sentences[report.heater].format(share=100.0 * report.share)
    return f'{report.heater.value}: {sentence}'


def heater_entry(report: HeaterReport, part: str = 'heater',
                 sentences: Mapping[Heater, str] = HEATER_SENTENCES) -> DiagnosticStatus:
    """Return the entry on the response of a heat source, with a suspected fault."""
    sentence, suspected = heater_sentence(report, sentences), report.suspected
    values = {
        'heater': report.heater.value,
        'probability [1]': f'{report.probability:.3f}',
        'share of the command [1]': f'{report.share:.2f}',
        'suspected': '', 'suspected, probability [1]': '', 'suspected for [s]': '',
        'missing or uncommanded heat [K]': '', 'times as likely by the power [1]': ''}
    if suspected is not None:
        sentence = f'{sentence}; suspected: {suspected.heater.value}'
        values.update({
            'suspected': suspected.heater.value,
            'suspected, probability [1]': f'{suspected.probability:.3f}',
            'suspected for [s]': f'{suspected.lasts_s:.0f}',
            'missing or uncommanded heat [K]': f'{suspected.heat_k:.2f}',
            'times as likely by the power [1]': ('power is not known' if suspected.power_nats is None
                                                 else f'{math.exp(suspected.power_nats):.3g}')})
    return entry(part, HEATER_LEVELS[report.heater], sentence, values)


def _estimation(state: State, estimate: Estimate, now_ns: int) -> DiagnosticStatus:
    decision = state.decision
    values = {
        'battery temperature [degC]': f'{estimate.temperature_c:.2f}',
        'its standard deviation [K]': f'{estimate.temperature_deviation_k:.2f}',
        'state of charge [1]': f'{estimate.soc:.4f}',
        'arrival temperature standard deviation [K]': f'{decision.arrival_deviation_k:.2f}',
        'resolution of battery_state.temperature [K]': f'{estimate.temperature_resolution_k:g}',
        'heat under way [K]': f'{estimate.under_way_k:.2f}',
        'lag of the heat [s]': f'{estimate.heat_lag_s:.0f}',
        'lag of the temperature sensor [s]': f'{estimate.sensor_lag_s:.0f}',
        'offset of the temperature sensor [K]': f'{estimate.sensor_offset_k:.2f}',
        'resets': str(estimate.resets),
    }
    for factor, log, deviation in zip(
            FACTOR_NAMES, estimate.log_factors, estimate.factor_deviations):
        if factor != 'source_heat' or state.vehicle.heat_sources:
            values[f'{factor.replace("_", " ")} / vehicle file [1]'] = (
                f'{math.exp(log):.3f} +- {math.exp(log) * deviation:.3f}')
    has_reset = (estimate.reset_at_ns is not None
                 and 0 <= now_ns - estimate.reset_at_ns < RESET_SHOWN_S * NS_PER_S)
    stand = state.stand_report
    if stand is not None:
        values['temperature expected after standing [degC]'] = (
            f'{stand.standing.temperature_c:.2f} +- {stand.standing.deviation_k:.2f}')
    warning = f'reset: {estimate.reset_reason}' if has_reset else (
        '' if stand is None else stand.contradiction)
    return judged('estimation', [], [warning], f'{estimate.temperature_c:.2f} '
                  f'+- {estimate.temperature_deviation_k:.2f} degC', values)


def _heater_status(state: State, answers: HeaterAnswers, refusal: str, part: str) -> DiagnosticStatus:
    """Return the planner's entry on a status of a heat source: ERROR in doubt, WARN for a refusal or silence."""
    status, doubt = answers.status, answers.doubt
    values = {} if status is None else {
        'requested power [W]': f'{status.requested_w:.0f}', 'active power [W]': f'{status.active_w:.0f}',
        'measured power [W]': 'not measured' if status.measured_w is None else f'{status.measured_w:.0f}',
        'refusal': status.refusal.name, 'explanation': status.sentence}
    is_faulty = status is not None and status.refusal is Refusal.HEATER_FAULT
    warning = refusal or answers.silence(state.now_ns, state.settings) or answers.problem or (
        f'HEATER_FAULT: {values["explanation"]}' if is_faulty else '')
    return entry(part, ERROR if doubt else WARN if warning else OK, doubt or warning or 'the command is served',
                 values)


def _progress(state: State, now_ns: int) -> list[DiagnosticStatus]:
    """
    Return the entry on route_progress; [] before the first one.

    WARN if the latest was refused or is too old: the planner then continues by time. A trip that has ended needs
    no position.
    """
    timetable, refused = state.inbox.timetable, state.inbox.refused_progress
    warnings = [] if refused is None else [f'{refused}.']
    if timetable is None or timetable.latest is None:
        return [] if refused is None else [entry(
            'route progress', WARN, f'{refused}. The planner follows the stamp of route_plan.')]
    latest, delay_s, has_ended = timetable.latest, timetable.delay_ns / NS_PER_S, timetable.end is not None
    age_s, limit_s = (now_ns - latest.stamp_ns) / NS_PER_S, state.settings.route_progress_timeout_s
    if age_s > limit_s and not has_ended:
        warnings.append(f'The latest valid route_progress is {age_s:.3f} s old; at most {limit_s:g} s are '
                        'allowed: the planner continues by time from there.')
    good = 'The trip has ended.' if has_ended else _delay_in_words(delay_s)
    return [entry('route progress', WARN if warnings else OK, ' '.join(warnings) or good, {
        'distance [m]': f'{latest.distance_m:.0f}',
        'length of the route [m]': f'{timetable.planned.places.length_m:.0f}',
        'delay [s]': f'{delay_s:.1f}', 'age [s]': f'{age_s:.2f}',
        'has stood for [s]': f'{timetable.stood_ns / NS_PER_S:.0f}'})]


def _delay_in_words(delay_s: float) -> str:
    if abs(delay_s) < ON_TIME_S:
        return 'on time'
    return f'{duration_text(abs(delay_s))} {"late" if delay_s > 0.0 else "early"}'
