# SPDX-License-Identifier: Apache-2.0
"""Planning methods of other packages: discovery, the situation, and valid and broken answers."""

import math
import subprocess
import sys
import textwrap
from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st
import installed_packages
import numpy as np
from own_plant import OwnPlant
import pytest
from refusals import problems_of

from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.planning import installed_methods
from bev_preheat.planning.installed_methods import InstalledMethod, limit_answer_time, MethodSituation
from bev_preheat.planning.planner import (
    check_method,
    is_method,
    method_names,
    METHODS,
    plan_preheating,
    plan_unheated,
    refused_methods,
    REPLACED,
)
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.core_library import use_core

VEHICLE = load_vehicle('reference')
ROUTE = load_route('reference', VEHICLE.defaults)
PASS_VEHICLE = load_vehicle('mid_size_lfp')
PASS = load_route('alpine_pass', PASS_VEHICLE.defaults)
STATE, GOAL = BatteryState(-7.0, 0.9), Goal(25.0)


@pytest.fixture
def install(tmp_path, monkeypatch):
    """`install({name: 'module:function'}, source)` puts a package with the module `own` into the path."""
    def install(entries, source='', package='own-methods'):
        folder = tmp_path / package
        folder.mkdir()
        (folder / 'own.py').write_text(textwrap.dedent(source))
        installed_packages.write_metadata(folder, package, entries)
        installed_packages.use_folder(monkeypatch, folder)
    return install


@pytest.fixture
def powers(monkeypatch):
    """Return the holder of the function that the method `given` calls."""
    holder = SimpleNamespace(function=None)
    given = InstalledMethod('given', 'package own-methods 1.0', lambda situation: holder.function(situation))
    monkeypatch.setattr(installed_methods, 'LOADED', {'given': given})
    return holder


def planned(holder, function, goal=GOAL, **options):
    holder.function = function
    return plan_preheating(VEHICLE, ROUTE, STATE, goal, 'given', **options)


# --- names ---


def test_an_installed_method_is_found_loaded_and_named(install):
    install({'half': 'own:half'}, """
        def half(situation):
            return 0.5 * situation.heater_limit_w
    """)
    assert method_names() == (*METHODS, 'half')
    plan = plan_preheating(VEHICLE, ROUTE, STATE, GOAL, 'half')
    assert plan.method == 'half' and is_method('half')
    # 7 kW less the cabin's share, for an hour, halved.
    limit_w = VEHICLE.hvch.maximum_power_w - ROUTE.cabin_heating_power_w
    assert plan.energy_wh.hvch_electric == pytest.approx(0.5 * float(limit_w @ ROUTE.duration_s) / 3600.0)


def test_an_unknown_name_lists_the_installed_ones(install):
    install({'half': 'own:half'})
    with pytest.raises(InvalidInput) as refused:
        plan_preheating(VEHICLE, ROUTE, STATE, GOAL, 'halve')
    assert str(refused.value) == (
        "method: 'halve' is not one of value_function, optimal_switch, paper, half")
    assert not is_method('halve')


@pytest.mark.parametrize('entries, source, problem', [
    ({'half': 'own:half'}, '', "from own:half: AttributeError: module 'own' has no attribute 'half'"),
    ({'half': 'own:half'}, 'import no_such_package', 'cannot be loaded from own:half: ModuleNotFoundError'),
    ({'half': 'own:half'}, 'raise SystemExit(3)', 'cannot be loaded from own:half: SystemExit: 3'),
    ({'half': 'own:half'}, 'half = 0.5', 'own:half is float; it must be a function of a MethodSituation'),
])
def test_a_method_that_cannot_be_loaded_is_refused_with_its_package(install, entries, source, problem):
    install(entries, source)
    told, = problems_of(check_method, 'half')
    assert told.startswith('method: half of package own-methods 1.0') and problem in told


@pytest.mark.parametrize('name', ['paper', 'value_function', 'merit_order', 'nlp', 'optimum', 'replanned_paper'])
def test_a_name_that_is_built_in_stays_built_in(install, name):
    install({name: 'own:evil'}, 'raise RuntimeError("must not be loaded")')
    assert method_names() == tuple(METHODS)
    assert refused_methods() == (f'{name} of package own-methods 1.0 is not used, because the name is built in',)
    if name in (*METHODS, *REPLACED):
        assert plan_preheating(VEHICLE, ROUTE, STATE, GOAL, name).method == REPLACED.get(name, name)
    else:
        with pytest.raises(InvalidInput, match=f'method: {name} of package own-methods 1.0 is not used'):
            check_method(name)


@pytest.mark.parametrize('name', ['Half', 'half-power', 'half, driven', '7kw', 'h' * 41])
def test_names_that_tables_and_parameters_cannot_show_are_refused(install, name):
    install({name: 'own:half'})
    assert method_names() == tuple(METHODS)
    assert 'a name must be lower-case letters, digits and underscores' in refused_methods()[0]


