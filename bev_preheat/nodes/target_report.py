# SPDX-License-Identifier: Apache-2.0
"""Target and charging session of a PreheatPlan: written into the message, and put into words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bev_preheat.numerics.factors import WH_PER_KWH
from bev_preheat.planning.explanation import duration_text
from bev_preheat_msgs.msg import PreheatPlan

if TYPE_CHECKING:
    from bev_preheat.control.target_choice import TargetChoice

# A session beyond these limits [s, Wh] is treated as unset.
LATEST_CHARGED_S, MOST_WH = 1e7, 1e9
# Fields of PreheatPlan and of TargetChoice.
FIGURES = {'charging_time': 'charging_time_s', 'charging_time_unheated': 'unheated_charging_time_s',
           'bought_energy': 'bought_energy_wh', 'bought_energy_unheated': 'unheated_bought_energy_wh'}


def write_target(message: PreheatPlan, choice: TargetChoice | None) -> None:
    """Write a TargetChoice into a PreheatPlan; None: no target, figures NaN."""
    for field, name in FIGURES.items():
        setattr(message, field, math.nan if choice is None else getattr(choice, name))
    doubt = None if choice is None else choice.doubt
    message.charging_probability = math.nan if doubt is None else doubt.probability
    message.heating_pays_from_probability = math.nan if doubt is None else doubt.pays_from
    if choice is not None:
        message.target_source = int(choice.source)
        message.target_reason = choice.reason


def session_texts(plan: PreheatPlan) -> tuple[str, str] | None:
    """Return the charging session of a PreheatPlan with its target and without heating; None: unknown."""
    if plan.target_source == PreheatPlan.TARGET_UNKNOWN:
        return None
    heated = _session_text(plan.charging_time, plan.bought_energy)
    unheated = _session_text(plan.charging_time_unheated, plan.bought_energy_unheated)
    return (heated, unheated) if heated and unheated else None


def charging_text(plan: PreheatPlan) -> str:
    """Return both sessions as one text, '' if the charger is unknown."""
    texts = session_texts(plan)
    return '' if texts is None else f'{texts[0]}; without heating {texts[1]}'


def _session_text(time_s: float, energy_wh: float) -> str:
    if time_s == math.inf:
        return 'never ends'
    if not (0.0 <= time_s < LATEST_CHARGED_S and 0.0 <= energy_wh < MOST_WH):
        return ''
    return f'{duration_text(time_s)}, {energy_wh / WH_PER_KWH:.2f} kWh'
