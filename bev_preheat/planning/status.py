# SPDX-License-Identifier: Apache-2.0
"""Status of a plan or command, and its meaning to planner, heater, diagnostics, replay and page: one table."""

from dataclasses import dataclass
from enum import IntEnum


class Status(IntEnum):
    """Status of a plan and reason of a heater command: the numbers of HvchCommand.msg, which explains each."""

    NO_ROUTE = 0
    NO_BATTERY_STATE = 1
    NO_CHARGING_PLANNED = 2
    NOT_NEEDED = 3
    WAITING = 4
    HEATING = 5
    TARGET_UNREACHABLE = 6
    SOC_LIMITED = 7
    POWER_LIMITED = 8
    DISABLED = 9
    STALE_INPUT = 10
    INVALID_INPUT = 11
    ARRIVED = 12
    SHUTTING_DOWN = 13
    INTERNAL_ERROR = 14
    CHARGING = 15
    OUT_OF_CHARGE = 16
    COMMAND_CONFLICT = 17
    NOT_WORTH_IT = 18
    WAITING_TO_COOL = 19
    COOLING = 20

    @property
    def meaning(self) -> 'Meaning':
        """The status's row in the table."""
        return MEANINGS[self]


class Level(IntEnum):
    """Level of a status in /diagnostics, as in diagnostic_msgs: a finding to look at, or something is at fault."""

    OK = 0
    WARN = 1
    ERROR = 2


# The status of a plan that heats or cools later, by the status while it does.
LATER = {Status.HEATING: Status.WAITING, Status.COOLING: Status.WAITING_TO_COOL}


@dataclass(frozen=True)
class Meaning:
    """
    The meaning of a Status.

    `word` and `look` (off, wait, heat, cool, good, warn: shape and colour) are those of the page, `level` that of
    /diagnostics. `otherwise` is the change that would lead to another answer, `obstacle` why there was no heat,
    or less than wanted; '' where the plan has a sentence of its own.

    `is_of_plan`: successive plans may alternate between such statuses. `is_alarm`: the plan falls short.
    `is_doubt`: the heater stays off until the input has been valid for a while; `cause` is its subject and verb,
    '' if the sentence of the status says more. `ends_by_plan`: the least time off holds, as for any other
    switching. `is_over`: the trip has ended.
    """

    word: str
    look: str
    level: Level = Level.OK
    otherwise: str = ''
    obstacle: str = ''
    is_of_plan: bool = False
    is_alarm: bool = False
    is_doubt: bool = False
    cause: str = ''
    ends_by_plan: bool = False
    is_over: bool = False


MEANINGS = {
    Status.NO_ROUTE: Meaning(
        'No route', 'off', Level.WARN,
        otherwise='A route_plan with charging planned at its end would be planned for.'),
    Status.NO_BATTERY_STATE: Meaning(
        'No battery state', 'warn', Level.WARN, otherwise='A valid battery_state would let the planner plan.',
        obstacle='there was no battery state', is_doubt=True, cause='There was no valid battery state'),
    Status.NO_CHARGING_PLANNED: Meaning(
        'No charging planned', 'off', otherwise='A route_plan with charging_planned would be heated for.',
        obstacle='no charging was planned'),
    Status.NOT_NEEDED: Meaning('Warm enough', 'good', is_of_plan=True),
    Status.WAITING: Meaning('Waiting to heat', 'wait', is_of_plan=True, ends_by_plan=True),
    Status.HEATING: Meaning('Heating', 'heat', is_of_plan=True),
    Status.WAITING_TO_COOL: Meaning(
        'Waiting to cool', 'wait', is_of_plan=True, ends_by_plan=True,
        otherwise='A warmer battery or a lower highest temperature would start the cooling sooner.'),
    Status.COOLING: Meaning(
        'Cooling', 'cool', is_of_plan=True,
        otherwise='The cooling stops when the battery arrives cold enough without further cooling.'),
    Status.TARGET_UNREACHABLE: Meaning(
        'Target out of reach', 'warn', Level.WARN,
        otherwise='More time, more power for it or a start closer to the target would reach it.',
        obstacle='the target was out of reach', is_of_plan=True, is_alarm=True),
    Status.SOC_LIMITED: Meaning(
        'Limited by the charge', 'warn', Level.WARN,
        otherwise='More charge on arrival, or a lower minimum_arrival_soc, would leave energy for heat.',
        obstacle='the charge left no energy for heat', is_of_plan=True, is_alarm=True),
    Status.POWER_LIMITED: Meaning(
        'Limited by the power', 'warn', Level.WARN,
        otherwise='Less propulsion power, or a warmer battery, would leave power for the heater.',
        obstacle='the battery left no power for heat', is_of_plan=True, is_alarm=True),
    Status.DISABLED: Meaning(
        'Switched off', 'off', otherwise='Preheating is off until ~/enable is called with true.',
        obstacle='preheating was switched off'),
    Status.STALE_INPUT: Meaning(
        'Battery state too old', 'warn', Level.ERROR,
        otherwise='A battery_state younger than battery_state_timeout would let the planner plan.',
        obstacle='the battery state was too old', is_doubt=True,
        cause='battery_state was too old, or ahead of the clock,'),
    Status.INVALID_INPUT: Meaning(
        'Input refused', 'warn', Level.ERROR,
        otherwise='Valid values in the named fields would let the planner plan.',
        obstacle='inputs were refused', is_doubt=True),
    Status.ARRIVED: Meaning(
        'Arrived', 'good', otherwise='A new route_plan would be planned for.', is_over=True),
    Status.SHUTTING_DOWN: Meaning('Planner shuts down', 'off'),
    Status.INTERNAL_ERROR: Meaning(
        'Planner failed', 'warn', Level.ERROR, otherwise='The next step without an exception ends it.',
        obstacle='planning failed', is_doubt=True, cause='Planning failed'),
    Status.CHARGING: Meaning(
        'Charging', 'good', is_over=True,
        otherwise='The vehicle must drive on, or its route go on, before it is heated for a route.'),
    Status.OUT_OF_CHARGE: Meaning(
        'Charge does not last', 'warn', Level.WARN,
        otherwise='More charge, or a shorter way, would let the vehicle arrive.',
        obstacle='the charge did not last', is_alarm=True, ends_by_plan=True),
    Status.COMMAND_CONFLICT: Meaning(
        'Two nodes command the heater', 'warn', Level.ERROR,
        otherwise='The heater stays off until no other node publishes hvch_command.',
        obstacle='another node commanded the heater', is_doubt=True, cause='Another node commanded the heater'),
    Status.NOT_WORTH_IT: Meaning(
        'Heating does not pay', 'off',
        otherwise='A lower energy_price or a higher value_of_time would make heating pay.',
        obstacle='heating did not pay', ends_by_plan=True)}
