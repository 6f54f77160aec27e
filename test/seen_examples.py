# SPDX-License-Identifier: Apache-2.0
"""Plans and boards for the tests of the page and of the terminal's view."""

import math

from bev_preheat.monitoring.board import Board
from bev_preheat.monitoring.seen import PlanSeen
from bev_preheat.planning.status import Status

START_S = 1_700_000_000.0
NAN = math.nan


def a_plan(at_s=START_S, **changed):
    """Return a plan that waits 600 s, heats 1200 s and arrives after 1800 s."""
    values = {
        'at_s': at_s, 'route_id': 'home', 'method': 'value_function', 'status': int(Status.WAITING),
        'sentence': 'Heating starts in 10:00 min.', 'heating_start_s': START_S + 600.0,
        'heating_end_s': START_S + 1800.0, 'arrival_s': START_S + 1800.0, 'predicted_c': 24.5, 'deviation_k': 0.4,
        'target_c': 25.0, 'most_c': math.nan, 'target_reason': '', 'arrival_soc': 0.61, 'charging_s': 1800.0,
        'charging_unheated_s': 2520.0, 'times_s': (START_S, START_S + 600.0, START_S + 1800.0),
        'temperatures_c': (-7.0, -5.0, 24.5), 'socs': (0.9, 0.85, 0.61), 'powers_w': (0.0, 5000.0)}
    return PlanSeen(**{**values, **changed})


def a_board(**plan):
    """Return a board with one of each message, heard at 100 s (monotonic)."""
    board = Board()
    board.see_command(START_S, 0.0, int(Status.WAITING), 100.0)
    board.see_battery(START_S, -7.0, 0.9, 100.0)
    board.see_plan(a_plan(**plan), 100.0)
    return board
