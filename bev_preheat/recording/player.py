# SPDX-License-Identifier: Apache-2.0
"""A planner's step under the recorded inputs, as they were or with changes of vehicle, method or signals."""

from __future__ import annotations

from dataclasses import dataclass, field
import math
import re
from typing import Any, NamedTuple, TYPE_CHECKING

import yaml

from bev_preheat.control.events import BATTERY_STATE, HVCH_STATUS, Reconfigured, ROUTE_PLAN
from bev_preheat.control.settings import FIELD_OF_PARAMETER, settings_of
from bev_preheat.control.state_bytes import state_of
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.messages.inputs import INPUTS, Reader, RouteIntake
from bev_preheat.recording.records import (
    event_of,
    FAIL,
    GoalNumbers,
    learned_of,
    MESSAGE_KINDS,
    read_message,
    RECONFIGURED,
    STOP,
)
from bev_preheat.vehicle import vehicle_contents
from bev_preheat.vehicle.loading import vehicle_of_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from bev_preheat.control.events import Event
    from bev_preheat.control.settings import Settings
    from bev_preheat.control.state import State
    from bev_preheat.control.supervisor import StepOutput
    from bev_preheat.estimation.prior import Learned
    from bev_preheat.recording.flight import Flight, Given, Start
    from bev_preheat.vehicle.description import Vehicle

# Fields of battery_state and of route_plan, by the names of the command line.
BATTERY_FIELDS = {'temperature': 'temperature', 'soc': 'percentage', 'voltage': 'voltage', 'current': 'current'}
ROUTE_FIELDS = {'ambient_temperature': 'ambient_temperature', 'propulsion_power': 'propulsion_power',
                'target': 'target_battery_temperature'}
# Without these values the planner still plans.
MAY_BE_MISSING = frozenset(('voltage', 'current'))
SIGNALS = (*BATTERY_FIELDS, *ROUTE_FIELDS)
# Units, of differences too, and limits of a value that replaces the recorded one.
UNITS = {'temperature': ('degC', 'K', (-60.0, 80.0)), 'soc': ('', '', (0.0, 1.0)),
         'voltage': ('V', 'V', (1.0, 1500.0)), 'current': ('A', 'A', (-3000.0, 3000.0)),
         'ambient_temperature': ('degC', 'K', (-60.0, 60.0)), 'propulsion_power': ('W', 'W', (-1e6, 1e6)),
         'target': ('degC', 'K', (-40.0, 60.0))}
# Other names of signals.
ALIASES = {'battery_temperature': 'temperature', 'temp': 'temperature', 'percentage': 'soc',
           'state_of_charge': 'soc', 'charge': 'soc', 'ambient': 'ambient_temperature',
           'outside_temperature': 'ambient_temperature', 'power': 'propulsion_power',
           'target_temperature': 'target'}
VALUE = re.compile(r'(?P<sign>[+*=-]?)(?P<number>[0-9.eE+-]+)')
MISSING = 'none'


class SignalChange(NamedTuple):
    """
    A signal of SIGNALS: its recorded value times `factor` plus `offset`; NaN: the signal is missing.

    A `factor` of 0 puts `offset` in place of the recorded value, but not of a missing one.
    """

    signal: str
    factor: float
    offset: float

    def of(self, value: float) -> float:
        """Return the changed value."""
        return value * self.factor + self.offset

    def in_words(self) -> str:
        """Return it as text."""
        if math.isnan(self.factor):
            return f'{self.signal} missing'
        unit, difference, _ = UNITS[self.signal]
        if self.factor == 0.0:
            return f'{self.signal} {self.offset:g} {unit}'.rstrip()
        if self.factor != 1.0 or self.offset == 0.0:
            return f'{self.signal} * {self.factor:g}'
        return f'{self.signal} {"+" if self.offset > 0.0 else "-"} {abs(self.offset):g} {difference}'.rstrip()

    def alter_battery(self, message: Any) -> None:
        """Change a BatteryState message, if it has the signal."""
        field = BATTERY_FIELDS.get(self.signal)
        if field is not None:
            setattr(message, field, self.of(getattr(message, field)))
            if self.signal == 'temperature' and len(message.cell_temperature):
                message.cell_temperature = [self.of(cell_c) for cell_c in message.cell_temperature]

    def alter_route(self, message: Any) -> None:
        """Change a RoutePlan message, if it has the signal."""
        field = ROUTE_FIELDS.get(self.signal)
        if self.signal == 'target':
            # A target that the route does not name is the planner's own, which only another value replaces.
            message.has_target_battery_temperature |= self.factor == 0.0
            if message.has_target_battery_temperature:
                message.target_battery_temperature = self.of(message.target_battery_temperature)
        elif field is not None:
            setattr(message, field, [self.of(value) for value in getattr(message, field)])


