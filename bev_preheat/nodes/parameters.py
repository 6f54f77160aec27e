# SPDX-License-Identifier: Apache-2.0
"""Parameters with a description, a unit and a range, declared and checked from one table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import partial
import math
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from bev_preheat.charging.stop import CHARGER_RANGE_W
from bev_preheat.errors import figure, figure_beyond, InvalidInput, quoted

# Declared by rclpy in every node; it can be set at run time.
USE_SIM_TIME = 'use_sim_time'
# By the type of the default.
IN_WORDS = {float: 'a number', int: 'a whole number', bool: 'true or false', str: 'a text'}


@dataclass(frozen=True)
class Parameter:
    """
    One parameter of a node.

    `limits` is (low, high) for numbers; `unset_means` explains 0 and NaN if they mean that the value is unset
    (0 as the default: a NaN does not survive `ros2 param dump` and `load`); `choices` lists the allowed texts.
    `more_choices` returns further ones; it is called for the help and for a text that `choices` does not list,
    because it may take longer than a start allows, and `more_in_words` names them elsewhere. `earlier_choices` are
    accepted and not listed. Messages never repeat the value of a `secret` one.
    """

    name: str
    default: Any
    description: str
    unit: str = ''
    limits: tuple[float, float] | None = None
    unset_means: str = ''
    choices: tuple[str, ...] = ()
    read_only: bool = False
    more_choices: Callable[[], tuple[str, ...]] | None = None
    more_in_words: str = ''
    earlier_choices: tuple[str, ...] = ()
    secret: bool = False

    def descriptor(self) -> ParameterDescriptor:
        """Return the descriptor for `ros2 param describe`."""
        constraints = []
        if self.limits and self.unset_means:
            constraints.append(f'{figure(self.limits[0])} ... {figure(self.limits[1])}; 0 or NaN: '
                               f'{self.unset_means}')
        if self.choices:
            constraints.append(f'one of {", ".join(self.choices)}{self.more_in_words}')
        ranges = []
        # rclpy's own range check would refuse NaN.
        if self.limits and not self.unset_means and isinstance(self.default, float):
            ranges = [FloatingPointRange(from_value=float(self.limits[0]),
                                         to_value=float(self.limits[1]))]
        return ParameterDescriptor(
            description=f'{self.description} [{self.unit}]' if self.unit else self.description,
            additional_constraints='; '.join(constraints),
            floating_point_range=ranges, read_only=self.read_only)

    def default_text(self) -> str:
        """Return the default as a person writes it."""
        return as_typed(self.default) or 'empty'

    def help_text(self) -> str:
        """Return the --help text: description, unit, range."""
        text = self.description.rstrip('.')
        unit = f' {self.unit}' if self.unit else ''
        if self.limits:
            text += f'; {figure(self.limits[0])} ... {figure(self.limits[1])}{unit}'
            text += f'; 0 or NaN: {self.unset_means}' if self.unset_means else ''
        if self.choices:
            text += f'; one of {", ".join(self._all_choices())}'
        return f'{text}.'

    def _all_choices(self) -> tuple[str, ...]:
        return self.choices if self.more_choices is None else (*self.choices, *self.more_choices())

    def taken(self, value: Any) -> Any:
        """Return a value as the node stores it: a whole number for a double as a float."""
        is_whole = isinstance(value, int) and not isinstance(value, bool)
        return float(value) if is_whole and isinstance(self.default, float) else value

    def type_problem_with(self, value: Any) -> str | None:
        """Return a sentence if a value's type differs from the default's, otherwise None."""
        wanted = type(self.default)
        if type(value) is wanted:
            return None
        # An empty default shows nothing.
        example = '' if wanted is bool or self.default == '' else f', such as {self.default_text()}'
        if self.secret:
            return f'{self.name}: is not {IN_WORDS[wanted]}; write a text of digits in quotes within quotes'
        return (f'{self.name}: {quoted(as_typed(value))} is not allowed; it must be '
                f'{IN_WORDS[wanted]}{example}')

    def problem_with(self, value: Any) -> str | None:
        """Return a sentence on the problem with a value, None if it is valid."""
        unit = f' {self.unit}' if self.unit else ''
        if (self.choices and value not in (*self.choices, *self.earlier_choices)
                and value not in (choices := self._all_choices())):
            return f'{self.name}: {quoted(str(value))} is not one of {", ".join(choices)}'
        if self.limits is None or (self.unset_means and (math.isnan(value) or value == 0.0)):
            return None
        low, high = self.limits
        if not low <= value <= high:
            return (f'{self.name}: {figure_beyond(value, low, high)}{unit} is not allowed; it must be '
                    f'{figure(low)} ... {figure(high)}{unit}')
        return None


# A parameter that cannot be set at run time.
StartParameter = partial(Parameter, read_only=True)

# The goal at the end of a route, in every node that reads a route from a file.
GOAL_PARAMETERS = (
    Parameter('charging_planned', True, 'Whether the route ends at a fast charger.'),
    Parameter('target_battery_temperature', 0.0, 'Requested battery temperature on arrival', 'degC', (-60.0, 60.0),
              unset_means='left to the planner'),
    Parameter('maximum_arrival_temperature', 0.0, 'Highest battery temperature on arrival', 'degC', (-60.0, 60.0),
              unset_means='any'),
    Parameter('minimum_arrival_soc', 0.0, 'Requested minimum state of charge on arrival', '', (0.0, 1.0)),
    Parameter('charger_power', 0.0, 'Power of that charger at the vehicle', 'W', CHARGER_RANGE_W,
              unset_means='not known'),
    Parameter('charging_departure_soc', 0.0, 'State of charge on leaving it', '', (0.0, 1.0),
              unset_means='not known'))


def declare(node: Node, parameters: Sequence[Parameter]) -> dict[str, Any]:
    """
    Declare the parameters and return their values by name; raise InvalidInput on bad ones.

    If all of them are read-only, the node's clock cannot be exchanged at run time either.
    """
    given, values, problems = given_parameters(node), {}, []
    for parameter in parameters:
        value = parameter.default
        if parameter.name in given:
            value = parameter.taken(given[parameter.name].value)
            if problem := parameter.type_problem_with(value) or parameter.problem_with(value):
                # rclpy would name only one.
                problems.append(problem)
        values[parameter.name] = value
    if problems:
        raise InvalidInput(problems)
    node.add_pre_set_parameters_callback(partial(_taken, {item.name: item for item in parameters}))
    for parameter in parameters:
        node.declare_parameter(
            parameter.name, values[parameter.name], parameter.descriptor(), ignore_override=True)
    if all(parameter.read_only for parameter in parameters):
        # rclpy gives its own object away.
        descriptor = copy(node.describe_parameter(USE_SIM_TIME))
        descriptor.read_only = True
        node.set_descriptor(USE_SIM_TIME, descriptor)
    return values


def given_parameters(node: Node) -> dict[str, RosParameter]:
    """Return the parameters of the command line and of parameter files for a node, by name."""
    with node.handle:
        given: dict[str, RosParameter] = node.handle.get_parameters(RosParameter)
    return given


def _taken(table: Mapping[str, Parameter], given: Sequence[RosParameter]) -> list[RosParameter]:
    """Return the parameters to be set, with whole numbers converted to doubles."""
    return [RosParameter(item.name, value=table[item.name].taken(item.value))
            if item.name in table and item.type_ == RosParameter.Type.INTEGER else item for item in given]


def as_typed(value: Any) -> str:
    """Return a value as a person types it on a command line."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def check(parameters: Iterable[Parameter], values: Mapping[str, Any]) -> None:
    """Raise InvalidInput, one problem per wrong value; `values` is a dictionary by name."""
    problems = [problem for parameter in parameters
                if parameter.name in values
                and (problem := parameter.problem_with(values[parameter.name]))]
    if problems:
        raise InvalidInput(problems)
