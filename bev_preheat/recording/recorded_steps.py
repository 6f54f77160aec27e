# SPDX-License-Identifier: Apache-2.0
"""
Steps of the planner as plain values for JSON.

A step is one call of `Supervisor.step`, `fail` or `stop`. Events that came as a ROS message are recorded by their
topic only: the message itself is in the recording just before the step.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any, TYPE_CHECKING

from bev_preheat.control.departures import clock_time, DailyPrice, GridPrices, PricePeriod, zone_of
from bev_preheat.control.events import (
    ActivationChanged,
    BATTERY_STATE,
    DeparturesSkipped,
    Event,
    HVCH_STATUS,
    PreheatingSwitched,
    PreparationEnded,
    PreparationWanted,
    Reconfigured,
    RivalsChanged,
    ROUTE_PLAN,
    ROUTE_PROGRESS,
    RouteUnreadable,
)
from bev_preheat.control.preparation_goal import PreparationEnding, PreparationGoal
from bev_preheat.errors import InvalidInput, quoted

if TYPE_CHECKING:
    from bev_preheat.control.decision import Command

# Topic of the planner's output.
COMMAND = 'hvch_command'
# The kinds of events whose message is recorded before the step; the kind is the topic, the source of the event.
MESSAGE_KINDS = frozenset((BATTERY_STATE, ROUTE_PLAN, ROUTE_PROGRESS, HVCH_STATUS))
WANTED, ENDED, RECONFIGURED, REFUSED_ROUTE = (
    'PreparationWanted', 'PreparationEnded', 'Reconfigured', 'RouteRefused')
# Events whose fields are plain values.
PLAIN_EVENTS: dict[str, Any] = {each.__name__: each for each in (
    ActivationChanged, PreheatingSwitched, RivalsChanged, DeparturesSkipped)}
STEP, FAIL, STOP = 'step', 'fail', 'stop'


@dataclass(frozen=True)
class RecordedStep:
    """
    One recorded call of the Supervisor at an instant [ns of the node's clock].

    `call` is STEP, FAIL or STOP, `events` are those of the step as plain values, and `what` is the sentence of
    FAIL. `command` is the answer, None: no command was published; `status` the number of the published
    decision's planning.status.Status, None: no decision.
    """

    now_ns: int
    call: str = STEP
    events: tuple[dict[str, Any], ...] = ()
    what: str = ''
    command: tuple[float, int, int] | None = None
    status: int | None = None

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as plain values."""
        return {'now_ns': self.now_ns, 'call': self.call, 'events': list(self.events), 'what': self.what,
                'command': None if self.command is None else list(self.command), 'status': self.status}

    @classmethod
    def from_dictionary(cls, values: Any) -> RecordedStep:
        """Return the step of plain values; raises InvalidInput, naming the field, if they are not a step's."""
        try:
            command = values['command']
            return cls(int(values['now_ns']), str(values['call']),
                       tuple(dict(event) for event in values['events']),
                       str(values['what']),
                       None if command is None else (float(command[0]), int(command[1]), int(command[2])),
                       None if values['status'] is None else int(values['status']))
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise InvalidInput(f'a step of the recording is damaged: {type(error).__name__}: {error}') from error


def command_values(command: Command | None) -> tuple[float, int, int] | None:
    """Return a Command as power [W], end of its lease [ns] and number of its reason; None for None."""
    return None if command is None else (
        command.battery_heating_power_w, command.valid_until_ns, int(command.reason))


@dataclass
class GoalNumbers:
    """Numbers of the PreparationGoals of a recording: a goal equals only itself."""

    numbers: dict[PreparationGoal, int] = field(default_factory=dict)

    def number(self, goal: PreparationGoal) -> int:
        """Return the number of a goal; a new one for a goal that was not there yet."""
        return self.numbers.setdefault(goal, len(self.numbers))

    def goal(self, number: int) -> PreparationGoal:
        """Return the goal of a number; raises InvalidInput if the recording has none."""
        for goal, known in self.numbers.items():
            if known == number:
                return goal
        raise InvalidInput(f'preparation goal {number} is not in the recording; its beginning is missing')


def event_values(event: Event, goals: GoalNumbers, has_message: bool) -> dict[str, Any]:
    """
    Return an event as plain values; `has_message`: its message is recorded before it.

    Parameters are those of the node, which the caller adds: an event carries only the values derived from them.
    """
    match event:
        case PreparationWanted(goal):
            plain = asdict(replace(goal, prices=None))
            return {'kind': WANTED, 'goal': goals.number(goal), **plain, 'prices': _price_values(goal.prices)}
        case PreparationEnded(goal, ending, explanation):
            return {'kind': ENDED, 'goal': None if goal is None else goals.number(goal), 'ending': int(ending),
                    'explanation': explanation}
        case Reconfigured():
            return {'kind': RECONFIGURED}
        case RouteUnreadable(error) if not has_message:
            return {'kind': REFUSED_ROUTE, 'problems': list(error.problems)}
    name = type(event).__name__
    if name in PLAIN_EVENTS:
        return {'kind': name, **asdict(event)}
    hint = getattr(event, 'hint', '')
    return {'kind': event.source, **({'hint': hint} if hint else {})}


def _price_values(prices: GridPrices | None) -> dict[str, Any] | None:
    """Return GridPrices as plain values, the time zone by its IANA name."""
    return None if prices is None else {
        'zone': str(prices.zone), 'daily': [(f'{each.clock:%H:%M}', each.price_per_kwh) for each in prices.daily],
        'dated': list(map(tuple, prices.dated)), 'currency': prices.currency}


def _prices_of(values: Any) -> GridPrices | None:
    return None if values is None else GridPrices(
        zone_of(values['zone']), tuple(DailyPrice(clock_time(clock), price) for clock, price in values['daily']),
        tuple(PricePeriod(*period) for period in values['dated']), values['currency'])


def event_of(values: dict[str, Any], goals: GoalNumbers) -> Event:
    """
    Return the event of plain values that came without a message.

    Raises InvalidInput, naming the kind, if the values are not an event's.
    """
    kind = values.get('kind')
    fields = {name: value for name, value in values.items() if name not in ('kind', 'goal')}
    try:
        if kind in PLAIN_EVENTS:
            event: Event = PLAIN_EVENTS[kind](**fields)
            return event
        if kind == WANTED:
            goal = PreparationGoal(**{**fields, 'prices': _prices_of(fields.get('prices'))})
            goals.numbers[goal] = int(values['goal'])
            return PreparationWanted(goal)
        if kind == ENDED:
            number = values['goal']
            return PreparationEnded(None if number is None else goals.goal(number),
                                    PreparationEnding(values['ending']), str(values['explanation']))
        if kind == REFUSED_ROUTE:
            return RouteUnreadable(InvalidInput([str(problem) for problem in values['problems']]))
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidInput(f'event {quoted(str(kind))} of the recording is damaged: {type(error).__name__}: '
                           f'{error}') from error
    raise InvalidInput(f'event {quoted(str(kind))} of the recording is not known to this version')
