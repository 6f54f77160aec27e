# SPDX-License-Identifier: Apache-2.0
"""What a PreheatPlan says of its target and of the charging session, written and put into words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bev_preheat.planning.explanation import duration_text
from bev_preheat.supervision.target_choice import TargetSource

if TYPE_CHECKING:
    from bev_preheat.supervision.target_choice import TargetChoice
    from bev_preheat_msgs.msg import PreheatPlan

WH_PER_KWH = 1000.0
# Fields of PreheatPlan and of TargetChoice.
FIGURES = {'charging_time': 'charging_time_s', 'charging_time_unheated': 'unheated_charging_time_s',
           'bought_energy': 'bought_energy_wh', 'bought_energy_unheated': 'unheated_bought_energy_wh'}


def write_target(message: PreheatPlan, choice: TargetChoice | None) -> None:
    """Write a TargetChoice into a PreheatPlan; None: there is no target, and its figures are NaN."""
    for field, name in FIGURES.items():
        setattr(message, field, math.nan if choice is None else getattr(choice, name))
    if choice is not None:
        message.target_source = int(choice.source)
        message.target_reason = choice.reason


def source_text(plan: PreheatPlan) -> str:
    """Return where the target of a PreheatPlan comes from, in a word; '' where that is not known."""
    try:
        source = TargetSource(plan.target_source)
    except ValueError:
        return ''
    return '' if source is TargetSource.UNKNOWN else source.name.lower()


def charging_text(plan: PreheatPlan) -> str:
    """Return the session with the target and without heating, '' where the charger is not known."""
    heated, unheated = (_session_text(time_s, energy_wh) for time_s, energy_wh in (
        (plan.charging_time, plan.bought_energy),
        (plan.charging_time_unheated, plan.bought_energy_unheated)))
    return f'{heated}; without heating {unheated}' if heated and unheated else ''


def _session_text(time_s: float, energy_wh: float) -> str:
    if math.isinf(time_s):
        return 'never ends'
    if math.isnan(time_s) or not math.isfinite(energy_wh):
        return ''
    return f'{duration_text(time_s)}, {energy_wh / WH_PER_KWH:.2f} kWh'
