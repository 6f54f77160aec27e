# SPDX-License-Identifier: Apache-2.0
"""Cost of an update of the planner in process: from battery state to command, with estimation."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter, process_time, sleep
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.control.command_history import CommandHistory
from bev_preheat.control.events import BatteryStateArrived, RouteArrived
from bev_preheat.control.expected_drive import intervals_between
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.control.timetable import Timetable
from bev_preheat.estimation.estimator import Estimator
from bev_preheat.native.library import core
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, Uncertainty
from bev_preheat.route import load_route
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.simulation.supervised_drive import moments
from bev_preheat.tunables import NOMINAL_HEAT_LAG_S
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.cost.core_time import timed_core
from bev_preheat_studies.cost.figures import Figure
from bev_preheat_studies.cost.planning_cost import GOAL, STATE

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle import Vehicle

# Readings one second apart; the first few do not count, because caches fill.
UPDATES, FILLING = 400, 20
START_NS = 1_000_000 * NS_PER_S
# As between two states in the latency measurement (`process_cost`).
PAUSE_S = 0.005
# Noise of the readings: temperature [K] and power [W].
NOISE_K, NOISE_W = 0.1, 3e3
VOLTAGE_V = 400.0
MEDIAN_MS, RARELY_MS = 0.4, 1.0
# A whole drive over the pass, with active limits and a binding reserve.
BINDING_MEDIAN_MS, BINDING_WORST_MS = 5.0, 20.0
# Uncertainty of the arrival after some minutes [K].
DEVIATION_K = 1.0


def measure(log: Callable[[str], object]) -> list[Figure]:
    """Return the Figures; `log` takes a line of progress."""
    vehicle, settings = load_vehicle('reference'), Settings()
    leg = Leg(load_route('reference', vehicle.defaults), START_NS, target_temperature_c=GOAL.target_temperature_c)
    mission = Mission('benchmark', (leg,)).in_planning_steps(settings.planning_step_s)
    measurements = _measurements(mission)
    figures = []
    for what, times_ms, bounds in (
            ('update of the planner, reference trip', _updates_ms(vehicle, mission, measurements),
             (MEDIAN_MS, RARELY_MS)),
            ('of this, the estimation', _estimations_ms(vehicle, mission, measurements), (None, None)),
            ('of this, a plan', _plans_ms(vehicle, mission, measurements, settings), (None, None))):
        for name, share, bound in (('median', 50, bounds[0]), ('99 %', 99, bounds[1])):
            figures.append(Figure(f'{what}, {name}', float(np.percentile(times_ms[FILLING:], share)),
                                  'ms of processor time', bound))
        log(f'{what}: {len(times_ms)} times')
    figures += _core_figures(vehicle, mission, measurements)
    return figures + _binding_figures(vehicle, settings, log)


def _core_figures(vehicle: Vehicle, mission: Mission, measurements: list[Measurement]) -> list[Figure]:
    """
    Return the time of an update and of its calls of the core, with ctypes; empty without a core.

    Measured back to back, and after a pause in which other code has used the caches.
    """
    if core() is None:
        return []
    figures = []
    for what, pause_s in (('update', 0.0), (f'update after {1e3 * PAUSE_S:g} ms without work', PAUSE_S)):
        durations_s: list[float] = []
        updates_ms, counts, sums_ms = [], [], []
        supervisor = Supervisor(vehicle, Settings())
        supervisor.step(START_NS, RouteArrived(mission))
        with timed_core(durations_s):
            for measurement in measurements:
                sleep(pause_s)
                durations_s.clear()
                started = perf_counter()
                supervisor.step(measurement.stamp_ns, BatteryStateArrived(measurement))
                updates_ms.append(1e3 * (perf_counter() - started))
                counts.append(len(durations_s))
                sums_ms.append(1e3 * sum(durations_s))
        figures += [Figure(f'{what}, elapsed, median', float(np.median(updates_ms[FILLING:])), 'ms'),
                    Figure('of this, in calls of the core, median', float(np.median(sums_ms[FILLING:])), 'ms')]
    return [*figures, Figure('calls of the core in an update, median', float(np.median(counts[FILLING:])), '')]


def _binding_figures(vehicle: Vehicle, settings: Settings, log: Callable[[str], object]) -> list[Figure]:
    """Return the time of updates over the pass with a reserve that allows half of the wanted warming."""
    route = load_route('alpine_pass', vehicle.defaults)
    heated, unheated = (make_plan(vehicle, route, STATE, GOAL) for make_plan in (
        plan_preheating, plan_unheated))
    reserve = 0.5 * float(heated.soc[-1] + unheated.soc[-1]) - settings.arrival_soc_margin
    car = ImperfectCar(vehicle, route, STATE, replace(GOAL, minimum_arrival_soc=reserve), Imperfections(
        sensors=Sensors(temperature_noise_k=NOISE_K)))
    times_ms = [1e3 * moment.cpu_s for moment in moments(
        car, Supervisor(vehicle, settings), lambda: car.plant.is_standing) if moment.reading is not None]
    what = 'update of the planner, alpine_pass, a reserve that binds'
    log(f'{what}: {len(times_ms)} times')
    return [Figure(f'{what}, {name}', value_ms, 'ms of processor time', bound_ms) for name, value_ms, bound_ms in (
        ('median', float(np.median(times_ms)), BINDING_MEDIAN_MS), ('worst', max(times_ms), BINDING_WORST_MS))]


def _measurements(mission: Mission) -> list[Measurement]:
    """Return readings along a mission's first leg, one second apart, as from sensors."""
    drawn, route = np.random.default_rng(1), mission.legs[0].route
    measurements = []
    for second in range(UPDATES):
        power_w = route.propulsion_power_w[route.segment_at(second)] + drawn.normal(0.0, NOISE_W)
        measurements.append(Measurement(
            BatteryState(-7.0 + 5e-4 * second + drawn.normal(0.0, NOISE_K), 0.9 - 4e-5 * second),
            START_NS + second * NS_PER_S, VOLTAGE_V, float(power_w) / VOLTAGE_V))
    return measurements


