# SPDX-License-Identifier: Apache-2.0
"""
Nine measured winter drives of a BMW i3 (60 Ah), which has no heater for its battery.

"Battery and Heating Data in Real Driving Cycles", Technical University of Munich, IEEE DataPort, doi
10.21227/6jr9-5235. They are not part of the project; without them these tests are skipped.
"""

import csv
from dataclasses import replace
from functools import cache
import os
from pathlib import Path

import numpy as np
import pytest

from bev_preheat.control.events import BatteryStateArrived, RouteArrived
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.curves import InverseTemperatureResistance, PolynomialVoltage
from bev_preheat.vehicle.description import Drivetrain, Hvch, Leakage

FOLDER = Path(os.environ.get('BEV_PREHEAT_DRIVE_LOGS') or (
    Path(__file__).resolve().parents[3] / 'shared' / 'data' / 'i3_winter_trips'))
NAMES = tuple(sorted(path.stem for path in FOLDER.glob('Trip*.csv')))
# Daily; make test-deep plays all.
SHORTEST = tuple(name for name in NAMES if name == 'TripB32')
pytestmark = [pytest.mark.costly, pytest.mark.skipif(not NAMES, reason=(
    'needs the measured winter drives of a BMW i3 (TU Munich, doi 10.21227/6jr9-5235) in the '
    'folder BEV_PREHEAT_DRIVE_LOGS'))]
LEADS_S = (600, 300, 120, 60)
SETTLING_S = 60
START_NS = 10**15
# The vehicle file of an i3 by hand: fits of other drives of the same data set.
REFERENCE = load_vehicle('reference')
VEHICLE = replace(
    REFERENCE, name='i3', hvch=Hvch(5500.0, 0.9), drivetrain=Drivetrain(0.88, 0.0, 125e3),
    battery=replace(
        REFERENCE.battery, capacity_ah=61.84, heat_capacity_j_per_k=190e3, leakage=Leakage(3.0, 0.0),
        open_circuit_voltage=PolynomialVoltage((356.9, 40.2, 0.0, 0.0), 9.83),
        resistance=InverseTemperatureResistance(3.01, 11.1), temperature_range_c=(-25.0, 55.0),
        soc_range=(0.03, 1.0)))


@cache
def logged(name):
    """Return the columns of a drive by name, whole blocks of 30 s."""
    with open(FOLDER / f'{name}.csv', encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    length = len(rows) // 30 * 30
    return {key: np.array([float(row[key]) for row in rows[:length]]) for key in rows[0]}


def planned(name):
    """Return the Route of a trip planner with perfect knowledge of the drive, in steps of 30 s."""
    log = logged(name)
    cabin_w, auxiliary_w = np.maximum(log['cabin_heater_w'], 0.0), 350.0 + np.maximum(log['aircon_w'], 0.0)
    power_w = log['voltage_v'] * log['current_a'] - cabin_w - auxiliary_w

    def mean(column):
        return column.reshape(-1, 30).mean(axis=1)

    return make_route({
        'duration_s': np.full(len(power_w) // 30, 30.0), 'speed_mps': mean(log['speed_mps']),
        'propulsion_power_w': mean(power_w), 'propulsion_power_rms_w': np.sqrt(mean(power_w**2)),
        'propulsion_power_magnitude_w': mean(np.abs(power_w)), 'ambient_temperature_c': mean(log['ambient_c']),
        'cabin_heating_power_w': mean(cabin_w), 'auxiliary_power_w': mean(auxiliary_w)}, VEHICLE.defaults)


class Played:
    """A drive seen by a Supervisor: predicted minus measured arrival [K] by lead [s], and verdicts."""

    def __init__(self, name, estimation=True, left_out=0, with_power=True, spike=(0, 0, 0.0)):
        supervisor = Supervisor(VEHICLE, Settings(estimation=estimation))
        log, now_ns = logged(name), START_NS
        length = len(log['time_s'])
        temperature_c = log['battery_temperature_c'].copy()
        arrived_c = float(np.median(temperature_c[-10:]))
        begins_s, lasts_s, spike_k = spike
        temperature_c[begins_s:begins_s + lasts_s] += spike_k
        # No target asks for heat.
        supervisor.step(now_ns, RouteArrived(Mission(name, (Leg(planned(name), now_ns, True, -20.0),))))
        self.errors_k, self.heaters = {}, set()
        for at in range(length):
            now_ns += NS_PER_S
            # Without estimation a plan starts from the latest state alone.
            if not estimation and length - at > max(LEADS_S) + SETTLING_S:
                continue
            if left_out and at % left_out == left_out - 1 and length - at not in LEADS_S:
                continue
            power = (float(log['voltage_v'][at]), float(log['current_a'][at])) if with_power else ()
            supervisor.step(now_ns, BatteryStateArrived(Measurement(
                BatteryState(float(temperature_c[at]), round(float(log['soc'][at]), 3)), now_ns, *power)))
            if supervisor.state.estimate is not None:
                self.heaters.add(supervisor.state.estimate.heater.heater)
            if length - at in LEADS_S:
                self.errors_k[length - at] = supervisor.state.decision.plan.arrival_temperature_c - arrived_c
        self.estimate = supervisor.state.estimate


@cache
def all_played(names=NAMES, left_out=0, estimation=True, with_power=True):
    return [Played(name, left_out=left_out, estimation=estimation, with_power=with_power) for name in names]


def errors_k(left_out, estimation):
    """Return predicted minus measured arrival [K], shape (leads, drives)."""
    drives = all_played(NAMES, left_out, estimation, True)
    return np.array([[drive.errors_k[lead_s] for drive in drives] for lead_s in LEADS_S])


@pytest.mark.deep
@pytest.mark.parametrize('left_out', [0, pytest.param(5, marks=pytest.mark.deep)])
def test_estimation_predicts_no_worse_than_none_at_each_lead(left_out):
    with_it, without = (np.abs(errors_k(left_out=left_out, estimation=each)) for each in (True, False))
    assert (np.sqrt(np.mean(with_it**2, axis=1)) <= np.sqrt(np.mean(without**2, axis=1))).all()
    # Dropping every fifth state may cost a hundredth of the sensor's step.
    assert (with_it.max(axis=1) <= without.max(axis=1) + 0.01).all()


@pytest.mark.parametrize('names, with_power', [
    (SHORTEST, True), *(pytest.param(*case, marks=pytest.mark.deep) for case in (
        (SHORTEST, False), (NAMES, True), (NAMES, False)))],
    ids=['power seen', 'temperature only', 'power seen, all', 'temperature only, all'])
def test_nobody_accuses_a_heater_that_is_never_commanded(names, with_power):
    for drive in all_played(names, 0, True, with_power):
        assert drive.heaters == {Heater.ANSWERS}


@pytest.mark.parametrize('lasts_s, spike_k', [
    pytest.param(30, 2.0, marks=pytest.mark.deep), pytest.param(120, 1.0, marks=pytest.mark.deep), (120, 2.0)])
@pytest.mark.parametrize('names', [
    pytest.param(SHORTEST, id='shortest'), pytest.param(NAMES[1::4], id='others', marks=pytest.mark.deep)])
def test_a_spike_accuses_nobody(names, lasts_s, spike_k):
    for name in names:
        drive = Played(name, with_power=False, spike=(len(logged(name)['time_s']) // 2, lasts_s, spike_k))
        assert drive.heaters == {Heater.ANSWERS}
