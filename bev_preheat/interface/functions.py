# SPDX-License-Identifier: Apache-2.0
"""The functions of the public interface; each does the work of the `preheat` command of its name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math
from typing import TYPE_CHECKING

from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.stop import ChargingStop, USUAL_DEPARTURE_SOC
from bev_preheat.charging.target_worth import check_prices, ENERGY_PRICE_PER_KWH, Prices, VALUE_OF_TIME_PER_H
from bev_preheat.charging.worth_search import find_worth
from bev_preheat.errors import InvalidInput
from bev_preheat.interface.drive_results import (
    CheckResult,
    DriveResult,
    IdentificationResult,
    SessionResult,
    WorthResult,
)
from bev_preheat.interface.inputs import checked
from bev_preheat.interface.results import ComparisonResult, OptimumResult, PlanResult
from bev_preheat.optional_packages import require
from bev_preheat.planning.installed_methods import MethodSituation, use_function
from bev_preheat.planning.plan import difference, energy_gap_wh
from bev_preheat.planning.planner import (
    as_driven,
    check_method,
    DEFAULT_METHOD,
    method_names,
    plan_preheating,
)
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.tunables import LONGEST_ROW_S

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from bev_preheat.logs.recording import Recording
    from bev_preheat.route import Route
    from bev_preheat.simulation.heater import HeaterFault
    from bev_preheat.simulation.imperfect_car import Mismatch
    from bev_preheat.simulation.sensors import Sensors
    from bev_preheat.vehicle import Vehicle

    # The name of a method, or a function that returns the heater's power in each step [W], (N,).
    AnyMethod = str | Callable[[MethodSituation], ArrayLike]


def goal_of(vehicle: Vehicle, goal: Goal | float | None) -> Goal:
    """Return a Goal; a number is its target [deg C], None the vehicle's default."""
    if goal is None:
        return Goal(vehicle.defaults.target_battery_temperature_c)
    return goal if isinstance(goal, Goal) else Goal(float(goal))


def _named(method: AnyMethod) -> str:
    """Return the name of a method; a function gets one in this process."""
    name = method if isinstance(method, str) else use_function(method)
    check_method(name)
    return name


def named_methods(methods: Sequence[AnyMethod]) -> tuple[str, ...]:
    """Return the names of methods, each once; raises InvalidInput if two functions have the same name."""
    different = tuple(dict.fromkeys(methods))
    names = tuple(dict.fromkeys(map(_named, different)))
    if len(names) < len(different):
        raise InvalidInput('methods: two functions have the same name; rename one')
    return names


@checked
def plan(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal | float | None = None,
         method: AnyMethod = DEFAULT_METHOD) -> PlanResult:
    """
    Return when to heat on a route, whose rows are divided from 60 s on, as `preheat plan` does.

    `state` is the battery's at the start; `goal` a Goal, a target temperature on arrival [deg C], or None for
    the vehicle's default. `method` is a name in `methods()`: `value_function` keeps the paper's limits (9e)-(9i),
    `optimal_switch` has one switching instant, `paper` is the heuristic of its Algorithms 1 and 2; or a function
    of a MethodSituation that returns the heater's power in each step [W], (N,). Raises InvalidInput, which names
    field, value and allowed range, and PlanningFailure if the model yields no numbers, or the function no powers.
    """
    goal, route = goal_of(vehicle, goal), route.divided(LONGEST_ROW_S)
    return PlanResult(vehicle, route, goal, plan_preheating(vehicle, route, state, goal, _named(method)))


def methods() -> tuple[str, ...]:
    """Return the names of the planning methods: the built-in ones, then those of installed packages."""
    return method_names()


