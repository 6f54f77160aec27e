# SPDX-License-Identifier: Apache-2.0
"""
Plans from the values of an earlier plan.

The rest of a plan that is best from now on is best from later on (Bellman's principle), so what is left of a
plan is known without making one.
"""

from dataclasses import replace

import numpy as np
import pytest

from bev_preheat.planning.methods import KeptValues, plan_by_values
from bev_preheat.planning.situation import BatteryState, Goal, Uncertainty
from bev_preheat.planning.trip import make_trip
from bev_preheat.route import load_route
from bev_preheat.tunables import VALUES_KEPT_S
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.core_library import core_in_words, without_core
from bev_preheat.vehicle.description import HeatPath
from bev_preheat.vehicle.variants import limited_by_coldest_cell

GOAL = Goal(25.0)
DEVIATION_K = 1.5
SITUATIONS = {
    'from the cold': ('reference', -20.0, HeatPath(), GOAL),
    'at once': ('reference', -7.0, HeatPath(), GOAL), 'over the pass': ('alpine_pass', -10.0, HeatPath(), GOAL),
    'late': ('city_stop_and_go', 5.0, HeatPath(45.0, 16e3, 280.0), GOAL),
    'to the reserve': ('alpine_pass', -10.0, HeatPath(), Goal(25.0, minimum_arrival_soc=0.73))}


class Drive:
    """A drive that is planned on the way, with values kept."""

    def __init__(self, name='at once', soc=0.9):
        route, temperature_c, heat_path, self.goal = SITUATIONS[name]
        self.vehicle = replace(load_vehicle('reference'), heat_path=heat_path)
        self.route = load_route(route, self.vehicle.defaults)
        self.state = BatteryState(temperature_c, soc)
        self.kept = KeptValues()
        self.first = self.plan(self.kept)

    def plan(self, kept=None, passed_s=0.0, state=None, goal=None, deviation_k=DEVIATION_K, is_on=False, **change):
        vehicle, route = change.pop('vehicle', self.vehicle), change.pop('route', self.route).after(passed_s)
        trip = make_trip(vehicle, route, **change)
        share = route.total_duration_s / self.route.total_duration_s
        uncertainty = Uncertainty(share * deviation_k, is_on)
        return plan_by_values(trip, state or self.state, goal or self.goal, uncertainty=uncertainty, kept=kept)


def state_at(schedule, step):
    heat = schedule.heat
    late = () if heat is None else (float(heat.heater_power_w[step]), float(heat.coolant_excess_k[step]))
    return BatteryState(float(schedule.temperature_c[step]), float(schedule.soc[step]), *late)


@pytest.fixture(params=['core', pytest.param('Python', marks=pytest.mark.deep)])
def engine(request):
    if request.param == 'core':
        assert core_in_words().startswith('used: ')
        yield
    else:
        with without_core():
            yield


@pytest.mark.parametrize('name', SITUATIONS)
@pytest.mark.usefixtures('engine')
def test_the_rest_of_a_plan_is_the_plan_of_the_rest(name):
    drive = Drive(name)
    route, first = drive.route, drive.first
    heated = first.heater_power_w > 1.0
    assert heated.any()
    step = int(np.flatnonzero(route.time_s <= VALUES_KEPT_S)[-1])
    assert step > 0
    was_on = bool(heated[step - 1])
    rest = drive.plan(drive.kept, float(route.time_s[step]), state_at(first, step), is_on=was_on)
    ends = int(np.flatnonzero(heated)[-1])
    np.testing.assert_allclose(
        rest.heater_power_w[:ends - step], first.heater_power_w[step:ends], rtol=0.0, atol=1e-6)
    assert rest.temperature_c[-1] == pytest.approx(first.temperature_c[-1], abs=0.01)


@pytest.mark.parametrize('name', SITUATIONS)
@pytest.mark.usefixtures('engine')
def test_values_serve_all_plans_of_a_minute(name):
    drive = Drive(name)
    found = drive.kept.latest
    step = int(np.flatnonzero(drive.route.time_s <= VALUES_KEPT_S)[-1])
    for passed_s, state in ((0.0, drive.state), (float(drive.route.time_s[step]), state_at(drive.first, step))):
        drive.plan(drive.kept, passed_s, state, is_on=bool(drive.first.heater_power_w[0] > 1.0))
        assert drive.kept.latest == found


# Short of the reserve, and of the power for its climb, with heating or without.
SHORT = {'at once': 0.33, 'over the pass': 0.19}


