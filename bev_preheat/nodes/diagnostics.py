# SPDX-License-Identifier: Apache-2.0
"""The planner's entries in /diagnostics: preheating, signals, heater, estimation, route progress, state file."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from bev_preheat.control.departure_source import DepartureState
from bev_preheat.control.sensitivity_watch import SENSITIVITY
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.estimation.state import FACTOR_NAMES
from bev_preheat.native.library import core_in_words, DECLINES
from bev_preheat.nodes.convert import time_message
from bev_preheat.nodes.heater_messages import heater_answer_entry
from bev_preheat.nodes.route_progress import progress_diagnostics
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.status import Level
from bev_preheat.vehicle.assumptions import assumed_in_words

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bev_preheat.control.planner_state import PlannerState
    from bev_preheat.control.preparation_goal import PreparationGoal
    from bev_preheat.estimation.estimate import Estimate
    from bev_preheat.estimation.hypotheses import HeaterReport
    from bev_preheat.nodes.departure_keeper import DepartureFiles
    from bev_preheat.nodes.state_keeper import StateFileReport

LEVELS = {Level.OK: DiagnosticStatus.OK, Level.WARN: DiagnosticStatus.WARN, Level.ERROR: DiagnosticStatus.ERROR}
HEATER_LEVELS = {
    Heater.ANSWERS: DiagnosticStatus.OK,
    Heater.DERATED: DiagnosticStatus.WARN,
    Heater.DEAD: DiagnosticStatus.ERROR,
    Heater.STUCK_ON: DiagnosticStatus.ERROR,
}
HEATER_SENTENCES = {
    Heater.ANSWERS: 'responds normally',
    Heater.DERATED: 'it gives only {share:.0f} % of the commanded power; planned accordingly',
    Heater.DEAD: 'the battery does not get the commanded heat; it is still commanded',
    Heater.STUCK_ON: 'the battery is heated without a command',
}
# More ignored readings than this share are worth a warning.
MOST_IGNORED_SHARE = 0.05
# The reason of a reset is shown for this time.
RESET_SHOWN_S = 60.0
# A departure that is held off is worth a warning this close to it [s].
HELD_OFF_TOLD_S = 7200.0


def planner_diagnostics(node_name: str, state: PlannerState, now_ns: int,
                        memory: StateFileReport | None = None,
                        departures: DepartureFiles | None = None, sensitivity: str = '') -> DiagnosticArray:
    """
    Return the DiagnosticArray with status, reason and the figures behind them.

    `memory` is a state_keeper.StateFileReport, None without a state file; `departures` a
    departure_keeper.DepartureFiles, None without a file of departures. `sensitivity` are the sentences of a
    control.sensitivity_watch.SensitivityWatch, '' for none.
    """
    name, hardware = node_name.lstrip('/'), state.vehicle.name
    message = DiagnosticArray(status=[_preheating(name, hardware, state, now_ns, sensitivity),
                                      _signals(name, hardware, state, now_ns)])
    estimate = state.estimate
    if estimate is not None:
        message.status.append(heater_entry(name, hardware, estimate.heater))
        message.status.append(_estimation(name, hardware, state, estimate, now_ns))
    if state.heater_answer is not None:
        message.status.append(heater_answer_entry(name, hardware, state.heater_answer))
    progress = progress_diagnostics(name, state, now_ns)
    if progress is not None:
        message.status.append(progress)
    if memory is not None:
        message.status.append(_state_file(name, hardware, memory))
    if departures is not None:
        message.status.append(_departures(name, hardware, departures, now_ns))
    message.header.stamp = time_message(now_ns)
    return message


def _preheating(name: str, hardware: str, state: PlannerState, now_ns: int,
                sensitivity: str) -> DiagnosticStatus:
    decision, mission = state.decision, state.active_mission
    values = {
        'vehicle': state.vehicle.name,
        'assumed of the vehicle': assumed_in_words(state.vehicle),
        'method': state.settings.method,
        'compiled core': core_in_words(),
        'declined by the core': DECLINES.in_words(),
        'route_id': mission.route_id if mission else '',
        'propulsion power': mission.power_source if mission else '',
        'legs after this one': str(len(decision.later_legs)),
        'enabled': str(state.is_enabled).lower(),
    }
    if state.preparation_goal is not None:
        values['goal of prepare_battery'] = _preparation_goal_in_words(state.preparation_goal, now_ns)
    if state.latest_command is not None:
        values['command [W]'] = f'{state.latest_command.battery_heating_power_w:.0f}'
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
    if sensitivity:
        values[SENSITIVITY] = sensitivity
    level, text = LEVELS[decision.status.meaning.level], decision.explanation
    if state.unit_warnings:
        level = max(level, DiagnosticStatus.WARN)
        text += f' route_plan: {"; ".join(state.unit_warnings)}.'
    refused = state.refused_route
    if refused is not None:
        # The driver's latest trip is not planned, even if the previous one continues.
        level = DiagnosticStatus.ERROR
        text = text if refused in text else f'{text} {refused}'
    return _entry(f'{name}: preheating', hardware, level, f'{decision.status.name}: {text}', values)


def _signals(name: str, hardware: str, state: PlannerState, now_ns: int) -> DiagnosticStatus:
    """Return the entry on regime and signals; WARN while a signal is in doubt."""
    regime, estimate, measurement = state.regime, state.estimate, state.measurement
    ignored_share = 0.0 if estimate is None else estimate.ignored_share
    values = {
        'regime': regime.regime.value,
        'regime since [s]': f'{(now_ns - regime.since_ns) / NS_PER_S:.0f}' if regime.since_ns else '',
        'regime evidence': regime.suspicion or regime.evidence,
        'ignored readings [%]': f'{100.0 * ignored_share:.1f}',
        'overtaken battery states': str(state.overtaken_states)}
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
    return _entry(f'{name}: signals', hardware, DiagnosticStatus.WARN if sentences else DiagnosticStatus.OK,
                  '; '.join(sentences) or f'{regime.regime.value}, all signals valid', values)


def _preparation_goal_in_words(preparation_goal: PreparationGoal, now_ns: int) -> str:
    when = ('as soon as possible' if preparation_goal.is_soonest else
            f'ready in {duration_text(max(0.0, (preparation_goal.ready_at_ns - now_ns) / NS_PER_S))}')
    return f'{when}, plugged in' if preparation_goal.is_plugged_in else when


def heater_sentence(report: HeaterReport) -> str:
    """Return a HeaterReport in words."""
    sentence = HEATER_SENTENCES[report.heater].format(share=100.0 * report.share)
    return f'{report.heater.value}: {sentence}'


def heater_entry(name: str, hardware: str, report: HeaterReport) -> DiagnosticStatus:
    """Return the entry on the heater's response, with a suspected fault."""
    sentence, suspected = heater_sentence(report), report.suspected
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
    return _entry(f'{name}: heater', hardware, HEATER_LEVELS[report.heater], sentence, values)