def test_two_packages_with_one_name_are_both_refused(install):
    install({'half': 'own:half'}, package='first')
    install({'half': 'own:half'}, package='second')
    told, = problems_of(check_method, 'half')
    assert {*told.replace(';', '').split()} >= {'first', 'second', 'uninstall'}


def test_a_built_in_method_reads_no_entry_points():
    done = subprocess.run(
        [sys.executable, '-c', 'import sys; from bev_preheat.planning.planner import check_method, is_method; '
         'check_method("paper"); print("importlib.metadata" in sys.modules)'],
        capture_output=True, text=True, check=True)
    assert done.stdout.strip() == 'False'


# --- the situation ---


def test_the_situation_is_the_trip_and_cannot_be_changed(powers):
    seen = []

    def see(situation):
        seen.append(situation)
        return np.zeros(len(situation.route))

    planned(powers, see, heater_share=0.5)
    situation = seen[0]
    assert (situation.vehicle, situation.state, situation.goal) == (VEHICLE, STATE, GOAL)
    assert situation.time_s[0] == 0.0 and situation.time_s[-1] == ROUTE.total_duration_s
    np.testing.assert_allclose(
        situation.heater_limit_w, 0.5 * (VEHICLE.hvch.maximum_power_w - ROUTE.cabin_heating_power_w))
    for values in (situation.time_s, situation.heater_limit_w, situation.route.duration_s,
                   situation.route.propulsion_power_w, situation.route.time_s):
        with pytest.raises(ValueError, match='read-only'):
            values[0] = 1.0
    with pytest.raises(AttributeError):
        situation.goal = Goal(40.0)


def test_full_power_between_two_instants(powers):
    trip = make_trip(VEHICLE, ROUTE)
    situation = MethodSituation.of_trip(trip, STATE, GOAL)
    energy_j = float(situation.full_power(100.0, 1000.0) @ ROUTE.duration_s)
    limits_w = VEHICLE.hvch.maximum_power_w - ROUTE.cabin_heating_power_w
    assert energy_j == pytest.approx(900.0 * float(limits_w[0]))
    assert not situation.full_power(1000.0, 100.0).any()
    np.testing.assert_array_equal(situation.full_power(), situation.heater_limit_w)


def test_the_prediction_is_the_plan(powers):
    seen = []

    def predict(situation):
        power_w = situation.full_power(1800.0)
        seen.append(situation.predict(power_w))
        return power_w

    plan = planned(powers, predict)
    assert seen[0].arrival_temperature_c == plan.arrival_temperature_c
    assert seen[0].arrival_soc == plan.arrival_soc
    assert seen[0].battery_energy_wh == pytest.approx(plan.energy_wh.battery_total, rel=1e-12)


# --- answers ---


def constant(value):
    return lambda situation: np.full(len(situation.route), value)


def raising(error):
    def method(situation):
        raise error
    return method


@pytest.mark.parametrize('function, problem', [
    (raising(KeyError('minutes')), "raised KeyError: 'minutes'"),
    (raising(SystemExit(2)), 'raised SystemExit: 2'),
    (lambda situation: situation.predict([1.0]), 'raised ValueError: shape (1,) is not allowed'),
    (lambda situation: situation.heater_limit_w.sort(), 'raised ValueError: '),
    (constant(math.nan), 'answer is refused: nan W in step 0 is not allowed; it must be finite and at least 0 W'),
    (constant(math.inf), 'inf W in step 0 is not allowed'),
    (constant(-500.0), '-500 W in step 0 is not allowed; it must be finite and at least 0 W (and 119 more)'),
    (lambda situation: [5000.0], 'shape (1,) is not allowed; it must be (120,), a power in W for each step'),
    (lambda situation: 5000.0, 'shape () is not allowed'),
    (lambda situation: None, 'NoneType of object is not allowed; it must be an array of powers in W'),
    (lambda situation: ['5000'] * 120, 'list of <U4 is not allowed'),
    (lambda situation: np.ones(120, dtype=bool), 'ndarray of bool is not allowed'),
    (lambda situation: [[1.0], [1.0, 2.0]], 'the answer is refused: '),
])
def test_a_broken_answer_is_refused_with_method_package_and_reason(powers, function, problem):
    with pytest.raises(PlanningFailure, match='^method given of package own-methods 1.0: ') as refused:
        planned(powers, function)
    assert problem in str(refused.value)


def test_powers_above_the_heaters_are_clipped_and_the_sentence_says_so(powers):
    plan = planned(powers, constant(1e5))
    limit_w = VEHICLE.hvch.maximum_power_w - ROUTE.cabin_heating_power_w
    assert (plan.hvch_battery_power_w <= limit_w).all()
    assert plan.explanation.endswith(
        f'Method given asked for 100000 W where the heater has {limit_w[0]:.0f} W for the battery; '
        'its powers are clipped.')
    assert 'clipped' not in planned(powers, lambda situation: situation.heater_limit_w + 0.5).explanation
    assert planned(powers, constant(-0.5)).heating_start_s is None


