# SPDX-License-Identifier: Apache-2.0
"""
Decides whether two plans reach the same, so that their energies may be compared.

A plan that arrives colder, eats into the reserve or has a power deficit spends less because it does less. Heat
beyond the target counts as waste.
"""

from __future__ import annotations

from typing import Protocol, TYPE_CHECKING

from bev_preheat.tunables import NO_WORSE_W, SAME_SOC, SHORTFALL_TOLERANCE_K

if TYPE_CHECKING:
    from bev_preheat.planning.plan import Plan

# Arrivals whose shortfalls differ by no more than this are the same [K].
SAME_SHORTFALL_K = SHORTFALL_TOLERANCE_K


class Reached(Protocol):
    """The results of a plan: a Plan, or figures read from one."""

    @property
    def shortfall_k(self) -> float:
        """By how much the target is missed [K]."""

    @property
    def soc_shortfall(self) -> float:
        """By how much the reserve is missed, 0 ... 1."""

    @property
    def undeliverable_power_w(self) -> float:
        """Worst power deficit of the battery [W]."""


def difference(plan: Reached, optimum: Reached) -> str:
    """
    Return in words how a plan's result differs from the optimum's; '' if both reach the same.

    NaN: unknown.
    """
    colder_k = plan.shortfall_k - optimum.shortfall_k
    deficit_w = plan.undeliverable_power_w - optimum.undeliverable_power_w
    if not abs(colder_k) <= SAME_SHORTFALL_K:
        return (f'{abs(colder_k):.2f} K {"colder" if colder_k > 0.0 else "warmer"}'
                if colder_k == colder_k else 'unknown arrival')
    if (plan.soc_shortfall > SAME_SOC) != (optimum.soc_shortfall > SAME_SOC):
        return ('reserve missed' if plan.soc_shortfall > SAME_SOC else
                'reserve kept')
    if not abs(deficit_w) <= NO_WORSE_W:
        return (f'power deficit {abs(deficit_w) / 1e3:.2f} kW {"larger" if deficit_w > 0.0 else "smaller"}'
                if deficit_w == deficit_w else 'unknown power')
    return ''


def energy_gap_wh(plan: Plan, optimum: Plan) -> float | None:
    """Return the battery energy of a Plan above the optimum's [Wh]; None if their results differ."""
    if difference(plan, optimum):
        return None
    return plan.energy_wh.battery_total - optimum.energy_wh.battery_total
