# SPDX-License-Identifier: Apache-2.0
"""
`python3 -m bev_preheat_studies.value_picture`: the value of a kelvin by time and temperature, as a picture.

The table of values behind a plan of method `value_function`, and the plan's path through it.
"""

from __future__ import annotations

from argparse import RawDescriptionHelpFormatter
import sys
from typing import TYPE_CHECKING

from bev_preheat.commands.situation import add_situation_arguments, read_situation
from bev_preheat.console.parser import OneLineParser
from bev_preheat.console.program import FAILED, run_program, say
from bev_preheat.files.output_files import check_outputs, OutputFile, PICTURE_SUFFIXES
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.trip import make_trip
from bev_preheat.planning.value_function import value_table

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the picture; returns the exit status."""
    return run_program('value_picture', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    parser = OneLineParser(prog='python3 -m bev_preheat_studies.value_picture', description=__doc__,
                           formatter_class=RawDescriptionHelpFormatter)
    add_situation_arguments(parser)
    parser.add_argument('--plot', metavar='FILE', required=True, help='picture: .png, .pdf or .svg')
    parsed = parser.parse_args(arguments)
    return lambda: _draw(parsed)


def _draw(arguments: Namespace) -> int:
    situation = read_situation(arguments)
    check_outputs([OutputFile('--plot', arguments.plot, PICTURE_SUFFIXES)], situation.files)
    from bev_preheat_studies.drawing.value_figure import draw_values
    inputs = situation.vehicle, situation.route, situation.state, situation.goal
    trip = make_trip(situation.vehicle, situation.route)
    table = value_table(trip, situation.state, situation.goal)
    if table is None:
        say('value_picture: the charge does not carry the trip, so there is no value of heat')
        return FAILED
    plan = plan_preheating(*inputs)
    title = f'vehicle {situation.vehicle.name}, route {arguments.route}'
    draw_values(arguments.plot, trip, table, plan, plan_unheated(*inputs),
                f'{title}\n{plan.status.name}: {plan.explanation}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
