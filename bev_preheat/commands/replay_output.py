# SPDX-License-Identifier: Apache-2.0
"""Printed and written results of `preheat replay`."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.commands.terminal import print_figures, ResultConsole
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.recording.comparison import cause_of
from bev_preheat.recording.course import Course, lapses_in_words, what_if_sentence
from bev_preheat.recording.flight import Flight, FLIGHT_RECORDER, moment
from bev_preheat.vehicle.description import HVCH

if TYPE_CHECKING:
    from bev_preheat.monitoring.pages import ReportText
    from bev_preheat.recording.changes import Changes
    from bev_preheat.recording.history import History
    from bev_preheat.recording.replay import Replayed

# The longest spans without a command are listed.
LISTED_SPANS = 10


class Result(NamedTuple):
    """A replayed Flight, and the Course with Changes (None: without changes)."""

    flight: Flight
    replayed: Replayed
    changes: Changes
    changed: Course | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the drives."""
        if self.changed is None:
            return ('recorded',)
        return 'recorded', 'planner' if self.changes.is_nothing else 'changed'

    @property
    def courses(self) -> tuple[Course, ...]:
        """The Course as it was, and the changed one."""
        return (self.replayed.course,) if self.changed is None else (self.replayed.course, self.changed)

    @property
    def is_good(self) -> bool | None:
        """Whether the commands are reproduced; None if there is nothing to reproduce."""
        comparison = self.replayed.comparison
        return comparison.is_reproduced and comparison.commands > 0 if self.flight.has_commands else None

    @property
    def remarks(self) -> list[str]:
        """Sentences on gaps in the recording, unusual inputs, and the weak heater of a changed drive."""
        heater = self.replayed.heater
        told = [] if heater is None or self.changed is None else [heater.sentence]
        return [*self.flight.remarks, *self.replayed.remarks, *filter(None, told)]

    def verdict(self) -> list[str]:
        """Return the sentences on the outcome."""
        sentences = [reproduction(self.flight, self.replayed)] if self.flight.has_commands else []
        comparison = self.replayed.comparison
        if comparison.first is not None:
            sentences.append(f'cause: {cause_of(self.flight, comparison.first)}')
        if self.changed is not None and not self.changes.is_nothing:
            sentences.append(what_if_sentence(self.changes, self.replayed.course, self.changed))
        return sentences


def reproduction(flight: Flight, replayed: Replayed) -> str:
    """Return whether the recorded commands are reproduced, as a sentence."""
    comparison, first = replayed.comparison, replayed.comparison.first
    if comparison.commands == 0:
        return 'the recording has no command'
    if first is None:
        how = 'each to the last digit' if flight.power_tolerance_w == 0.0 else (
            f'each within {flight.power_tolerance_w:g} W, the largest difference {comparison.largest_w:.2f} W')
        return f'reproduced: {comparison.commands} commands, {how}'
    return (f'not reproduced: {comparison.different} of {comparison.commands} commands differ, by at most '
            f'{comparison.largest_w:.1f} W; the first at {moment(first.now_ns)}: recorded {first.recorded}, '
            f'replayed {first.replayed}')


def as_dictionary(result: Result) -> dict[str, Any]:
    """Return a Result for JSON."""
    comparison, flight = result.replayed.comparison, result.flight
    first = comparison.first
    return {
        'source': flight.source, 'reproduced': result.is_good, 'commands': comparison.commands,
        'different': comparison.different, 'largest_difference_w': comparison.largest_w,
        'first_difference': None if first is None else {**first._asdict(), 'cause': cause_of(flight, first)},
        'remarks': result.remarks, 'verdict': result.verdict(),
        'recorded': result.replayed.course.as_dictionary(),
        'changed': None if result.changed is None else result.changed.as_dictionary()}