def test_a_late_answer_is_refused_and_the_method_rests(powers, monkeypatch):
    clock = SimpleNamespace(now_s=100.0, asked=0)
    monkeypatch.setattr(installed_methods, 'perf_counter', lambda: clock.now_s)
    monkeypatch.setattr(InstalledMethod, 'answer_limit_s', math.inf)
    limit_answer_time(0.15)

    def slow(situation):
        clock.asked += 1
        clock.now_s += 0.3 if clock.asked == 1 else 0.1
        return np.zeros(len(situation.route))

    with pytest.raises(PlanningFailure, match=r'took 0.30 s; at most 0.15 s are allowed'):
        planned(powers, slow)
    clock.now_s += 2.9
    with pytest.raises(PlanningFailure, match=r'took 0.30 s'):
        planned(powers, slow)
    assert clock.asked == 1
    clock.now_s += 0.2
    assert planned(powers, slow).heating_start_s is None


# --- the same checks as for built-in methods ---


@pytest.mark.parametrize('goal, status', [
    (Goal(25.0, charging_planned=False), Status.NO_CHARGING_PLANNED),
    (Goal(25.0, heating_pays=False), Status.NOT_WORTH_IT)])
def test_a_method_is_not_asked_if_the_goal_needs_no_heat(powers, goal, status):
    plan = planned(powers, raising(AssertionError('asked')), goal=goal)
    assert plan.status is status and plan.heating_start_s is None


PLANTS = {'reference': OwnPlant('reference'), 'mid_size_lfp': OwnPlant('mid_size_lfp')}
DRAWN_POWERS = st.lists(st.floats(0.0, 30e3), min_size=1, max_size=12)


@given(pattern=DRAWN_POWERS, temperature_c=st.floats(-15.0, 40.0), soc=st.floats(0.15, 1.0),
       reserve=st.floats(0.0, 0.6), on_pass=st.booleans(), has_core=st.booleans())
def test_whatever_powers_come_the_plan_keeps_limits_and_the_balance(
        pattern, temperature_c, soc, reserve, on_pass, has_core):
    vehicle, route = (PASS_VEHICLE, PASS) if on_pass else (VEHICLE, ROUTE)
    state, goal = BatteryState(temperature_c, soc), Goal(25.0, reserve)
    installed = InstalledMethod('drawn', 'a test', lambda situation: np.resize(pattern, len(situation.route)))
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(installed_methods, 'LOADED', {'drawn': installed})
        use_core(has_core)
        try:
            plan = plan_preheating(vehicle, route, state, goal, 'drawn')
            unheated = plan_unheated(vehicle, route, state, goal)
        finally:
            use_core(True)
    power_w = plan.hvch_battery_power_w
    assert (power_w >= 0.0).all()
    assert (power_w <= np.maximum(vehicle.hvch.maximum_power_w - route.cabin_heating_power_w, 0.0) + 1e-6).all()
    # Heat and charge balance of the energies, independent of the steps.
    energy_wh, battery = plan.energy_wh, vehicle.battery
    stored_wh = battery.heat_capacity_j_per_k * (plan.arrival_temperature_c - temperature_c) / 3600.0
    assert stored_wh == pytest.approx(
        energy_wh.joule + energy_wh.drivetrain_heat + energy_wh.hvch_heat + energy_wh.leakage, abs=0.01)
    assert energy_wh.hvch_heat == pytest.approx(vehicle.hvch.efficiency * energy_wh.hvch_electric, rel=1e-9)
    # No worse than not heating.
    if plan.stranding is not None or unheated.stranding is not None:
        assert unheated.stranding is not None
        assert plan.stranding.at_s >= unheated.stranding.at_s - 1.0
        return
    assert plan.arrival_soc >= min(max(reserve, battery.soc_range[0]), unheated.arrival_soc) - 1e-6
    assert plan.undeliverable_power_w <= unheated.undeliverable_power_w + 10.0
    hottest_c = max(battery.temperature_range_c[1], unheated.battery_temperature_c.max())
    assert plan.battery_temperature_c.max() <= hottest_c + 0.01
    # The second implementation, which knows neither limits nor plan, finds the same arrival and no new deficit.
    driven = PLANTS[vehicle.name].drive(route, state, power_w)
    idle = PLANTS[vehicle.name].drive(route, state, np.zeros(len(route)))
    assert driven.temperature_c == pytest.approx(plan.arrival_temperature_c, abs=0.15)
    assert driven.deficit_w <= max(idle.deficit_w, 0.0) + 150.0
