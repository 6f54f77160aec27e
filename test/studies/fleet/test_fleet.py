# SPDX-License-Identifier: Apache-2.0
"""A fleet: its sessions agree with `charge`, its ways with their definition, its blocks with every executor."""

from dataclasses import fields, replace
import json

import numpy as np
import pytest
from run_here import Here

from bev_preheat.charging.session import charge
from bev_preheat.commands.main import main
from bev_preheat.console.program import Interrupted
from bev_preheat.native.library import without_core
from bev_preheat.numerics.folded_normal import mean_magnitude
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState
from bev_preheat_studies.fleet import charging_times, fleet_study
from bev_preheat_studies.fleet.charging_times import ChargingTimes, sessions, stop_of
from bev_preheat_studies.fleet.drawing import draw_fleet
from bev_preheat_studies.fleet.drawn_fleet import AMBIENT_MEAN_C, CARS, vehicle_of
from bev_preheat_studies.fleet.fleet_study import kept_fleet, run_fleet, tally_of, TripBlock
from bev_preheat_studies.fleet.tally import HEATER_WH, MORE_WH, QUANTITIES, REACHED, SAVED_S, Tally
from bev_preheat_studies.fleet.ways import ALWAYS, arrivals_of, NONE, WAYS

pytestmark = pytest.mark.costly


# Sessions

@pytest.mark.parametrize('car, charger_w, ambient_c, temperature_c, soc', [
    # Heated at the charger up to its limit, and beyond it; not heated; a weak charger; LFP in the cold.
    ('reference', 150e3, -8.0, -3.0, 0.12), ('reference', 300e3, 3.0, 31.0, 0.07),
    ('small_car', 150e3, -3.0, 6.0, 0.22), ('large_suv', 50e3, 1.0, 9.0, 0.15),
    ('mid_size_lfp', 150e3, -12.0, -10.0, 0.2)])
def test_a_session_in_arrays_is_that_of_charge(car, charger_w, ambient_c, temperature_c, soc):
    vehicle = vehicle_of(car)
    session = charge(vehicle, stop_of(vehicle, charger_w, ambient_c), BatteryState(temperature_c, soc))
    time_s, bought_wh = sessions(vehicle, charger_w, *(
        np.array([value]) for value in (ambient_c, temperature_c, soc)))
    assert time_s[0] == pytest.approx(session.charging_time_s, rel=0.002)
    assert bought_wh[0] == pytest.approx(session.bought_energy_wh, rel=0.001)


@pytest.fixture(scope='module')
def times():
    """The table of a car at a charger."""
    return ChargingTimes(vehicle_of('small_hatchback'), 150e3)


@pytest.mark.deep
def test_between_the_points_of_the_table_times_are_those_of_sessions(times):
    random = np.random.default_rng(4)
    ambient_c = random.normal(1.4, 5.5, 200)
    temperature_c, soc = ambient_c + random.uniform(0.0, 25.0, 200), random.uniform(0.03, 0.33, 200)
    exact_s, exact_wh = sessions(vehicle_of('small_hatchback'), 150e3, ambient_c, temperature_c, soc)
    found_s, found_wh = times.of(ambient_c, temperature_c, soc)
    # A tenth of a minute, 50 Wh; on average a fifth of that.
    assert np.abs(found_s - exact_s).max() < 10.0 and np.abs(found_s - exact_s).mean() < 2.0
    assert np.abs(found_wh - exact_wh).max() < 80.0 and np.abs(found_wh - exact_wh).mean() < 10.0


def test_a_battery_that_takes_nothing_is_never_charged():
    time_s, bought_wh = sessions(vehicle_of('small_car'), 150e3, *(
        np.array([value]) for value in (-25.0, -25.0, 0.2)))
    assert np.isinf(time_s[0]) and np.isinf(bought_wh[0])


# Trips

def of_number(trips, number):
    """Return the trip of a number."""
    return trips.trip(trips.number.tolist().index(number))


def test_a_trip_is_drawn_from_its_number():
    few, more = draw_fleet(3, 1, 10), draw_fleet(3, 1, 30)
    assert sorted(few.number.tolist()) == list(range(4000, 4010))
    for number in few.number.tolist():
        first, second = of_number(few, number), of_number(more, number)
        assert (first.state, first.car, first.charger_w) == (second.state, second.car, second.charger_w)
        assert all((getattr(first.route, field.name) == getattr(second.route, field.name)).all()
                   for field in fields(first.route))
    assert of_number(draw_fleet(4, 1, 10), 4003).state != of_number(few, 4003).state
    assert of_number(draw_fleet(3, 0, 10), 3).state != of_number(few, 4003).state


