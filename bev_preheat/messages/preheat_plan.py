# SPDX-License-Identifier: Apache-2.0
"""PreheatPlan and the predicted temperature: written from a Decision, and the charging session read as text."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from builtin_interfaces.msg import Time
import numpy as np
from sensor_msgs.msg import Temperature

from bev_preheat.messages.fields import doubles, time_message
from bev_preheat.numerics import NS_PER_S, WH_PER_KWH
from bev_preheat.planning.explanation import duration_text
from bev_preheat_msgs.msg import PreheatPlan

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.control.decision import Decision
    from bev_preheat.control.inputs import Mission
    from bev_preheat.control.target import TargetChoice
    from bev_preheat.planning.plan import Plan

# Fields of the message that are NaN without a plan, by the fields of Plan.
PLAN_FIELDS = {
    'arrival_temperature_c': 'predicted_arrival_temperature',
    'arrival_soc': 'predicted_arrival_soc',
    'target_temperature_c': 'target_battery_temperature',
    'shortfall_k': 'shortfall',
    'soc_shortfall': 'soc_shortfall',
    'undeliverable_power_w': 'undeliverable_power',
}
# By the fields of Energies.
ENERGY_FIELDS = {
    'joule': 'joule_energy',
    'drivetrain_heat': 'drivetrain_heat_energy',
    'hvch_electric': 'hvch_electric_energy',
    'hvch_heat': 'hvch_heat_energy',
    'leakage': 'leakage_energy',
    'battery_total': 'battery_energy',
}
# By the fields of TargetChoice; NaN without one.
TARGET_FIELDS = {
    'charging_time_s': 'charging_time', 'unheated_charging_time_s': 'charging_time_unheated',
    'bought_energy_wh': 'bought_energy', 'unheated_bought_energy_wh': 'bought_energy_unheated'}
TRAJECTORIES = {'time_s': 'time', 'battery_temperature_c': 'battery_temperature', 'soc': 'soc',
                'hvch_battery_power_w': 'hvch_power'}
# A session beyond these limits [s, Wh] is treated as unset.
LATEST_CHARGED_S, MOST_WH = 1e7, 1e9


def plan_message(decision: Decision, mission: Mission | None, now_ns: int,
                 later_decisions: Sequence[Decision] = ()) -> PreheatPlan:
    """Return the PreheatPlan of a Decision, NaN without a plan; `later_decisions`: legs after the next stop."""
    plan = decision.plan
    message = PreheatPlan(status=int(decision.status), explanation=decision.explanation)
    message.header.stamp = time_message(decision.plan_start_ns if plan else now_ns)
    if mission is not None:
        message.route_id, message.delay = mission.route_id, mission.delay_ns / NS_PER_S
        message.propulsion_power_source = mission.power_source
    _write_later(message, later_decisions)
    _write_target(message, decision.target)
    message.charge_runs_out_distance = message.lacking_energy = message.maximum_arrival_temperature = math.nan
    if plan is None:
        message.predicted_arrival_temperature_deviation = math.nan
        for name in (*PLAN_FIELDS.values(), *ENERGY_FIELDS.values()):
            setattr(message, name, math.nan)
    else:
        _write_plan(message, decision, plan)
    return message


def _write_plan(message: PreheatPlan, decision: Decision, plan: Plan) -> None:
    for fields, source in ((PLAN_FIELDS, plan), (ENERGY_FIELDS, plan.energy_wh)):
        for field, name in fields.items():
            setattr(message, name, getattr(source, field))
    for field, name in TRAJECTORIES.items():
        setattr(message, name, doubles(getattr(plan, field)))
    if math.isfinite(plan.maximum_arrival_temperature_c):
        message.maximum_arrival_temperature = plan.maximum_arrival_temperature_c
    message.heat_source_name = list(plan.source_power_w)
    message.heat_source_power = doubles(np.array([*plan.source_power_w.values()]))
    message.method, message.planning_time = plan.method, plan.planning_time_s
    message.predicted_arrival_temperature_deviation = decision.arrival_deviation_k
    message.model_factors = doubles(decision.model_factors)
    message.heating_planned = plan.heating_start_s is not None
    message.heating_start = _instant(decision, plan.heating_start_s)
    message.arrival = _instant(decision, plan.arrival_time_s)
    if message.heating_planned:
        message.heating_end = _instant(
            decision, plan.arrival_time_s if plan.heating_end_s is None else plan.heating_end_s)
    if plan.stranding is not None:
        message.charge_runs_out = _instant(decision, plan.stranding.at_s)
        message.charge_runs_out_distance = plan.stranding.at_m
        message.lacking_energy = plan.stranding.deficit_wh
    if plan.heat is not None:
        message.heater_power = doubles(plan.heat.heater_power_w)
        message.coolant_excess_temperature = doubles(plan.heat.coolant_excess_k)
    message.stretch_start = [interval.start_s for interval in plan.intervals]
    message.stretch_end = [interval.end_s for interval in plan.intervals]
    message.stretch_energy = [interval.energy_wh for interval in plan.intervals]
    message.stretch_reason = bytes(int(interval.reason) for interval in plan.intervals)


def _write_later(message: PreheatPlan, decisions: Sequence[Decision]) -> None:
    for decision in decisions:
        plan = decision.plan
        message.later_heating_start.append(_instant(decision, plan.heating_start_s if plan else None))
        message.later_arrival.append(_instant(decision, plan.arrival_time_s if plan else None))
        message.later_predicted_arrival_temperature.append(plan.arrival_temperature_c if plan else math.nan)
        message.later_predicted_arrival_soc.append(plan.arrival_soc if plan else math.nan)
    message.later_status = bytes(int(decision.status) for decision in decisions)


def _write_target(message: PreheatPlan, choice: TargetChoice | None) -> None:
    for field, name in TARGET_FIELDS.items():
        setattr(message, name, math.nan if choice is None else getattr(choice, field))
    doubt = None if choice is None else choice.doubt
    message.charging_probability = math.nan if doubt is None else doubt.probability
    message.heating_pays_from_probability = math.nan if doubt is None else doubt.pays_from
    if choice is not None:
        message.target_source = int(choice.source)
        message.target_reason = choice.reason


def _instant(decision: Decision, after_s: float | None) -> Time:
    """Return the instant `after_s` [s] after a plan's start as a Time message; None: 0."""
    return Time() if after_s is None else time_message(decision.plan_start_ns + round(after_s * NS_PER_S))


