# SPDX-License-Identifier: Apache-2.0
"""Contents of the picture of a drive."""

import numpy as np
import pytest

from bev_preheat.drawing.drive_figure import AMBIENT, BATTERY, make_drive_figure, PREDICTED, UNHEATED
from bev_preheat.drawing.palette import look_of


@pytest.fixture(scope='module')
def panels():
    """Draw ten minutes with heating from the fourth minute on."""
    times_s, ends_s = np.linspace(0.0, 600.0, 31), np.array([0.0, 600.0])
    return make_drive_figure(
        'title', {AMBIENT: (ends_s, np.array([-7.0, -7.0])), PREDICTED: (times_s, np.full(31, 9.1)),
                  BATTERY: (times_s, np.linspace(2.0, 9.2, 31)), UNHEATED: (ends_s, np.array([2.0, 3.0]))},
        (times_s[:-1], 5000.0 * (times_s[:-1] > 241.0)), 9.0,
        {BATTERY: (times_s, np.linspace(0.8, 0.75, 31)), UNHEATED: (ends_s, np.array([0.8, 0.77]))}).axes


def lines(axis):
    return {line.get_label(): line for line in axis.get_lines()}


def test_the_temperatures_are_told_apart_and_have_their_values_on_arrival(panels):
    drawn = lines(panels[0])
    assert list(drawn) == ['ambient', 'predicted on arrival', 'battery, ends at 9.2 °C',
                           'without preheating, ends at 3.0 °C', 'target 9.0 °C']
    assert drawn['battery, ends at 9.2 °C'].get_color() == look_of('planner').colour
    assert drawn['without preheating, ends at 3.0 °C'].get_linestyle() == '--'
    # Wider than the target, which mostly lies on it.
    assert drawn['predicted on arrival'].get_linewidth() > 3.0 * drawn['target 9.0 °C'].get_linewidth()


def test_commands_last_until_the_vehicle_stands(panels):
    command, = panels[1].get_lines()
    assert command.get_xydata()[-1].tolist() == [10.0, 5.0]
    low, high = panels[1].get_ylim()
    assert low < 0.0 < 5.0 < high