def test_drawn_trips_are_as_they_are_said_to_be():
    trips = draw_fleet(1, 0)
    assert {car for car, _ in trips.cars()} == set(CARS) and len(list(trips.plugs())) == 15
    # Five standard errors.
    assert trips.ambient_c.mean() == pytest.approx(AMBIENT_MEAN_C, abs=5.0 * 5.5 / 4000**0.5)
    assert np.median(trips.length_min) == pytest.approx(55.0, abs=2.0)
    assert trips.length_min.min() >= 12.0 and trips.length_min.max() <= 150.0
    route = trips.trip(7).route
    assert route.propulsion_power_magnitude_w == pytest.approx(
        mean_magnitude(route.propulsion_power_w, route.propulsion_power_variance_w2), rel=1e-12)
    unheated = [plan_preheating(vehicle_of(trip.car), trip.route, trip.state,
                                replace(trip.goal, charging_planned=False))
                for trip in map(trips.trip, range(0, 4000, 140))]
    assert all(0.04 < plan.arrival_soc < 0.36 for plan in unheated)


@pytest.fixture(scope='module')
def cold_trip():
    """A trip of a cold car, and its arrivals."""
    trips = draw_fleet(1, 0)
    trip = next(trip for trip in map(trips.trip, range(100))
                if trip.car == 'reference' and trip.state.temperature_c < 2.0 and 40.0 < trip.length_min < 80.0)
    return trip, arrivals_of(trip, vehicle_of(trip.car))


def test_always_on_holds_the_target_and_takes_most(cold_trip):
    trip, arrivals = cold_trip
    target_c = trip.goal.target_temperature_c
    assert arrivals[NONE].heater_wh == 0.0 and arrivals[NONE].temperature_c < target_c - 3.0
    # A step without heat cools it by less than a kelvin; the drive itself may warm it further.
    assert arrivals[ALWAYS].temperature_c > target_c - 1.0
    assert arrivals[ALWAYS].heater_wh > 1.1 * arrivals['value_function'].heater_wh > 0.0


def test_each_method_reaches_the_target_as_driven(cold_trip):
    trip, arrivals = cold_trip
    assert set(arrivals) == set(WAYS)
    for method in ('optimal_switch', 'value_function'):
        assert arrivals[method].temperature_c == pytest.approx(trip.goal.target_temperature_c, abs=0.01)
    assert arrivals['paper'].temperature_c == pytest.approx(trip.goal.target_temperature_c, abs=0.5)


# Blocks

@pytest.fixture
def quick_tables(monkeypatch):
    """A charger at which each kelvin below 25 degC costs 10 s, each percent of charge 20 s."""
    class Times:
        def of(self, ambient_c, temperature_c, soc):
            time_s = 10.0 * np.maximum(25.0 - temperature_c, 0.0) + 2000.0 * (0.8 - soc)
            return time_s, 50e3 * (0.8 - soc)

    monkeypatch.setattr(fleet_study, 'charging_times_of', lambda car, charger_w: Times())


def test_a_fleet_is_counted_trip_by_trip(quick_tables):
    trips = draw_fleet(2, 0, 12)
    tally = tally_of(trips)
    assert tally.trips['all'] + tally.left_out.total() == 12
    expected = {quantity: [] for quantity in (HEATER_WH, SAVED_S, MORE_WH, REACHED)}
    for trip in map(trips.trip, range(12)):
        ends = arrivals_of(trip, vehicle_of(trip.car))
        end, cold = ends['value_function'], ends[NONE]
        expected[HEATER_WH].append(end.heater_wh)
        expected[MORE_WH].append(50e3 * (cold.soc - end.soc))
        expected[SAVED_S].append(10.0 * (max(25.0 - cold.temperature_c, 0.0) - max(25.0 - end.temperature_c, 0.0))
                                 - 2000.0 * (cold.soc - end.soc))
        expected[REACHED].append(end.temperature_c > trip.goal.target_temperature_c - 0.2)
    for quantity, values in expected.items():
        assert tally.mean('value_function', 'all', quantity) == pytest.approx(np.mean(values), abs=1e-3)


# test/native compares plans of core and Python daily.
@pytest.mark.deep
def test_without_the_core_the_table_is_the_same(quick_tables):
    trips = draw_fleet(5, 0, 8)
    with without_core():
        slow = tally_of(trips)
    assert slow == tally_of(trips)


@pytest.fixture
def made_blocks(monkeypatch):
    """Trips that cost nothing: each counts its number. Gives the numbers of the trips that were counted."""
    ran = []

    def tally_of(numbers, tables=None):
        tally = Tally()
        ran.extend(numbers)
        tally.count([('all', 'car', 'a', 'l', 'a, l')] * len(numbers), WAYS, np.tile(
            np.array(numbers, dtype=float)[:, np.newaxis, np.newaxis], (1, len(WAYS), len(QUANTITIES))))
        return tally

    monkeypatch.setattr(fleet_study, 'draw_fleet',
                        lambda seed, number, size: list(range(10 * number, 10 * number + size)))
    monkeypatch.setattr(fleet_study, 'tally_of', tally_of)
    # Seconds in all.
    monkeypatch.setattr(fleet_study, 'charging_times_of', lambda *plug: plug)
    monkeypatch.setattr(fleet_study, 'BLOCK', 10)
    # Pickling refers to the module's object.
    monkeypatch.setattr('bev_preheat_studies.numbered.Shipped', lambda task: task)
    return ran