@checked
def optimum(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal | float | None = None,
            keeps_power_limits: bool = True) -> OptimumResult:
    """
    Return the optimum of the nonlinear program (9), as `preheat optimum` does; needs casadi (extra `nlp`).

    Arguments as in `plan`. Raises InvalidInput, MissingPackage, and nonlinear_program.solve.SolverFailure.
    """
    require('casadi')
    from bev_preheat.nonlinear_program.solve import solve_optimum
    goal, route = goal_of(vehicle, goal), route.divided(LONGEST_ROW_S)
    solved = solve_optimum(vehicle, route, state, goal, keeps_power_limits)
    return OptimumResult(vehicle, route, goal, solved.plan, solved)


@checked
def compare(vehicle: Vehicle, route: Route, state: BatteryState,
            goal: Goal | float | None = None, methods: Sequence[AnyMethod] | None = None) -> ComparisonResult:
    """
    Return the plans of several methods beside the optimum, as `preheat compare` does; needs casadi (extra `nlp`).

    `methods` are the names of those to compare, or functions as in `plan`; None for all. A plan that breaks a
    power limit is compared as it would be driven. Other arguments as in `plan`.
    """
    names = method_names() if methods is None else named_methods(methods)
    goal, route = goal_of(vehicle, goal), route.divided(LONGEST_ROW_S)
    best = optimum(vehicle, route, state, goal)
    plans = {name: as_driven(plan_preheating(
        vehicle, route, state, goal, name, no_regret=name == DEFAULT_METHOD), vehicle, route, state, goal)
        for name in names}
    return ComparisonResult(
        {name: PlanResult(vehicle, route, goal, each) for name, each in plans.items()}, best,
        {name: energy_gap_wh(each, best.plan) for name, each in plans.items()},
        {name: difference(each, best.plan) for name, each in plans.items()})


@checked
def charging_session(vehicle: Vehicle, state: BatteryState, charger_power_w: float, departure_soc: float,
                     ambient_c: float, cabin_heating_power_w: float | None = None,
                     auxiliary_power_w: float | None = None, *,
                     energy_price_per_kwh: float = ENERGY_PRICE_PER_KWH,
                     value_of_time_per_h: float = VALUE_OF_TIME_PER_H) -> SessionResult:
    """
    Return the charging session from a battery state on arrival, as `preheat charge` does.

    `charger_power_w` is the most that the charger gives at the vehicle's inlet [W], `departure_soc` (0 ... 1) the
    state of charge to leave with, `ambient_c` the air at the charger [deg C]; powers of cabin and auxiliaries [W]
    are the vehicle's defaults if None. A car that can heat its battery at the charger does so as far as it costs
    least at the two prices, in one currency. Raises InvalidInput.
    """
    defaults = vehicle.defaults
    stop = ChargingStop(
        charger_power_w, departure_soc, ambient_c,
        defaults.cabin_heating_power_w if cabin_heating_power_w is None else cabin_heating_power_w,
        defaults.auxiliary_power_w if auxiliary_power_w is None else auxiliary_power_w)
    prices = Prices(energy_price_per_kwh, value_of_time_per_h)
    check_prices(prices)
    choice = ChargerHeating(vehicle, stop, prices).compare(state)
    return SessionResult(vehicle, stop, choice.session, choice)


@checked
def worth(vehicle: Vehicle, route: Route, state: BatteryState, charger_power_w: float,
          departure_soc: float = USUAL_DEPARTURE_SOC,
          goal: Goal | float | None = None, energy_price_per_kwh: float = ENERGY_PRICE_PER_KWH,
          value_of_time_per_h: float = VALUE_OF_TIME_PER_H) -> WorthResult:
    """
    Return the target with the least cost of energy and time at the charger, as `preheat worth` does.

    `charger_power_w` [W], `departure_soc` (0 ... 1); prices in one currency. Raises InvalidInput.
    """
    return WorthResult(vehicle, find_worth(
        vehicle, route.divided(LONGEST_ROW_S), state, goal_of(vehicle, goal), charger_power_w, departure_soc,
        Prices(energy_price_per_kwh, value_of_time_per_h)))


