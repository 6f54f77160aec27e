# SPDX-License-Identifier: Apache-2.0
"""Cars that differ from their file: how they are drawn, their drives and scores, and the requirements on them."""

from dataclasses import asdict, replace
import json

import numpy as np
import pytest

from bev_preheat.control.decision import Command
from bev_preheat.control.settings import Settings
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route import make_route
from bev_preheat.simulation.heater import NO_LEASE
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections, Mismatch
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.scenario_drive import DriveRecord
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import DIRECT
from bev_preheat_studies.robustness.cars import CarResult, summarise_drives
from bev_preheat_studies.robustness.drawn_cars import Conditions, draw_car, FAULTS
from bev_preheat_studies.robustness.driven import drive_informed, drive_with_planner, DriveOutcome, fault_times
from bev_preheat_studies.robustness.figure import make_robustness_figure

VEHICLE = load_vehicle('reference')
STEPS = 16
# Eight minutes at 17 kW, from 15 to 18 deg C: the battery can be warmed, and no two figures are equal.
CONDITIONS = Conditions(VEHICLE, (make_route({
    'duration_s': np.full(STEPS, 30.0), 'speed_mps': np.full(STEPS, 21.0),
    'propulsion_power_w': np.full(STEPS, 17e3), 'propulsion_power_rms_w': np.full(STEPS, 19e3),
    'ambient_temperature_c': np.full(STEPS, 3.0), 'cabin_heating_power_w': np.full(STEPS, 1500.0),
    'auxiliary_power_w': np.full(STEPS, 400.0)}, VEHICLE.defaults),),
    BatteryState(15.0, 0.8), Goal(18.0), period_s=2.0, plant='ripple')
EVERY_TWO_SECONDS = replace(Settings(), command_period_s=2.0)


# --- Draws ---

SPREAD = {'heat_capacity': 0.1, 'leakage': 0.2, 'resistance': 0.2, 'heater': 0.05,
          'propulsion_power': 0.1}


def test_same_seed_and_number_draw_the_same_car():
    first, second = (draw_car(CONDITIONS, 4, 9) for _ in range(2))
    assert first.mismatch == second.mismatch
    cars = first.car(), second.car()
    for car in cars:
        car.plant.advance(60.0, 2000.0)
    assert cars[0].plant.temperature_c == cars[1].plant.temperature_c
    assert cars[0].readings() == cars[1].readings()


def test_a_drawn_shell_takes_its_share_of_the_heat_capacity_and_the_arrival_is_the_mean():
    trips = [draw_car(replace(CONDITIONS, plant='shell'), 1, number) for number in range(200)]
    whole = np.array([draw_car(CONDITIONS, 1, number).mismatch.heat_capacity for number in range(200)]) * (
        VEHICLE.battery.heat_capacity_j_per_k)
    shares, shells = (np.array([getattr(trip.heat_path, name) for trip in trips])
                      for name in ('shell_share', 'coolant_heat_capacity_j_per_k'))
    assert shells == pytest.approx(shares * whole)
    assert [trip.mismatch.heat_capacity for trip in trips] == pytest.approx(
        (1.0 - shares) * whole / VEHICLE.battery.heat_capacity_j_per_k)
    assert 80 < sum(trip.heat_path.sensor_rise == 0.0 for trip in trips) < 120
    car = trips[0].car()
    outcome = drive_with_planner(car, CONDITIONS.goal, EVERY_TWO_SECONDS)
    mean_c = (1.0 - shares[0]) * car.plant.temperature_c + shares[0] * car.plant.coolant_c
    assert mean_c > car.plant.temperature_c + 0.02
    assert outcome.arrival_error_k == pytest.approx(mean_c - 18.0, abs=1e-6)
    # The trip takes 8 min.
    assert [lead_s for lead_s, _, _ in outcome.predictions] == [300.0, 120.0]
    assert all(deviation_k > 0.0 and abs(error_k) < 4.0 * deviation_k
               for _, error_k, deviation_k in outcome.predictions)


@pytest.fixture(scope='module')
def mismatches():
    return [draw_car(CONDITIONS, 1, number).mismatch for number in range(2000)]


@pytest.mark.parametrize('name', SPREAD)
def test_factors_are_drawn_evenly_within_their_spread(mismatches, name):
    factors = [getattr(mismatch, name) for mismatch in mismatches]
    shares = np.sort((np.array(factors) - 1.0) / SPREAD[name] / 2.0 + 0.5)
    assert 0.0 <= shares[0] and shares[-1] <= 1.0
    # Kolmogorov-Smirnov: a uniform distribution is further off in 1 of 10 000 cases.
    assert np.abs(shares - (np.arange(2000) + 0.5) / 2000).max() < 2.23 / np.sqrt(2000)