def test_each_trip_is_in_one_block(made_blocks):
    blocks = []
    run_fleet(37, 1, Here(2), blocks.append)
    assert made_blocks == list(range(37))
    assert [(block.number, block.size) for block in blocks] == [(0, 10), (1, 10), (2, 10), (3, 7)]


@pytest.mark.parametrize('trips, made', [(11, fleet_study.PLUGS), (10, ())])
def test_tables_of_a_fleet_are_made_once(made_blocks, monkeypatch, trips, made):
    """For all blocks; one alone makes those that it needs."""
    seen = []
    monkeypatch.setattr(fleet_study, 'tally_of', lambda numbers, tables: seen.append(tables) or Tally())
    run_fleet(trips, 1, Here(2), lambda block: None)
    assert seen == [{plug: plug for plug in made}] * -(-trips // 10)


def run_kept(path, trips):
    """Run a fleet with a results file, and return its Tally."""
    with kept_fleet(path, {'study': 'made'}, trips) as kept:
        whole = kept.tally
        blocks = []
        run_fleet(trips, 1, Here(2), blocks.append, kept.finished, kept.keep)
        for block in blocks:
            whole = whole.with_other(block.tally)
    return whole


def test_a_larger_fleet_goes_on_from_a_smaller_one(made_blocks, tmp_path):
    path = tmp_path / 'fleet.jsonl'
    first = run_kept(path, 25)
    made_blocks.clear()
    whole = run_kept(path, 45)
    # The last block of the smaller one was not complete.
    assert made_blocks == list(range(20, 45))
    assert whole.counted == whole.trips['all'] == 45
    assert whole.mean('paper', 'all', 'saved_s') == 22.0
    made_blocks.clear()
    assert (run_kept(path, 25), run_kept(path, 45), made_blocks) == (first, whole, [])


# The command

@pytest.fixture
def quick_command(made_blocks, monkeypatch):
    monkeypatch.setattr('bev_preheat_studies.commands.sweep_fleet.study_executor', lambda arguments: Here(2))
    return made_blocks


def test_the_command_prints_writes_draws_and_goes_on(quick_command, tmp_path, capsys):
    results, path, picture = (tmp_path / name for name in ('r.jsonl', 'r.json', 'r.png'))
    command = ['sweep', '--fleet', '25', '--seed', '4', '--results', str(results), '--json', str(path)]
    assert main([*command, '--plot', str(picture)]) == 0
    out = capsys.readouterr().out
    assert '25 trips' in out and 'always_on' in out and 'By air temperature' in out
    written = json.loads(path.read_text())
    assert (written['fleet'], written['seed'], written['complete']) == (25, 4, True)
    figures = written['summary']['groups']['all']['ways']['value_function']
    assert figures['saved_min']['mean'] == pytest.approx(12.0 / 60.0)
    from matplotlib.image import imread
    assert imread(picture).std() > 0.02
    quick_command.clear()
    assert main(command) == 0
    assert (quick_command, capsys.readouterr().out) == ([], out)
    assert main([*command, '--seed', '5']) == 2
    assert 'holds another study: seed is 4 in the file, 5 here' in capsys.readouterr().err


def test_an_interrupted_fleet_keeps_what_is_finished(quick_command, tmp_path, capsys, monkeypatch):
    def run(trips, seed, executor, report, finished, keep):
        block = TripBlock(0, 10, fleet_study.tally_of(list(range(10))))
        keep(0, block)
        report(block)
        raise Interrupted

    monkeypatch.setattr(fleet_study, 'run_fleet', run)
    results = tmp_path / 'r.jsonl'
    assert main(['sweep', '--fleet', '35', '--results', str(results)]) == 130
    out, err = capsys.readouterr()
    assert err == ('preheat: interrupted after 10 of 35 trips; the summary covers finished results only; the same '
                   f'command continues from {results}\n')
    assert 'part of the study has run, 10 of 35 trips' in ' '.join(out.split())


def test_a_fleet_that_is_interrupted_at_once_says_where_it_goes_on(quick_command, tmp_path, capsys, monkeypatch):
    def run(trips, seed, executor, report, finished, keep):
        raise Interrupted

    monkeypatch.setattr(fleet_study, 'run_fleet', run)
    results = tmp_path / 'r.jsonl'
    assert main(['sweep', '--fleet', '35', '--results', str(results)]) == 130
    assert capsys.readouterr() == ('', 'preheat: interrupted after 0 of 35 trips; no results yet; '
                                       f'the same command continues from {results}\n')


@pytest.mark.parametrize('extra, message', [
    (['--fleet', '0'], '--fleet: 0 is not allowed; it must be 1 ... 100000000'),
    (['--fleet', '9', '--trips', 'free'],
     '--trips does not go with --fleet, which draws cars and trips of its own'),
    (['--fleet', '9', '--vehicle', 'reference'], '--vehicle does not go with --fleet')])
def test_a_fleet_refuses_in_one_line(extra, message, capsys):
    assert main(['sweep', *extra]) == 2
    assert capsys.readouterr().err.startswith(f'preheat: error: {message}')


def test_grids_cover_what_is_drawn():
    assert charging_times.SOC_GRID[-1] >= 0.35 and charging_times.TEMPERATURE_GRID_C[0] <= -25.0
