# SPDX-License-Identifier: Apache-2.0
"""Contents of a demonstration's picture."""

from array import array

from builtin_interfaces.msg import Time
import numpy as np
import pytest

from bev_preheat.demo.observer import ObservedDrive
from bev_preheat.drawing.demo_figure import make_drive_figure
from bev_preheat.drawing.palette import look_of
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import PreheatPlan, RoutePlan

START_S = 1000


@pytest.fixture(scope='module')
def panels():
    """Draw ten minutes at 15 kW in the cold, with heating from the fourth minute on."""
    drive = ObservedDrive()
    drive.route = RoutePlan(
        segment_duration=array('d', [60.0] * 10), speed=array('d', [20.0]),
        propulsion_power=array('d', [15e3]), ambient_temperature=array('d', [-7.0]),
        charging_planned=True)
    drive.route.header.stamp = Time(sec=START_S)
    drive.first_plan = drive.plan = PreheatPlan(
        time=array('d', [0.0, 240.0, 598.0]), battery_temperature=array('d', [2.0, 3.0, 9.0]),
        soc=array('d', [0.8, 0.78, 0.75]), hvch_power=array('d', [0.0, 5000.0]),
        target_battery_temperature=9.0)
    instants = np.linspace(0.0, 600.0, 31)
    drive.states = [(t, 2.0 + 7.2 * t / 600.0, 0.8 - 0.05 * t / 600.0) for t in instants]
    drive.commands = [(t, 5000.0 * (t > 241.0)) for t in instants]
    drive.predictions = [(t, 9.1) for t in instants]
    return make_drive_figure(drive, load_vehicle('reference'), 'title').axes


def lines(axis):
    return {line.get_label(): line for line in axis.get_lines()}


def test_the_drive_without_preheating_is_dashed_and_colder(panels):
    line = next(line for label, line in lines(panels[0]).items()
                if label.startswith('without preheating, at '))
    assert (line.get_xdata()[0], line.get_ydata()[0], line.get_xdata()[-1]) == (0.0, 2.0, 10.0)
    assert line.get_linestyle() == '--'
    assert line.get_label() == f'without preheating, at {line.get_ydata()[-1]:.1f} °C'
    # Without the heater: only the heat of ten minutes of driving.
    assert 2.0 < line.get_ydata()[-1] < 4.0


def test_the_drive_has_the_planner_s_colour(panels):
    assert lines(panels[0])['battery, arrival at 9.2 °C'].get_color() == look_of('planner').colour


def test_one_instant_of_switching_on_is_named(panels):
    assert list(lines(panels[1])) == ['command, on after 4:20 min']


def test_commands_last_until_the_vehicle_stands(panels):
    command, = panels[1].get_lines()
    assert command.get_xydata()[-1].tolist() == [10.0, 5.0]
    low, high = panels[1].get_ylim()
    assert low < 0.0 < 5.0 < high


def test_state_of_charge_on_arrival_is_told(panels):
    assert 'battery, arrival with 75.0 %' in lines(panels[2])
    assert panels[2].get_xlabel() == 'trip time [min]'