@pytest.mark.parametrize('tells', [False, True])
def test_the_position_is_said_where_it_is_asked_for(tells):
    car = draw_car(replace(CONDITIONS, tells_position=tells, traffic=0.2), 1, 2).car()
    car.mission(0)
    assert (car.progress(0) is not None) is tells
    # The trip planner sends no updates.
    car.advance_under(NO_LEASE, 30.0)
    assert car.route_news(0) is None


# --- Drives ---

@pytest.mark.costly
def test_a_perfect_car_arrives_at_its_target_and_its_energies_add_up():
    car = ImperfectCar(VEHICLE, DrivePhase(CONDITIONS.routes[0], CONDITIONS.goal), CONDITIONS.state,
                       Imperfections(sensors=Sensors(period_s=CONDITIONS.period_s)), seed=1)
    drive = drive_with_planner(car, CONDITIONS.goal, EVERY_TWO_SECONDS)
    # The estimating planner adds a margin for the uncertainty.
    assert -0.1 < drive.arrival_error_k < 0.3
    assert (drive.refused, drive.ran_empty, drive.verdicts) == (False, False, ())
    driving_wh = (17e3 + 1500.0 + 400.0) * 480.0 / 3600.0
    # The rest is Joule heat: some 20 kW at 400 V and 4.3125 / 60 ohm, and the rms of the power.
    joule_wh = ((19e3 + 1900.0) / 430.0)**2 * 4.3125 / 61.0 * 480.0 / 3600.0
    assert drive.battery_energy_wh == pytest.approx(driving_wh + drive.heating_energy_wh + joule_wh, rel=0.01)


@pytest.mark.needs('casadi')
def test_the_informed_drive_is_the_optimum_of_the_true_car():
    from bev_preheat.nonlinear_program.solve import solve_optimum
    car = draw_car(CONDITIONS, 11, 0).car()
    optimum = solve_optimum(car.plant.vehicle, car.plant.route, CONDITIONS.state, CONDITIONS.goal, True).plan
    drive = drive_informed(car, CONDITIONS.goal)
    assert drive.arrival_error_k == pytest.approx(0.0, abs=0.01)
    assert drive.heating_energy_wh == pytest.approx(optimum.energy_wh.hvch_electric, rel=2e-3)
    assert drive.battery_energy_wh == pytest.approx(optimum.energy_wh.battery_total, rel=1e-3)
    assert drive.switch_ons == 1


# --- Heaters that fail ---


@pytest.mark.parametrize('fault, commands, found_at_s, drives_s, shown_s, found_s', [
    # It fails at 50 s, is first asked for heat at 100 s, and is found 30 s later, 20 s of them with a command.
    ('dead', [(0.0, 0.0), (100.0, 5e3), (110.0, 0.0), (120.0, 5e3)], 130.0, [(0.0, 200.0)], 20.0, 30.0),
    ('dead', [(0.0, 5e3), (40.0, 0.0)], None, [(0.0, 200.0)], None, None),
    # It shows from the fault at 50 s to the end, except while it heats on command.
    ('stuck_on', [(0.0, 0.0), (60.0, 5e3), (80.0, 0.0)], None, [(0.0, 100.0)], 30.0, None),
    # Only driving time counts: 10 s of the first drive, 20 s of the second.
    ('dead', [(0.0, 0.0), (90.0, 5e3), (100.0, 0.0), (500.0, 5e3)], 520.0, [(0.0, 100.0), (500.0, 600.0)],
     30.0, 30.0)])
def test_how_long_a_fault_showed(fault, commands, found_at_s, drives_s, shown_s, found_s):
    verdicts = [(0.0, 'answers')] + [(at_s, 'dead') for at_s in [found_at_s] if at_s is not None]
    record = DriveRecord(25.0, [(*command, 'HEATING') for command in commands], heater_verdicts=verdicts,
                         by_source=[Command(power_w, 0, Status.HEATING) for _, power_w in commands])
    assert fault_times(record, [replace(FAULTS[fault], from_s=50.0)], drives_s) == (shown_s, found_s)
    assert fault_times(record, [], drives_s) == (None, None)


# --- Figures and requirements ---

def made_drive(**changes):
    return DriveOutcome(**{
        'arrival_error_k': 0.1, 'heating_energy_wh': 200.0, 'battery_energy_wh': 2000.0, 'switch_ons': 1,
        **changes})


def made_result(number, informed=None, **methods):
    """Return a CarResult of made-up drives."""
    return CarResult(number, Mismatch(), DIRECT, informed or made_drive(), methods)


