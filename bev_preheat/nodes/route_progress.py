# SPDX-License-Identifier: Apache-2.0
"""The vehicle's position on the route: the message, and its entry in the diagnostics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from bev_preheat.control.events import ProgressArrived, ProgressUnreadable
from bev_preheat.control.inputs import Progress
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.nodes.convert import LONGEST_ROUTE_ID, nanoseconds, stamp_problems, time_message
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat_msgs.msg import RouteProgress

if TYPE_CHECKING:
    from bev_preheat.control.planner_state import PlannerState

# Shorter delays are not reported [s].
ON_TIME_S = 5.0


def progress_from_message(message: RouteProgress) -> Progress:
    """Return the Progress of a RouteProgress; raise InvalidInput, with one problem per field."""
    problems = []
    if message.distance == 0.0 and not message.has_distance:
        problems.append('distance: 0 counts as not given where has_distance is false; set it for a '
                        'vehicle that has not left the start')
    if len(message.route_id) > LONGEST_ROUTE_ID:
        problems.append(f'route_id: {quoted(message.route_id)} is too long; it must have at most '
                        f'{LONGEST_ROUTE_ID} characters')
    problems += stamp_problems(message.header.stamp)
    if problems:
        raise InvalidInput(problems)
    return Progress(message.distance, nanoseconds(message.header.stamp), message.route_id,
                    nanoseconds(message.route_stamp) or None)


def progress_event(message: RouteProgress,
                   hint: str = '') -> ProgressArrived | ProgressUnreadable:
    """Return the event of a RouteProgress; `hint` is added to a refusal."""
    try:
        return ProgressArrived(progress_from_message(message), hint)
    except InvalidInput as error:
        return ProgressUnreadable(InvalidInput([*error.problems, hint]) if hint else error)


def progress_message(progress: Progress) -> RouteProgress:
    """Return the RouteProgress of a Progress."""
    message = RouteProgress(route_id=progress.route_id, distance=progress.distance_m,
                            has_distance=True,
                            route_stamp=time_message(progress.route_start_ns or 0))
    message.header.stamp = time_message(progress.stamp_ns)
    return message


def progress_diagnostics(name: str, state: PlannerState, now_ns: int) -> DiagnosticStatus | None:
    """
    Return the DiagnosticStatus `NODE: route progress`; None before the first route_progress.

    WARN if the latest was refused or is too old: the planner then continues by time. A trip that has ended needs
    no position.
    """
    place, refused = state.place, state.refused_progress
    if refused is None and place is None:
        return None
    values = {}
    sentences = [] if refused is None else [f'{refused}.']
    is_late = False
    if place is not None:
        age_s, limit_s = (now_ns - place.latest.stamp_ns) / NS_PER_S, state.settings.route_progress_timeout_s
        delay_s = place.delay_ns / NS_PER_S
        values = {'distance [m]': f'{place.latest.distance_m:.0f}',
                  'length of the route [m]': f'{place.length_m:.0f}',
                  'delay [s]': f'{delay_s:.1f}', 'age [s]': f'{age_s:.2f}',
                  'has stood for [s]': f'{place.stood_ns / NS_PER_S:.0f}'}
        is_late = age_s > limit_s and not place.has_ended
        if place.has_ended and refused is None:
            sentences.append('The trip has ended.')
        elif is_late:
            sentences.append(f'The latest valid route_progress is {age_s:.3f} s old; at most '
                             f'{limit_s:g} s are allowed: the planner continues by time from there.')
        elif refused is None:
            sentences.append(_delay_in_words(delay_s))
    elif refused is not None:
        sentences.append('The planner follows the stamp of route_plan.')
    is_warning = refused is not None or is_late
    return DiagnosticStatus(
        name=f'{name}: route progress', hardware_id=state.vehicle.name,
        level=DiagnosticStatus.WARN if is_warning else DiagnosticStatus.OK,
        message=' '.join(sentences),
        values=[KeyValue(key=key, value=value) for key, value in values.items()])


def _delay_in_words(delay_s: float) -> str:
    if abs(delay_s) < ON_TIME_S:
        return 'on time'
    return f'{duration_text(abs(delay_s))} {"late" if delay_s > 0.0 else "early"}'
