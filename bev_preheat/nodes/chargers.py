# SPDX-License-Identifier: Apache-2.0
"""The charger at the end of a RoutePlan, and the prospect of charging there: validated, read, and written."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bev_preheat.charging.prospect import MOST_S
from bev_preheat.charging.stop import CHARGER_RANGE_W, USUAL_DEPARTURE_SOC
from bev_preheat.errors import figure, figure_beyond
from bev_preheat.nodes.stops import charger_of, figures_of, NOT_KNOWN, prospect_of

if TYPE_CHECKING:
    from bev_preheat.charging.prospect import ChargingProspect
    from bev_preheat.charging.stop import Charger
    from bev_preheat_msgs.msg import RoutePlan

# Fields of RoutePlan: (low, high), unit, meaning of 0 and NaN.
FIELDS = {'charger_power': (CHARGER_RANGE_W, ' W', NOT_KNOWN),
          'charging_departure_soc': ((0.0, 1.0), '', f'{NOT_KNOWN}, {USUAL_DEPARTURE_SOC:g}')}
# Fields of RoutePlan: (low, high), unit, meaning of 0. NaN is refused: a trip planner that does not know says 0.
PROSPECT_FIELDS = {'charging_probability': ((0.0, 1.0), '', 'not given, it charges for certain'),
                   'arrival_time_deviation': ((0.0, MOST_S), ' s', 'not given, exact'),
                   'charging_known_before_arrival': ((0.0, MOST_S), ' s', 'known on arrival')}


def charger_problems(message: RoutePlan) -> list[str]:
    """Return the problems of a RoutePlan's charger as sentences."""
    problems = []
    for field, ((low, high), unit, unset_means) in FIELDS.items():
        value = getattr(message, field)
        if not (value == 0.0 or math.isnan(value) or low <= value <= high):
            problems.append(f'{field}: {figure_beyond(value, low, high)} is not allowed; it must be '
                            f'{figure(low)} ... {figure(high)}{unit}, or 0 or NaN: {unset_means}')
    for field, ((low, high), unit, zero_means) in PROSPECT_FIELDS.items():
        value = getattr(message, field)
        if not low <= value <= high:
            problems.append(f'{field}: {figure_beyond(value, low, high)} is not allowed; it must be '
                            f'{figure(low)} ... {figure(high)}{unit} (0: {zero_means})')
    return problems


def prospect_from_message(message: RoutePlan) -> ChargingProspect:
    """Return the ChargingProspect at the end of a valid RoutePlan."""
    return prospect_of(*(getattr(message, field) for field in PROSPECT_FIELDS))


def write_prospect(message: RoutePlan, prospect: ChargingProspect) -> None:
    """Write a ChargingProspect into a RoutePlan."""
    for field, value in zip(PROSPECT_FIELDS, figures_of(prospect)):
        setattr(message, field, value)


def charger_from_message(message: RoutePlan) -> Charger | None:
    """Return the Charger of a valid RoutePlan; None: unknown."""
    return charger_of(message.charger_power, message.charging_departure_soc)


def write_charger(message: RoutePlan, charger: Charger | None) -> None:
    """Write a Charger into a RoutePlan; None: unknown."""
    message.charger_power = charger.power_w if charger else 0.0
    message.charging_departure_soc = (charger.departure_soc or 0.0) if charger else 0.0
