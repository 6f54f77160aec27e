# SPDX-License-Identifier: Apache-2.0
"""Plans and boards for the tests of the page and of the terminal's view."""

import math

from builtin_interfaces.msg import Time

from bev_preheat.monitoring.board import Board
from bev_preheat.monitoring.seen import PlanSeen
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import PreheatPlan

START_S = 1_700_000_000.0
NAN = math.nan


def a_plan(at_s=START_S, **changed):
    """Return a plan that waits 600 s, heats 1200 s and arrives after 1800 s."""
    message = {
        'route_id': 'home', 'method': 'value_function', 'status': int(Status.WAITING),
        'explanation': 'Heating starts in 10:00 min.', 'heating_planned': True, 'heating_start': instant(600),
        'heating_end': instant(1800), 'arrival': instant(1800), 'predicted_arrival_temperature': 24.5,
        'predicted_arrival_temperature_deviation': 0.4, 'target_battery_temperature': 25.0,
        'maximum_arrival_temperature': NAN, 'predicted_arrival_soc': 0.61, 'charging_time': 1800.0,
        'charging_time_unheated': 2520.0}
    curves = {
        'times_s': (START_S, START_S + 600.0, START_S + 1800.0), 'temperatures_c': (-7.0, -5.0, 24.5),
        'socs': (0.9, 0.85, 0.61), 'powers_w': (0.0, 5000.0)}
    fields = PreheatPlan.get_fields_and_field_types()
    message.update((name, changed.pop(name)) for name in list(changed) if name in fields)
    seen = {'at_s': at_s, 'heating_start_s': START_S + 600.0, **curves, **changed}
    return PlanSeen(PreheatPlan(**message), **seen)


def instant(after_s):
    """Return a stamp some seconds after the start."""
    return Time(sec=round(START_S) + after_s)


def a_board(**plan):
    """Return a board with one of each message, heard at 100 s (monotonic)."""
    board = Board()
    board.see_command(START_S, 0.0, int(Status.WAITING), 100.0)
    board.see_battery(START_S, -7.0, 0.9, 100.0)
    board.see_plan(a_plan(**plan), 100.0)
    return board