def figure_rows(courses: tuple[Course, ...]) -> list[list[str]]:
    """Return the figures of Courses side by side: a name, and a value for each."""
    start_ns = courses[0].instants[0].now_ns

    def after(now_ns: int) -> str:
        return duration_text((now_ns - start_ns) / NS_PER_S)

    names = list(dict.fromkeys(name for course in courses for name in course.results.accounts))
    energies = [f'{"HVCH" if name == HVCH else name} {what} [Wh]'
                for name in names for what in ('commanded', 'delivered')]
    begun = {'heating begins after': [course.heating for course in courses],
             'cooling begins after': [course.cooling for course in courses]}
    if not any(begun['cooling begins after']):
        del begun['cooling begins after']
    titles = ['begins', 'length', *begun, 'switch-ons', *energies, 'without a valid command',
              'arrival after', 'arrival temp. [degC]', 'last prediction [degC]', 'last status']
    columns = [(
        moment(course.instants[0].now_ns), after(course.instants[-1].now_ns),
        *(after(periods[at][0][0]) if periods[at] else 'never' for periods in begun.values()),
        str(sum(len(periods[at]) for periods in begun.values())),
        *(_energy_text(energy_wh) for name in names for account in [course.results.accounts[name]]
          for energy_wh in (account.commanded_wh, account.delivered_wh)),
        lapses_in_words(course.results.account.without_command) or 'never',
        'not in the recording' if course.arrival is None else after(course.arrival.now_ns), _arrival_text(course),
        'none' if course.latest_prediction is None else f'{course.latest_prediction.predicted_c:.2f}',
        course.said[-1].status.name if course.said else '') for at, course in enumerate(courses)]
    return [[name, *values] for name, *values in zip(titles, *columns)]


def _energy_text(energy_wh: float | None) -> str:
    return 'not recorded' if energy_wh is None else f'{energy_wh:.1f}'


def result_sentences(course: Course) -> list[str]:
    """Return the result of each trip, and the spans without a valid command, as text."""
    told = [sentence for trip in course.results.trips for sentence in trip.sentences()]
    spans = course.results.account.without_command
    # In order of time again.
    listed = sorted(sorted(spans, key=lambda span: -span.length_s)[:LISTED_SPANS])
    told += [f'without a valid command: {moment(span.from_ns)} for {span.length_s:.1f} s' for span in listed]
    if len(spans) > len(listed):
        told.append(f'without a valid command: {len(spans) - len(listed)} shorter spans')
    return told


def _arrival_text(course: Course) -> str:
    arrival = course.arrival
    return ('not in the recording' if arrival is None or math.isnan(arrival.measured_c)
            else f'{arrival.measured_c:.2f}')


def print_result(console: ResultConsole, result: Result) -> None:
    """Print a Result."""
    console.say(*(f'note: {remark}' for remark in result.remarks))
    print_figures(console, None, ['', *result.names], figure_rows(result.courses))
    console.say(*result_sentences(result.replayed.course), *result.verdict())


def report_words(result: Result, histories: tuple[History, ...]) -> ReportText:
    """Return the words of the report."""
    from bev_preheat.monitoring.pages import ReportText
    flight, beginning = result.flight, result.flight.beginning
    start_ns = result.replayed.course.instants[0].now_ns
    remarks = result.remarks
    remarks += [f'the clock jumped {history.jumps} time(s); the curves go on with the time before the jump'
                for history in histories[:1] if history.jumps]
    remarks += [f'{history.lost} changes of sentences and diagnostics are not listed' for history in histories
                if history.lost]
    setup = [('recording', ', '.join(map(str, flight.paths))), ('kind', flight.source)]
    if flight.source == FLIGHT_RECORDER:
        setup += [('version', beginning.version), ('node', beginning.node)]
    setup += [(name, str(value)) for name, value in sorted(beginning.parameters.items())]
    verdict = [*result_sentences(result.replayed.course), *result.verdict()] or (
        ['The log has no commands to reproduce; the planner stands beside the log.']
        if flight.is_log else ['The recording has no commands to reproduce.'])
    return ReportText(
        f'{beginning.node.strip("/") or "planner"}: drive of {moment(start_ns)}', tuple(verdict), result.is_good,
        result.names, tuple(tuple(row) for row in figure_rows(result.courses)), tuple(remarks), tuple(setup),
        tuple((span.from_ns / NS_PER_S, span.to_ns / NS_PER_S)
              for span in result.replayed.course.results.account.without_command))
