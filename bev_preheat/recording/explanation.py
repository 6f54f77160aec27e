# SPDX-License-Identifier: Apache-2.0
"""Why the planner gave a command at an instant: inputs, estimate, goal, and the limits that bound it."""

from __future__ import annotations

import math
from typing import NamedTuple

from bev_preheat.control.state import State
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.diagnostics import planner_diagnostics
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.status import Status
from bev_preheat.recording.flight import Flight, no_step_words
from bev_preheat.recording.replay import Player

Rows = list[tuple[str, str]]


class Why(NamedTuple):
    """The instant [ns], the command and its reason as a sentence; names and values that explain it, by heading."""

    now_ns: int
    answer: str
    sections: dict[str, Rows]


def explain(flight: Flight, at_ns: int) -> Why:
    """Return Why the planner gave its command at an instant [ns]; raises InvalidInput beyond the recording."""
    first_ns, last_ns = flight.start_ns, flight.given[-1].step.now_ns
    if not first_ns <= at_ns <= last_ns:
        raise InvalidInput(f'--explain: {no_step_words(flight, at_ns)}')
    flight = flight.from_instant(at_ns)
    player, latest = Player(flight), flight.given[0]
    for given in flight.given:
        if given.step.now_ns > at_ns:
            break
        player.play(given)
        latest = given
    return why(player.state, latest.step.now_ns)


def why(state: State, now_ns: int) -> Why:
    """Return Why a planner in this state gave its latest command, seen from an instant [ns]."""
    command, decision = state.latest_command, state.decision
    power = 'no command' if command is None else ', '.join((
        f'{command.battery_heating_power_w:.0f} W',
        *(f'{name} {power_w:.0f} W' for name, power_w in command.sources_w)))
    answer = f'{power}, {decision.status.name}: {decision.explanation}'
    sections = {'inputs': _inputs(state, now_ns)}
    for entry in planner_diagnostics(state, now_ns):
        sections[entry.name] = [(value.key, value.value) for value in entry.values if value.value]
    if decision.plan is not None:
        sections['plan'] = _plan(decision.plan, state, now_ns)
    sections['what would have to change'] = _otherwise(state, now_ns)
    return Why(now_ns, answer, sections)


def _inputs(state: State, now_ns: int) -> Rows:
    rows = []
    measurement, mission, timetable = state.measurement, state.mission, state.inbox.timetable
    if measurement is None:
        rows.append(('battery_state', 'none yet'))
    else:
        power_w = measurement.power_w
        rows.append(('battery_state', f'{measurement.state.temperature_c:.2f} degC, {measurement.state.soc:.4f}, '
                     f'{"power unknown" if power_w is None else f"{power_w:.0f} W"}, '
                     f'{(now_ns - measurement.stamp_ns) / NS_PER_S:.2f} s old'))
    if mission is None:
        rows.append(('route_plan', 'none'))
    else:
        started_s = max(now_ns - mission.start_ns, 0) / NS_PER_S
        rows.append(('route_plan', f'{mission.route_id or "without identification"}, started '
                     f'{duration_text(started_s)} ago, {len(mission.legs)} leg(s)'))
    if timetable is not None and (latest := timetable.latest) is not None:
        rows.append(('route_progress', f'{latest.distance_m:.0f} m of {timetable.planned.places.length_m:.0f} m, '
                     f'{(now_ns - latest.stamp_ns) / NS_PER_S:.2f} s old'))
    for name, refused in (('refused route_plan', state.inbox.refused_route),
                          ('refused route_progress', state.inbox.refused_progress)):
        if refused is not None:
            rows.append((name, refused))
    if state.inbox.rivals:
        rows.append(('other nodes that command heat', state.inbox.rivals))
    return rows


def _plan(plan: Plan, state: State, now_ns: int) -> Rows:
    most_c = plan.maximum_arrival_temperature_c
    at_most = '' if math.isinf(most_c) else f' … {most_c:.2f}'
    rows = [('target [degC]', f'{plan.target_temperature_c:.2f}{at_most}'),
            ('predicted on arrival [degC]',
             f'{plan.arrival_temperature_c:.2f} +- {state.decision.arrival_deviation_k:.2f}'),
            ('charge on arrival [1]', f'{plan.arrival_soc:.4f}')]
    for what, start_s in ('heating', plan.heating_start_s), ('cooling', plan.cooling_start_s):
        begins_s = _from_now_s(state, now_ns, start_s)
        if begins_s is not None:
            rows.append((f'{what} begins', 'now' if begins_s <= 0.0 else f'in {duration_text(begins_s)}'))
    return rows


def _from_now_s(state: State, now_ns: int, start_s: float | None) -> float | None:
    return None if start_s is None else (state.decision.plan_start_ns - now_ns) / NS_PER_S + start_s


def _otherwise(state: State, now_ns: int) -> Rows:
    decision = state.decision
    begins_s = None if decision.plan is None else _from_now_s(state, now_ns, decision.plan.heating_start_s)
    otherwise = decision.status.meaning.otherwise
    sentences = [('for another answer', otherwise)] if otherwise else []
    if decision.status is Status.WAITING and begins_s is not None:
        sentences.append(('for another answer', f'The heater starts by itself in {duration_text(begins_s)}; a '
                          'colder battery, an earlier arrival or a higher target would start it sooner.'))
    elif decision.status is Status.HEATING:
        sentences.append(('for another answer', 'The heater stops when the target is certain on arrival, or when '
                          'a signal, the route or the driver says so.'))
    elif decision.status is Status.NOT_NEEDED:
        sentences.append(('for another answer', 'A higher target or a colder battery would need heat.'))
    for verdict in state.signal_verdicts:
        sentences.append((f'{verdict.signal} in doubt', verdict.sentence))
    return sentences
