# SPDX-License-Identifier: Apache-2.0
"""Status of a plan or command; the numbers are those of the messages' constants."""

from enum import IntEnum


class Status(IntEnum):
    """Status of a plan and reason of a heater command; HvchCommand.msg explains each."""

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
