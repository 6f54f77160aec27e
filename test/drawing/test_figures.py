# SPDX-License-Identifier: Apache-2.0
"""Contents of the figures of plans, itineraries, routes and drives."""

from dataclasses import replace

import numpy as np
import pytest

from bev_preheat.control.inputs import Leg
from bev_preheat.drawing.drive_figure import AMBIENT, BATTERY, make_drive_figure, PREDICTED, UNHEATED
from bev_preheat.drawing.inputs_figure import make_route_figure
from bev_preheat.drawing.palette import CHARGE_LIMIT, DISCHARGE_LIMIT, look_of
from bev_preheat.drawing.plan_figure import make_itinerary_figure, make_plan_figure
from bev_preheat.numerics import FLOATS, NS_PER_S
from bev_preheat.planning.planner import METHODS, plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route, make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatPath

VEHICLE = load_vehicle('reference')
STATE = BatteryState(-7.0, 0.9)
PANELS = ('temperature', 'heater', 'charge', 'power', 'heat', 'leakage', 'drive')


def constant_route(steps=40, power_w=15e3, ambient_c=-7.0, **columns):
    """Return a Route at 20 m/s with constant values."""
    return make_route({name: np.full(steps, value) for name, value in {
        'duration_s': 60.0, 'speed_mps': 20.0, 'propulsion_power_w': power_w,
        'propulsion_power_rms_w': abs(power_w), 'ambient_temperature_c': ambient_c,
        'cabin_heating_power_w': 1500.0, 'auxiliary_power_w': 300.0, **columns}.items()},
        VEHICLE.defaults)


def panels_of(route, state=STATE, goal=Goal(25.0), methods=('value_function',), vehicle=VEHICLE):
    """Return the panels of the plans of some methods by name, and the plans."""
    plans = [plan_preheating(vehicle, route, state, goal, method) for method in methods]
    figure = make_plan_figure(vehicle, route, goal, plans, 'title')
    # Several plans are compared in the first four.
    return dict(zip(PANELS, figure.axes)), plans


def curves(axis, colour):
    return [line for line in axis.get_lines() if line.get_color() == colour]


def texts(axis):
    return [text.get_text() for legend in axis.get_children() if hasattr(legend, 'get_texts')
            for text in legend.get_texts()]


@pytest.fixture(scope='module')
def reference():
    return panels_of(load_route('reference', VEHICLE.defaults))


@pytest.fixture(scope='module')
def alpine():
    return panels_of(load_route('alpine_pass', VEHICLE.defaults), BatteryState(-10.0, 0.9))


@pytest.fixture(scope='module')
def compared():
    return panels_of(constant_route(), methods=METHODS)


def test_of_a_heat_path_command_and_what_comes_of_it_are_drawn():
    vehicle = replace(VEHICLE, heat_path=HeatPath(60.0, 20e3, 400.0))
    warm = BatteryState(12.0, 0.9, 4000.0, 8.0)
    panels, (plan,) = panels_of(constant_route(), warm, vehicle=vehicle)
    colour = look_of('value_function').colour
    commanded, drawn = curves(panels['heater'], colour)
    for line, power_w in ((commanded, plan.hvch_battery_power_w), (drawn, plan.heat.drawn_power_w)):
        assert set(line.get_ydata()) == set(power_w / 1e3)
    assert 'heater' in texts(panels['heat'])
    # Heat under way at the start warms the battery without preheating too.
    unheated = plan_unheated(vehicle, constant_route(), warm, Goal(25.0))
    cold = plan_unheated(vehicle, constant_route(), BatteryState(12.0, 0.9), Goal(25.0))
    assert plan.start_state == warm
    assert unheated.arrival_temperature_c > cold.arrival_temperature_c + 0.1
    assert any(np.array_equal(line.get_ydata()[:len(plan.time_s)], unheated.battery_temperature_c)
               for line in panels['temperature'].get_lines())


@pytest.mark.costly
@pytest.mark.parametrize('reserve, text, is_seen', [
    (0.75, 'reserve 75 %', True), (0.2, 'reserve 20 % (below this range)', False)])
def test_the_reserve_is_drawn_or_said(reserve, text, is_seen):
    panels, _ = panels_of(constant_route(), goal=Goal(0.0, reserve))
    low, high = panels['charge'].get_ylim()
    assert texts(panels['charge']) == [text]
    assert bool(low < 100.0 * reserve < high) is is_seen