def temperature_message(decision: Decision, now_ns: int) -> Temperature | None:
    """Return the predicted arrival temperature of a Decision, None without a plan; variance 0 means unknown."""
    plan, deviation_k = decision.plan, decision.arrival_deviation_k
    if plan is None:
        return None
    message = Temperature(temperature=plan.arrival_temperature_c,
                          variance=0.0 if math.isnan(deviation_k) else deviation_k**2)
    message.header.stamp = time_message(now_ns)
    return message


def charging_text(plan: PreheatPlan) -> str:
    """Return the charging sessions of a PreheatPlan, with its target and without heating; '' if unknown."""
    if plan.target_source == PreheatPlan.TARGET_UNKNOWN:
        return ''
    heated = _session_text(plan.charging_time, plan.bought_energy)
    unheated = _session_text(plan.charging_time_unheated, plan.bought_energy_unheated)
    return f'{heated}; without heating {unheated}' if heated and unheated else ''


def _session_text(time_s: float, energy_wh: float) -> str:
    if time_s == math.inf:
        return 'never ends'
    if not (0.0 <= time_s < LATEST_CHARGED_S and 0.0 <= energy_wh < MOST_WH):
        return ''
    return f'{duration_text(time_s)}, {energy_wh / WH_PER_KWH:.2f} kWh'