def _estimation(name: str, hardware: str, state: PlannerState, estimate: Estimate,
                now_ns: int) -> DiagnosticStatus:
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
    return _entry(f'{name}: estimation', hardware,
                  DiagnosticStatus.WARN if warning else DiagnosticStatus.OK,
                  warning or f'{estimate.temperature_c:.2f} '
                  f'+- {estimate.temperature_deviation_k:.2f} degC',
                  values)


def _departures(name: str, hardware: str, files: DepartureFiles, now_ns: int) -> DiagnosticStatus:
    report = files.report
    left_s = math.inf if report.next_ns is None else (report.next_ns - now_ns) / NS_PER_S
    sentence = f'{report.state.value}: {report.reason}'
    if report.next_ns is not None:
        sentence = f'{report.next_words}, in {duration_text(left_s)}: {sentence}'
    is_late = report.state is DepartureState.HELD_OFF and left_s < HELD_OFF_TOLD_S
    level = (DiagnosticStatus.ERROR if files.problem and report.next_ns is None else
             DiagnosticStatus.WARN if files.problem or is_late else DiagnosticStatus.OK)
    values = {
        'next departure': report.next_words,
        'next departure [s since 1970]': '' if report.next_ns is None else str(report.next_ns // NS_PER_S),
        'next departure in [s]': '' if report.next_ns is None else f'{left_s:.0f}',
        'target [degC]': ('' if report.next_ns is None else
                          "the planner's default" if report.target_c is None else f'{report.target_c:g}'),
        'plugged in': str(report.plugged_in).lower(),
        'state': report.state.value,
        'reason': report.reason,
        'skipped': report.skipped_words,
        'latest departure': report.latest,
        'departures': files.departures_path,
        'grid_prices': files.prices_path}
    return _entry(f'{name}: departures', hardware, level,
                  f'{sentence}; {files.problem}' if files.problem else sentence, values)


def _state_file(name: str, hardware: str, memory: StateFileReport) -> DiagnosticStatus:
    written = ('nothing written yet' if memory.written_s_ago is None
               else f'written {memory.written_s_ago:.0f} s ago')
    return _entry(f'{name}: state file', hardware,
                  DiagnosticStatus.ERROR if memory.is_foreign else
                  DiagnosticStatus.WARN if memory.problem else DiagnosticStatus.OK,
                  memory.problem or written,
                  {'file': memory.path, 'last write': written,
                   'damaged file kept as': memory.kept_aside})


def _entry(name: str, hardware: str, level: bytes, message: str,
           values: Mapping[str, str]) -> DiagnosticStatus:
    return DiagnosticStatus(
        name=name, hardware_id=hardware, level=level, message=message,
        values=[KeyValue(key=key, value=value) for key, value in values.items()])