def test_limits_have_colours_of_their_own_and_are_where_the_vehicle_says(alpine):
    panels, (plan,) = alpine
    charge, = curves(panels['power'], CHARGE_LIMIT)
    discharge, = curves(panels['power'], DISCHARGE_LIMIT)
    battery = VEHICLE.battery
    for line, limit in ((charge, battery.charge_power_limit),
                        (discharge, battery.discharge_power_limit)):
        at_start_w, at_end_w = (limit.function(FLOATS)(*state) for state in (
            (0.9, -10.0), (plan.soc[-2], plan.battery_temperature_c[-2])))
        assert line.get_ydata()[[0, -1]] == pytest.approx([at_start_w / 1e3, at_end_w / 1e3])
    assert charge.get_ydata().max() < 0.0 < discharge.get_ydata().min()
    assert CHARGE_LIMIT != DISCHARGE_LIMIT


def test_coinciding_methods_are_all_seen(compared):
    panels, _ = compared
    lines = [curves(panels['heater'], look_of(method).colour)[0] for method in METHODS]
    by_values, switch, paper = lines
    assert switch.get_ydata() == pytest.approx(by_values.get_ydata(), abs=1e-3)
    assert by_values.get_linewidth() > switch.get_linewidth() > paper.get_linewidth()
    assert by_values.get_zorder() < switch.get_zorder() < paper.get_zorder()
    assert by_values.get_linestyle() == '-' and {line.get_linestyle() for line in lines[1:]} == {'--'}


def test_a_plan_that_does_not_heat_says_so_and_is_drawn_once():
    panels, _ = panels_of(constant_route(power_w=0.0, ambient_c=25.0, speed_mps=0.0),
                          BatteryState(25.0, 0.5), Goal(20.0))
    assert texts(panels['temperature'])[0].startswith('value_function (default), does not heat: 25')
    assert not curves(panels['temperature'], look_of('without preheating').colour)


def test_an_empty_battery_ends_the_drive_in_every_panel():
    panels, (plan,) = panels_of(constant_route(power_w=40e3), BatteryState(-7.0, 0.1))
    at_min = plan.stranding.at_s / 60.0
    assert texts(panels['temperature'])[0] == (
        f'value_function (default), does not heat: battery empty after '
        f'{at_min // 1:.0f}:{at_min % 1 * 60:02.0f} min')
    assert 'battery empty' in texts(panels['charge'])
    for name in ('power', 'drive'):
        driven = panels[name].get_lines()[0]
        assert driven.get_ydata()[np.array(driven.get_xdata()) > at_min + 1.0] == pytest.approx(0.0)
        assert [line for line in panels[name].get_lines()
                if list(line.get_xdata()) == pytest.approx([at_min] * 2)]


def test_every_panel_has_a_unit(reference):
    panels, _ = reference
    assert [axis.get_ylabel().split('[')[1] for axis in panels.values()] == [
        '°C]', 'kW]', '%]', 'kW]', 'kW]', 'kW]', 'km/h]']
    assert panels['drive'].get_xlabel() == 'trip time [min]'


@pytest.mark.costly
def test_no_text_of_a_plan_is_cut_or_covers_another(compared):
    panels, _ = compared
    figure = panels['power'].figure
    figure.draw_without_rendering()
    legends = [child.get_window_extent() for axis in panels.values()
               for child in axis.get_children() if hasattr(child, 'get_texts')]
    boxes = [*legends, figure.texts[0].get_window_extent(),
             *(axis.get_window_extent() for axis in panels.values())]
    for number, box in enumerate(boxes):
        assert box.x0 >= 0.0 and box.x1 <= figure.bbox.x1 + 1.0 and box.y1 <= figure.bbox.y1
        for other in boxes[number + 1:]:
            assert min(box.x1, other.x1) <= max(box.x0, other.x0) + 1.0 or (
                min(box.y1, other.y1) <= max(box.y0, other.y0) + 1.0)


@pytest.fixture(scope='module')
def itinerary():
    """Return the panels of two legs with half an hour between them, and their plans."""
    route = constant_route()
    legs = [Leg(route, 0, True, 20.0, 0.15, STATE),
            Leg(route, 4200 * NS_PER_S, False, None, 0.4, BatteryState(19.0, 0.95))]
    plans = [plan_preheating(VEHICLE, leg.route, leg.departure, leg.goal(25.0)) for leg in legs]
    return make_itinerary_figure(VEHICLE, legs, plans, 'two legs'), plans


def test_each_leg_has_its_trip_without_preheating(itinerary):
    figure, plans = itinerary
    lines = curves(figure.axes[0], look_of('without preheating').colour)
    assert [(line.get_xdata()[0], line.get_ydata()[0]) for line in lines] == [
        (0.0, -7.0), (70.0, 19.0)]
    assert lines[0].get_ydata()[-1] < plans[0].arrival_temperature_c - 5.0