@pytest.mark.parametrize('name', SHORT)
@pytest.mark.usefixtures('engine')
def test_values_serve_a_drive_that_is_short_without_heating(name):
    drive = Drive(name, SHORT[name])
    reserve, (found, *_) = drive.vehicle.battery.soc_range[0], drive.kept.latest
    assert drive.first.soc[-1] < reserve
    for passed_s in (5.0, 35.0):
        state = BatteryState(drive.state.temperature_c + 0.2, drive.state.soc - 1e-3)
        kept, new = drive.plan(drive.kept, passed_s, state), drive.plan(None, passed_s, state)
        assert drive.kept.latest == (found,)
        np.testing.assert_allclose(kept.heater_power_w, new.heater_power_w, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize('soc, later_soc', [(0.9, 0.33), (0.33, 0.9)], ids=['then short', 'short before'])
def test_values_are_not_used_once_the_charge_carries_less_or_more_heat(soc, later_soc):
    drive = Drive(soc=soc)
    state = replace(drive.state, soc=later_soc)
    kept, new = drive.plan(drive.kept, 5.0, state), drive.plan(None, 5.0, state)
    np.testing.assert_array_equal(kept.heater_power_w, new.heater_power_w)
    assert len(drive.kept.latest) == 2 and (kept.heater_power_w > 1.0).any() == (later_soc > soc)


@pytest.mark.parametrize('name', ['at once', *(
    pytest.param(name, marks=pytest.mark.deep) for name in ('over the pass', 'late'))])
def test_core_and_python_follow_kept_values_alike(name):
    passed_s, plans = 37.0, []
    for is_on in (False, True):
        drive = Drive(name)
        colder = replace(drive.state, temperature_c=drive.state.temperature_c - 0.3)
        plans.append(drive.plan(drive.kept, passed_s, colder, is_on=is_on))
        with without_core():
            other = Drive(name)
            plans.append(other.plan(other.kept, passed_s, colder, is_on=is_on))
        np.testing.assert_allclose(plans[-1].heater_power_w, plans[-2].heater_power_w, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize('name', SITUATIONS)
def test_a_plan_from_kept_values_costs_no_more_than_a_new_one(name):
    """A start a step earlier costs energy, a step later risk: where both weigh the same, either may be found."""
    drive, extra_wh = Drive(name), []
    for number in range(8):
        random = np.random.default_rng(number)
        state = replace(drive.state, temperature_c=drive.state.temperature_c + random.uniform(-0.4, 0.4))
        passed_s = random.uniform(0.0, VALUES_KEPT_S)
        kept, new = drive.plan(drive.kept, passed_s, state), drive.plan(None, passed_s, state)
        assert kept.temperature_c[-1] == pytest.approx(new.temperature_c[-1], abs=0.05)
        assert abs(np.argmax(kept.heater_power_w > 1.0) - np.argmax(new.heater_power_w > 1.0)) <= 1
        extra_wh.append((new.soc[-1] - kept.soc[-1]) * drive.vehicle.battery.capacity_ah * 400.0)
    # A whole kelvin costs 100 Wh and more, a step of heating 40 Wh.
    assert np.mean(extra_wh) < 1.0
    assert max(extra_wh) < 8.0


def changes():
    vehicle = load_vehicle('reference')
    route = load_route('reference', vehicle.defaults)
    return {
        'another target': {'goal': Goal(22.0)},
        'another reserve': {'goal': Goal(25.0, minimum_arrival_soc=0.3)},
        'less uncertainty': {'deviation_k': 0.6 * DEVIATION_K},
        'more uncertainty': {'deviation_k': 1.4 * DEVIATION_K},
        'less heater': {'heater_share': 0.6},
        'heat that comes late': {'heat_lag_s': 200.0},
        'more power': {'route': route.with_propulsion(1.3)},
        'a colder cell': {'vehicle': limited_by_coldest_cell(vehicle, 5.0)},
        'another drive': {'route': load_route('winter_commute', vehicle.defaults)},
        'a minute and more': {'passed_s': VALUES_KEPT_S + 5.0},
        'a battery that is much colder': {'state': BatteryState(-11.0, 0.9)},
        'a battery that is much warmer': {'state': BatteryState(-3.0, 0.9)},
    }


@pytest.mark.parametrize('change', changes())
@pytest.mark.usefixtures('engine')
def test_values_that_no_longer_hold_are_not_used(change):
    drive, changed = Drive(), changes()[change]
    kept, new = drive.plan(drive.kept, **changed), drive.plan(None, **changed)
    np.testing.assert_array_equal(kept.heater_power_w, new.heater_power_w)
    np.testing.assert_array_equal(kept.temperature_c, new.temperature_c)