@pytest.fixture
def results():
    """41 trips with figures from everywhere."""
    random = np.random.default_rng(2)
    return [made_result(
        number,
        made_drive(heating_energy_wh=random.uniform(100.0, 300.0), arrival_error_k=0.002,
                   battery_energy_wh=random.uniform(1500.0, 3000.0)),
        one=made_drive(arrival_error_k=random.uniform(-1.0, 2.0), heating_energy_wh=random.uniform(100.0, 320.0),
                       battery_energy_wh=random.uniform(1500.0, 3100.0), switch_ons=int(random.integers(0, 9)),
                       refused=number % 2 == 1, ran_empty=number % 10 == 0)) for number in range(41)]


@pytest.mark.parametrize('key, field', [('heating_excess', 'heating_energy_wh'),
                                        ('battery_excess', 'battery_energy_wh')])
def test_summary_of_energies(results, key, field):
    figures = summarise_drives(results, ['one'])
    own = np.array([getattr(result.methods['one'], field) for result in results])
    best = np.array([getattr(result.informed, field) for result in results])
    # Arrivals more than 0.2 K below the target, or with an empty battery, save nothing.
    alike = np.array([result.methods['one'].arrival_error_k >= -0.2
                      and not result.methods['one'].ran_empty for result in results])
    assert 20 < alike.sum() < 41
    assert figures['one'][key] == pytest.approx({
        'trips': alike.sum(), 'mean': own[alike].sum() / best[alike].sum() - 1.0,
        '95 %': np.quantile(own[alike] / best[alike] - 1.0, 0.95)})


@pytest.mark.costly
def test_the_figure_compares_the_energies_of_trips_that_end_as_warm():
    results = [made_result(number, planner=made_drive(heating_energy_wh=204.0), replanned_paper=made_drive(
        arrival_error_k=-2.0, switch_ons=12)) for number in range(3)]
    figure = make_robustness_figure(results, ['replanned_paper', 'planner'])
    figure.draw_without_rendering()
    means = {line.get_label(): line.get_xdata()[0] for line in figure.axes[1].get_lines()}
    assert means['planner: mean'] == pytest.approx(2.0)
    assert 'published heuristic, re-planned: mean' not in means


# --- The command ---

@pytest.fixture
def arguments(tmp_path):
    """The short trip as command line arguments."""
    route = asdict(CONDITIONS.routes[0])
    file = tmp_path / 'short.csv'
    rows = [','.join(route), *(','.join(map(str, row)) for row in zip(*route.values()))]
    file.write_text('\n'.join(rows) + '\n')
    return ['robustness', '--route', str(file), '--temperature', '15', '--soc', '0.8', '--target', '18',
            '--period', '10', '--seed', '7', '--jobs', '1']


@pytest.mark.costly
@pytest.mark.parametrize('kind, printed', [
    ([], 'Measured temperature: noise 0.2 K'),
    (['--days'], 'healthy heaters reported as faulty'), (['--signals'], 'current reversed')])
def test_the_command_prints_and_writes_and_resumes(arguments, tmp_path, said, monkeypatch, kind, printed):
    from bev_preheat_studies.robustness import signals
    for name in set(signals.CASES) - {'current reversed'}:
        monkeypatch.delitem(signals.CASES, name)
    study = [*arguments, *kind, '--trips', '1', '--json', 'study.json', '--results', 'study.jsonl']
    first = said(*study)
    assert first[0] == 0 and printed in ' '.join(first[1].replace('│', '').split())
    written = json.loads((tmp_path / 'study.json').read_text())
    assert [result['number'] for result in written['results']] == [0] and written['seed'] == 7
    assert said(*study)[:2] == first[:2]
    assert len((tmp_path / 'study.jsonl').read_text().splitlines()) == 2


@pytest.mark.parametrize('extra, message', [
    (['--trips', '0'], '--trips: 0 is not allowed; it must be 1 ... 100000'),
    (['--period', 'nan'], '--period: nan is not allowed; it must be 0.1 ... 10'),
    (['--soc', '1.2'], 'state of charge: 1.2 is not allowed; it must be 0 ... 1'),
    (['--vehicle', 'referenz'], "vehicle 'referenz' is unknown; did you mean 'reference'"),
    (['--fault-source', 'heat_pump'], '--fault-source: only with --fault'),
    (['--days', '--plot', 'days.png'], '--plot: not allowed with --days'),
    (['--days', '--methods', 'paper'], '--methods: not allowed with --days'),
    (['--signals', '--fault', 'dead'], '--fault: not allowed with --signals')])
def test_bad_options_are_refused(arguments, extra, message, refused):
    assert message in refused(*arguments, *extra)
