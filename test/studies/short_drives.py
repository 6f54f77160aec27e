# SPDX-License-Identifier: Apache-2.0
"""A short trip on which the battery can be warmed, and made-up results."""

import numpy as np

from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import make_route
from bev_preheat.simulation.imperfect_car import Mismatch
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import DIRECT
from bev_preheat_studies.robustness.cars import CarResult
from bev_preheat_studies.robustness.drawn_cars import Conditions
from bev_preheat_studies.robustness.driven import DriveOutcome

VEHICLE = load_vehicle('reference')
STEPS = 16


def short_conditions(period_s=2.0, **changes):
    """Eight minutes at 17 kW, from 15 to 18 deg C; no two figures are equal."""
    route = make_route({
        'duration_s': np.full(STEPS, 30.0),
        'speed_mps': np.full(STEPS, 21.0),
        'propulsion_power_w': np.full(STEPS, 17e3),
        'propulsion_power_rms_w': np.full(STEPS, 19e3),
        'ambient_temperature_c': np.full(STEPS, 3.0),
        'cabin_heating_power_w': np.full(STEPS, 1500.0),
        'auxiliary_power_w': np.full(STEPS, 400.0)}, VEHICLE.defaults)
    return Conditions(**{
        'vehicle': VEHICLE, 'routes': (route,), 'state': BatteryState(15.0, 0.8), 'goal': Goal(18.0),
        'period_s': period_s, 'plant': 'ripple', **changes})


def made_drive(**changes):
    """Return a DriveOutcome with default figures unless given."""
    return DriveOutcome(**{
        'arrival_error_k': 0.1, 'heating_energy_wh': 200.0, 'battery_energy_wh': 2000.0, 'switch_ons': 1,
        **changes})


def made_result(number, informed=None, **methods):
    """Return a CarResult of made-up drives."""
    return CarResult(number, Mismatch(), DIRECT, informed or made_drive(), methods)