def signal_change(signal: str, text: str) -> SignalChange:
    """
    Return the SignalChange of `20` or `=20`, `+2`, `-0.05`, `*1.1` or `none`.

    Raises InvalidInput, naming signal, unit and allowed values, for anything else.
    """
    unit, difference, (low, high) = UNITS[signal]
    if text == MISSING and signal in MAY_BE_MISSING:
        return SignalChange(signal, math.nan, math.nan)
    found = VALUE.fullmatch(text)
    try:
        number = math.nan if found is None else float(found['number'])
    except ValueError:
        number = math.nan
    is_value = found is not None and found['sign'] in ('', '=')
    if found is None or not math.isfinite(number) or (is_value and not low <= number <= high):
        told = [f'{low:g} ... {high:g}{f" {unit}" if unit else " (a share)"}, with = before a negative one',
                f'+NUMBER or -NUMBER{f" [{difference}]" if difference else ""}', '*NUMBER',
                *([MISSING] if signal in MAY_BE_MISSING else [])]
        raise InvalidInput(
            f'{signal}: {quoted(text)} is not allowed; it must be {", ".join(told[:-1])}, or {told[-1]}')
    if is_value:
        return SignalChange(signal, 0.0, number)
    if found['sign'] == '*':
        return SignalChange(signal, number, 0.0)
    return SignalChange(signal, 1.0, number if found['sign'] == '+' else -number)


def with_keys(text: str, values: Mapping[str, Any]) -> str:
    """
    Return the text of a vehicle file with other values, such as {'hvch.maximum_power_w': 5000.0}.

    Keys need not be in the file; the schema of vehicle files decides whether they are allowed.
    """
    if not values:
        return text
    contents = yaml.safe_load(text)
    for key, value in values.items():
        *above, last = key.split('.')
        node = contents
        for name in above:
            if not isinstance(node.get(name), dict):
                node[name] = {}
            node = node[name]
        node[last] = value
    return str(yaml.safe_dump(contents, sort_keys=False))


def keys_of_text(text: str) -> list[str]:
    """Return the dotted keys of the single values of a vehicle file."""
    return list(_keys(yaml.safe_load(text)))


def _keys(node: dict[str, Any], above: str = '') -> Iterator[str]:
    for name, item in node.items():
        if isinstance(item, dict):
            yield from _keys(item, f'{above}{name}.')
        elif not isinstance(item, list):
            yield f'{above}{name}'


@dataclass(frozen=True)
class Changes:
    """
    The changes of a replay: none by default.

    `vehicle` is a name in config/vehicles or a file, None: the recorded one. `vehicle_keys` replace values of that
    file by dotted keys, `parameters` recorded ones, `signals` change recorded signals.
    """

    vehicle: str | None = None
    vehicle_keys: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)
    signals: tuple[SignalChange, ...] = ()

    @property
    def is_nothing(self) -> bool:
        """Whether the replay is to reproduce the recording."""
        return self.has_recorded_vehicle and not self.parameters and not self.signals

    @property
    def has_recorded_vehicle(self) -> bool:
        """Whether the vehicle file is the recorded one."""
        return self.vehicle is None and not self.vehicle_keys


def changes_in_words(changes: Changes) -> str:
    """Return the changes as text: my_car.yaml, method=paper, temperature + 2."""
    words = [] if changes.vehicle is None else [changes.vehicle]
    words += [f'{key}={value}' for key, value in changes.vehicle_keys.items()]
    words += [f'{name}={str(value).lower() if isinstance(value, bool) else value}'
              for name, value in changes.parameters.items()]
    words += [change.in_words() for change in changes.signals]
    return ' and '.join(words)


RECORDED_VEHICLE = 'the recorded vehicle file'


class Played(NamedTuple):
    """A step's instant [ns], its StepOutput, and the State after it."""

    now_ns: int
    output: StepOutput
    state: State


