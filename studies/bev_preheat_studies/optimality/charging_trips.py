# SPDX-License-Identifier: Apache-2.0
"""Draw random drives to a charger: vehicle, route, state, charger, departure, prices."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator

from bev_preheat.charging.stop import ChargingStop, stop_after
from bev_preheat.charging.target_worth import Prices
from bev_preheat.numerics import FloatArray
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import make_route
from bev_preheat.simulation.traffic import vary
from bev_preheat.vehicle import load_vehicle, Vehicle
from bev_preheat.vehicle.charging import charging_of
from bev_preheat.vehicle.description import Cooling, HeatPath
from bev_preheat_studies.optimality.drawn_trips import DrawnTrip

VEHICLES = ('reference', 'large_suv', 'mid_size_lfp', 'small_car', 'small_hatchback')
STEP_S = 60.0
# Approximate voltage, to convert energy to charge when the initial state of charge is drawn.
NOMINAL_VOLTAGE_V = 380.0
# (low, high) of uniform distributions; the charger's power is log-uniform.
DURATION_MIN = (15.0, 100.0)
MEAN_POWER_W = (8e3, 26e3)
AMBIENT_C = (-28.0, 6.0)
SOAK_K = (0.0, 8.0)
GARAGE_K = (5.0, 20.0)
ARRIVAL_SOC = (0.06, 0.4)
CHARGED_SHARE = (0.2, 0.7)
MOST_DEPARTURE_SOC = 0.9
CHARGER_W = (30e3, 350e3)
HEATER = (0.7, 1.4)
ENERGY_PRICE, VALUE_OF_TIME = (0.1, 1.0), (0.0, 80.0)
DESCENT_W, DESCENT_MIN = (5e3, 40e3), (4.0, 15.0)
# Share of the trips with: a garage at the start, a descent, a car that does not heat at the charger, a heat
# path, free energy, time of no value.
GARAGE, DESCENT, NO_HEATING, HEAT_PATH, FREE_ENERGY, FREE_TIME = 0.2, 0.3, 0.25, 0.15, 0.05, 0.1
# … a car that cools its battery at the charger, and has more resistance there. Its set point lies above the limit
# of heating by SET_POINT_K.
HOT_END = 0.35
POLARIZATION, SET_POINT_K = (1.0, 2.5), (0.0, 6.0)
COOLING_W, COEFFICIENT_OF_PERFORMANCE, BAND_K = (1e3, 8e3), (1.0, 4.0), (1.0, 4.0)


@dataclass(frozen=True)
class ChargingTrip(DrawnTrip):
    """A random drive to a charger."""

    stop: ChargingStop
    prices: Prices


def draw_charging_trip(seed: int, number: int) -> ChargingTrip:
    """Return trip `number` of a study; not every trip can be driven or charged to the end."""
    random = np.random.default_rng([seed, number])
    vehicle = _draw_vehicle(random)
    size = vehicle.battery.capacity_ah * NOMINAL_VOLTAGE_V / 75e3
    steps = int(random.uniform(*DURATION_MIN) * 60.0 / STEP_S)
    power_w = vary(random, steps, size**0.5 * random.uniform(*MEAN_POWER_W), random.uniform(0.0, 0.5))
    if random.uniform() < DESCENT:
        power_w = _with_descent(random, power_w)
    ambient_c = random.uniform(*AMBIENT_C)
    cabin_w = min(random.uniform(500.0, 3000.0), 0.8 * vehicle.hvch.maximum_power_w)
    route = make_route({
        'duration_s': np.full(len(power_w), STEP_S),
        'speed_mps': np.clip(34.0 * np.cbrt(np.abs(power_w) / 40e3), 5.0, 40.0),
        'propulsion_power_w': power_w,
        'propulsion_power_rms_w': np.abs(power_w) * random.uniform(1.0, 1.4),
        'ambient_temperature_c': np.full(len(power_w), ambient_c),
        'cabin_heating_power_w': np.full(len(power_w), cabin_w),
        'auxiliary_power_w': np.full(len(power_w), random.uniform(200.0, 800.0)),
    }, vehicle.defaults)
    warmer_k = random.uniform(*(GARAGE_K if random.uniform() < GARAGE else SOAK_K))
    arrival_soc = random.uniform(*ARRIVAL_SOC)
    used = float(np.sum(power_w + cabin_w + 500.0) * STEP_S) / (
        vehicle.battery.capacity_as * NOMINAL_VOLTAGE_V)
    departure_soc = min(arrival_soc + random.uniform(*CHARGED_SHARE), MOST_DEPARTURE_SOC)
    charger_w = float(np.exp(random.uniform(*np.log(CHARGER_W))))
    prices = Prices(0.0 if random.uniform() < FREE_ENERGY else random.uniform(*ENERGY_PRICE),
                    0.0 if random.uniform() < FREE_TIME else random.uniform(*VALUE_OF_TIME))
    # Drawn last, so that all else is as without a hot end.
    if random.uniform() < HOT_END:
        vehicle = _with_hot_end(random, vehicle)
    return ChargingTrip(
        seed, number, vehicle, route,
        BatteryState(float(ambient_c + warmer_k), float(min(arrival_soc + used, 0.97))),
        Goal(vehicle.defaults.target_battery_temperature_c),
        stop_after(route, charger_w, departure_soc), prices)


def _draw_vehicle(random: Generator) -> Vehicle:
    vehicle = load_vehicle(str(random.choice(VEHICLES)))
    heats = random.uniform() >= NO_HEATING
    path = HeatPath(random.uniform(10.0, 60.0), random.uniform(5e3, 20e3), random.uniform(200.0, 800.0))
    return replace(
        vehicle, charging=replace(charging_of(vehicle), battery_heating=heats),
        hvch=replace(vehicle.hvch, maximum_power_w=(
            vehicle.hvch.maximum_power_w * random.uniform(*HEATER))),
        heat_path=path if random.uniform() < HEAT_PATH else vehicle.heat_path)


def _with_hot_end(random: Generator, vehicle: Vehicle) -> Vehicle:
    charging = charging_of(vehicle)
    set_point_c = (vehicle.defaults.target_battery_temperature_c if charging.heating_limit_c is None
                   else charging.heating_limit_c) + random.uniform(*SET_POINT_K)
    cooling_w = random.uniform(*COOLING_W)
    return replace(vehicle, charging=replace(
        charging, polarization_factor=random.uniform(*POLARIZATION), cooling=Cooling(
            set_point_c, cooling_w / random.uniform(*COEFFICIENT_OF_PERFORMANCE), cooling_w,
            random.uniform(*BAND_K))))


def _with_descent(random: Generator, power_w: FloatArray) -> FloatArray:
    steps = int(random.uniform(*DESCENT_MIN) * 60.0 / STEP_S)
    first = int(random.integers(0, len(power_w)))
    return np.insert(power_w, first, -vary(
        random, steps, random.uniform(*DESCENT_W), random.uniform(0.0, 0.2)))
