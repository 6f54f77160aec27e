# SPDX-License-Identifier: Apache-2.0
"""The powers along a finished plan: those of the battery and of its heat balance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.planning.dynamics import keep_accounts
from bev_preheat.planning.schedule import Schedule
from bev_preheat.vehicle.model import make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.dynamics import Accounts
    from bev_preheat.planning.plan import Plan
    from bev_preheat.planning.trip import Trip


def accounts_of(trip: Trip, plan: Plan) -> Accounts:
    """Return the Accounts of a plan for this trip: energies [Wh], and powers in each of the N steps [W]."""
    return keep_accounts(trip, Schedule(
        plan.heating_start_s, plan.hvch_battery_power_w, plan.friction_brake_power_w,
        plan.soc, plan.battery_temperature_c, make_runge_kutta_4,
        driven_share=driven_share(trip, plan), heat=plan.heat))


def driven_share(trip: Trip, plan: Plan) -> FloatArray:
    """Return the driven share of each step, shape (N,): 0 once the battery is empty."""
    empty_s = np.inf if plan.stranding is None else plan.stranding.at_s
    return np.clip((empty_s - trip.time_s[:-1]) / trip.route.duration_s, 0.0, 1.0)
