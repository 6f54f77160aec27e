# SPDX-License-Identifier: Apache-2.0
"""Powers along a finished plan, of the battery and its heat balance, and the cost of energy from the grid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.factors import JOULES_PER_WH, WH_PER_KWH
from bev_preheat.planning.engine import keep_accounts
from bev_preheat.planning.schedule import Schedule
from bev_preheat.vehicle.model import make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.dynamics import Accounts
    from bev_preheat.planning.plan import Plan
    from bev_preheat.planning.schedule import StepPrices
    from bev_preheat.planning.trip import Trip


def cost_of(plan: Plan, step_prices: StepPrices) -> float:
    """Return the cost of the heater's energy in a Plan, in the currency of the prices."""
    energy_wh = plan.drawn_power_w * np.diff(plan.time_s) / JOULES_PER_WH
    return float(energy_wh @ step_prices(plan.time_s)) / WH_PER_KWH


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