class Player:
    """
    A Supervisor that is given recorded steps one after the other.

    `alter(message)` may change a battery state before it is read, `alter_heater(message)` an answer of the
    heater's controller; None: they stay as recorded.
    """

    def __init__(self, flight: Flight, changes: Changes = Changes(),
                 alter: Callable[[Any], None] | None = None,
                 alter_heater: Callable[[Any], None] | None = None) -> None:
        """
        Start as the planner did, or from its recorded state; play the steps of the Flight in order.

        Raises InvalidInput if vehicle or parameters are not allowed.
        """
        self._changes, self._alter, self._alter_heater = changes, alter, alter_heater
        self._beginning, self._number = flight.beginning, 0
        self._vehicles: dict[str, Vehicle] = {}
        self._routes, self._goals = RouteIntake(), GoalNumbers()
        # The planner's states at the start, and after steps that are missing.
        self._starts = {start.at: start for start in flight.starts
                        if start.at == 0 or any(0 < gap <= start.at for gap in flight.gaps)}
        self._supervisor = Supervisor(
            self._vehicle(self._beginning.vehicle_file), self._settings(self._beginning.parameters))
        self._go_on_from(self._starts.pop(0, None))

    @property
    def state(self) -> State:
        """The State after the latest step."""
        return self._supervisor.state

    def play(self, given: Given) -> Played:
        """Take a recorded step; raises InvalidInput if its message or its events cannot be read."""
        step, now_ns = given.step, given.step.now_ns
        self._go_on_from(self._starts.pop(self._number, None))
        self._number += 1
        if step.call == FAIL:
            output = self._supervisor.fail(now_ns, step.what)
        elif step.call == STOP:
            output = self._supervisor.stop(now_ns)
        else:
            output = self._supervisor.step(now_ns, *(self._event(values, given) for values in step.events))
        if output.decision is not None:
            # As the node does to publish the plan.
            self._supervisor.later_decisions()
        return Played(now_ns, output, self._supervisor.state)

    def _go_on_from(self, start: Start | None) -> None:
        """Go on from a recorded state, changed as the Changes say; None: as it is."""
        if start is None:
            return
        state = state_of(start.recorded.state)
        if start.recorded.goal is not None and state.preparation.goal is not None:
            self._goals.numbers[state.preparation.goal] = start.recorded.goal
        if self._changes.has_recorded_vehicle:
            self._vehicles = {self._beginning.vehicle_file: state.vehicle}
        mission = state.inbox.latest_mission
        if start.route is not None and mission is not None:
            message = read_message(*start.route)
            for change in self._changes.signals:
                change.alter_route(message)
            self._routes.remember(mission, message)
        self._supervisor.go_on_from(state)
        if self._changes.is_nothing:
            return
        vehicle, settings = self._vehicle(self._beginning.vehicle_file), self._settings(self._beginning.parameters)
        if state.now_ns:
            self._supervisor.step(state.now_ns, Reconfigured(
                vehicle, settings, self._routes.read_again(state, vehicle, settings)))
        elif self._changes.has_recorded_vehicle:
            self._supervisor.go_on_from(state._replace(inbox=state.inbox._replace(settings=settings)))
        else:
            # Another vehicle file starts without learned values.
            self._supervisor = Supervisor(
                vehicle, settings, last_seen=state.last_seen, choices=state.inbox.choices)

    def _event(self, values: dict[str, Any], given: Given) -> Event:
        kind, hint = values.get('kind'), str(values.get('hint', ''))
        state = self._supervisor.state
        if kind == RECONFIGURED:
            # A recorded Learned is that of another file; a changed vehicle keeps its own learned values.
            vehicle, settings = self._vehicle(str(values['vehicle_file'])), self._settings(values['parameters'])
            return Reconfigured(vehicle, settings, self._routes.read_again(state, vehicle, settings),
                                self._learned(learned_of(values['learned'])))
        if kind not in MESSAGE_KINDS:
            return event_of(values, self._goals)
        message = self._message(given)
        if kind == ROUTE_PLAN:
            for change in self._changes.signals:
                change.alter_route(message)
        elif kind == HVCH_STATUS and self._alter_heater is not None:
            self._alter_heater(message)
        elif kind == BATTERY_STATE:
            if self._alter is not None:
                self._alter(message)
            for change in self._changes.signals:
                change.alter_battery(message)
        return INPUTS[kind].event(message, Reader(state, self._routes, hint))

    def _message(self, given: Given) -> Any:
        if given.message is None:
            raise InvalidInput('a step of the recording has lost its message')
        return read_message(*given.message)

    def _vehicle(self, text: str) -> Vehicle:
        """Return the Vehicle of a file's text, or the changed one; the same object for the same text."""
        if text not in self._vehicles:
            name, keys = self._changes.vehicle, self._changes.vehicle_keys
            contents = text if name is None else vehicle_contents(name).decode('utf-8', 'replace')
            self._vehicles[text] = vehicle_of_text(with_keys(contents, keys), name or RECORDED_VEHICLE)
        return self._vehicles[text]

    def _settings(self, parameters: Mapping[str, Any]) -> Settings:
        recorded = {name: value for name, value in parameters.items() if name in FIELD_OF_PARAMETER}
        return settings_of({**recorded, **self._changes.parameters})

    def _learned(self, learned: Learned | None) -> Learned | None:
        """Return the Learned for a vehicle: another vehicle file starts without."""
        return learned if self._changes.has_recorded_vehicle else None