@checked
def drive(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal | float | None = None, *,
          mismatch: Mismatch | None = None, sensors: Sensors | None = None,
          heater_faults: Sequence[HeaterFault] = (), estimation: bool = True, method: AnyMethod = DEFAULT_METHOD,
          seed: int = 0) -> DriveResult:
    """
    Drive a simulated car along a route under the planner's own step, without ROS.

    The planner knows `vehicle` and `route`; the true car and drive differ from them by a Mismatch and by
    `heater_faults`, and are seen through Sensors (None: as described, and perfect). Without `estimation` it plans
    from measured values; `method` is as in `plan`. The same arguments give the same drive. Raises InvalidInput,
    also for deviations beyond the ranges of a scenario file.
    """
    method = _named(method)
    import numpy as np

    from bev_preheat.control.settings import Settings
    from bev_preheat.control.supervisor import Supervisor
    from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections, Mismatch
    from bev_preheat.simulation.phases import DrivePhase
    from bev_preheat.simulation.scenario import check_imperfections
    from bev_preheat.simulation.sensors import Sensors
    from bev_preheat.simulation.supervised_drive import moments
    goal = goal_of(vehicle, goal)
    imperfections = Imperfections(
        Mismatch() if mismatch is None else mismatch, sensors=Sensors() if sensors is None else sensors,
        heater_faults=tuple(heater_faults))
    check_imperfections(vehicle, imperfections)
    car = ImperfectCar(vehicle, DrivePhase(route, goal), state, imperfections, seed)
    supervisor = Supervisor(vehicle, Settings(method=method, estimation=estimation))
    plant, latest_c, command_w, rows = car.plant, math.nan, 0.0, []
    for moment in moments(car, supervisor, lambda: plant.is_standing):
        if moment.reading is not None:
            latest_c = moment.reading.temperature_c
        if moment.output.command is not None:
            command_w = moment.output.command.total_w
        estimate, plan = supervisor.state.estimate, supervisor.state.decision.plan
        if moment.is_last:
            rows.append((moment.time_s, plant.temperature_c, latest_c,
                         math.nan if estimate is None else estimate.temperature_c,
                         math.nan if plan is None else plan.arrival_temperature_c, command_w))
    time_s, true_c, measured_c, estimated_c, predicted_c, commands_w = np.array(rows).T
    estimate = supervisor.state.estimate
    return DriveResult(
        time_s, true_c, measured_c, estimated_c, predicted_c, commands_w, plant.temperature_c, plant.soc,
        goal.target_temperature_c, plant.energy_wh.hvch_electric, plant.energy_wh.battery_total,
        'unknown' if estimate is None else estimate.heater.heater.value)


@checked
def check(vehicle: Vehicle, recordings: Sequence[Recording], replays: bool = True) -> CheckResult:
    """
    Return how well a vehicle predicts recorded drives, as `preheat check` does.

    With `replays` the drives are also replayed to the planner, with its estimation and without. Raises
    InvalidInput, which names log, signal, value and allowed range.
    """
    from bev_preheat.identification.check import check_trips
    from bev_preheat.identification.trips import trips_of
    return CheckResult(vehicle, check_trips(vehicle, trips_of(recordings, vehicle), replays))


@checked
def identify(vehicle: Vehicle, recordings: Sequence[Recording], name: str = 'identified') -> IdentificationResult:
    """
    Return the car that drove the recordings, as `preheat identify` does.

    It needs casadi and scipy (extra `identify`). `vehicle` is the car to start from, `name` the name of the new
    car, which is the attribute `vehicle` of the result. Raises InvalidInput if the recordings give too little.
    """
    require('casadi', 'scipy')
    from bev_preheat.identification.identify import identify as identify_trips
    from bev_preheat.identification.trips import trips_of
    identified = identify_trips(vehicle, trips_of(recordings, vehicle), name)
    return IdentificationResult(identified.vehicle, identified)