def _updates_ms(vehicle: Vehicle, mission: Mission, measurements: list[Measurement]) -> FloatArray:
    """Return the duration of each update [ms of processor time]."""
    supervisor = Supervisor(vehicle, Settings())
    supervisor.step(START_NS, RouteArrived(mission))
    return _times_ms(lambda measurement: supervisor.step(
        measurement.stamp_ns, BatteryStateArrived(measurement)), measurements)


def _estimations_ms(vehicle: Vehicle, mission: Mission, measurements: list[Measurement]) -> FloatArray:
    """Return the estimator's time for each measurement [ms of processor time]."""
    estimator, timetable, commands = Estimator.of(vehicle), Timetable.of(mission), CommandHistory()

    def estimate(measurement: Measurement) -> None:
        nonlocal estimator
        estimator = estimator.observed(measurement, intervals_between(
            estimator.edges_ns(measurement.stamp_ns), vehicle, timetable, commands), vehicle)

    return _times_ms(estimate, measurements)


def _plans_ms(vehicle: Vehicle, mission: Mission, measurements: list[Measurement],
              settings: Settings) -> FloatArray:
    """Return the time of a plan with the updates' uncertainty [ms of processor time]."""
    leg = mission.legs[0]

    def plan(measurement: Measurement) -> object:
        route = leg.route_ahead(measurement.stamp_ns)
        assert route is not None
        return plan_preheating(vehicle, route, measurement.state, GOAL, settings.method, Uncertainty(DEVIATION_K),
                               heat_lag_s=NOMINAL_HEAT_LAG_S)

    return _times_ms(plan, measurements)


def _times_ms(call: Callable[[Measurement], object], measurements: list[Measurement]) -> FloatArray:
    times_s = []
    for measurement in measurements:
        started = process_time()
        call(measurement)
        times_s.append(process_time() - started)
    return 1e3 * np.array(times_s)