def test_a_route_shows_speed_power_and_ambient_with_units():
    route = constant_route(steps=3, propulsion_power_rms_w=17e3)
    speed, power, ambient = make_route_figure('a$b', route).axes
    assert [line.get_ydata()[0] for line in (speed.get_lines()[0], power.get_lines()[0],
                                             ambient.get_lines()[0])] == [72.0, 15.0, -7.0]
    deviation_kw = np.sqrt(17.0**2 - 15.0**2)
    shaded = power.collections[0].get_paths()[0].vertices[:, 1]
    assert (shaded.min(), shaded.max()) == pytest.approx((15 - deviation_kw, 15 + deviation_kw))
    assert [axis.get_ylabel().split('\n')[1] for axis in (speed, power, ambient)] == [
        '[km/h]', '[kW]', '[°C]']
    assert power.get_ylim()[0] < 0.0


def test_a_comparison_keeps_each_method_s_colour_as_driven(alpine):
    _, (plan,) = alpine
    route = load_route('alpine_pass', VEHICLE.defaults)
    figure = make_plan_figure(VEHICLE, route, Goal(25.0), [
        plan, replace(plan, method='paper, driven')], 'title')
    assert curves(figure.axes[1], look_of('paper').colour)
    assert 'paper (published heuristic), limits kept: ' in ''.join(texts(figure.axes[0]))


def test_heat_sources_are_stacked_under_their_sum():
    vehicle = load_vehicle('heat_pump_car')
    panels, [plan] = panels_of(constant_route(), BatteryState(-25.0, 0.9), Goal(40.0), vehicle=vehicle)
    heater = panels['heater']
    used = [name for name, power_w in plan.source_power_w.items() if power_w.max() > 10.0]
    assert len(used) > 1 and texts(heater)[:len(used)] == used
    drawn_kw = heater.get_lines()[0].get_ydata()
    assert drawn_kw[::2] == pytest.approx(sum(plan.source_power_w.values()) / 1e3)
    tops_kw = [area.get_datalim(heater.transData).y1 for area in heater.collections]
    assert max(tops_kw) == pytest.approx(drawn_kw.max())


def test_a_plan_that_cools_says_so_and_shows_the_range():
    vehicle = load_vehicle('heat_pump_car')
    panels, _ = panels_of(constant_route(ambient_c=30.0, power_w=9e3), BatteryState(44.0, 0.9), Goal(
        22.0, maximum_arrival_temperature_c=35.0), vehicle=vehicle)
    told = texts(panels['temperature'])
    assert 'target 22.0 … 35.0 °C' in told and any(', cools: 35.0 °C' in each for each in told)


# A drive


@pytest.fixture(scope='module')
def drive_panels():
    """Draw ten minutes with heating from the fourth minute on."""
    times_s, ends_s = np.linspace(0.0, 600.0, 31), np.array([0.0, 600.0])
    return make_drive_figure(
        'title', {AMBIENT: (ends_s, np.array([-7.0, -7.0])), PREDICTED: (times_s, np.full(31, 9.1)),
                  BATTERY: (times_s, np.linspace(2.0, 9.2, 31)), UNHEATED: (ends_s, np.array([2.0, 3.0]))},
        (times_s[:-1], 5000.0 * (times_s[:-1] > 241.0)), 9.0,
        {BATTERY: (times_s, np.linspace(0.8, 0.75, 31)), UNHEATED: (ends_s, np.array([0.8, 0.77]))}).axes


def test_the_temperatures_are_told_apart_and_have_their_values_on_arrival(drive_panels):
    drawn = {line.get_label(): line for line in drive_panels[0].get_lines()}
    assert list(drawn) == ['ambient', 'predicted on arrival', 'battery, ends at 9.2 °C',
                           'without preheating, ends at 3.0 °C', 'target 9.0 °C']
    assert drawn['battery, ends at 9.2 °C'].get_color() == look_of('planner').colour
    assert drawn['without preheating, ends at 3.0 °C'].get_linestyle() == '--'
    # Wider than the target, which mostly lies on it.
    assert drawn['predicted on arrival'].get_linewidth() > 3.0 * drawn['target 9.0 °C'].get_linewidth()


def test_commands_last_until_the_vehicle_stands(drive_panels):
    command, = drive_panels[1].get_lines()
    assert command.get_xydata()[-1].tolist() == [10.0, 5.0]
    low, high = drive_panels[1].get_ylim()
    assert low < 0.0 < 5.0 < high
