# SPDX-License-Identifier: Apache-2.0
"""Makers' rules: the instant at which the heater starts, and the heat until target or arrival."""

from dataclasses import replace

from drives import route_of
import numpy as np
import pytest

from bev_preheat.planning.maker_rules import MAKER_RULES, plan_by_rule
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatingGates

REFERENCE = load_vehicle('reference')


def drive(minutes=80, ambient_c=-3.0):
    """Return a Route of one-minute steps."""
    return route_of((minutes, 15e3), step_s=60.0, ambient_c=ambient_c)


@pytest.mark.parametrize('rule, ambient_c, minutes, start_min', [
    ('20 min', -20.0, 80, 60.0), ('30 min', -20.0, 80, 50.0), ('30 min', 3.0, 25, 0.0),
    ('30/60 min', -6.6, 80, 50.0), ('30/60 min', -7.0, 80, 20.0), ('30/60 min', -7.0, 45, 0.0),
    # 1.2 km a minute.
    ('30 km', -20.0, 80, 55.0), ('30 km', 3.0, 20, 0.0)])
def test_the_rule_alone_decides_when_the_heater_starts(rule, ambient_c, minutes, start_min):
    assert MAKER_RULES[rule].start_s(drive(minutes, ambient_c)) == pytest.approx(60.0 * start_min)


def test_a_cold_start_counts_where_the_car_is_an_hour_before_arrival():
    route = drive(80, -3.0)
    cold = np.where(np.arange(80) < 20, -3.0, -10.0)
    mild_then = np.where(np.arange(80) == 20, -3.0, -10.0)
    assert [MAKER_RULES['30/60 min'].start_s(replace(route, ambient_temperature_c=air_c))
            for air_c in (cold, mild_then)] == pytest.approx([1200.0, 3000.0])


def test_the_heater_is_at_full_power_until_the_target_or_the_arrival():
    route, state = drive(), BatteryState(-3.0, 0.9)
    late = plan_by_rule('20 min', REFERENCE, route, state, Goal(25.0))
    assert late.hvch_battery_power_w == pytest.approx([0.0] * 60 + [7000.0 - 1500.0] * 20)
    assert late.arrival_temperature_c < 25.0 and late.shortfall_k == 25.0 - late.arrival_temperature_c
    early = plan_by_rule('30 min', REFERENCE, route, state, Goal(18.0))
    heated, temperature_c = early.hvch_battery_power_w > 0.0, early.battery_temperature_c
    assert heated[50] and not heated[:50].any() and not heated[-1]
    assert (temperature_c[:-1][heated] < 18.0).all() and (temperature_c[50:-1][~heated[50:]] >= 18.0).all()


def test_the_rule_keeps_the_gates_of_the_car():
    gated = replace(REFERENCE, heating_gates=HeatingGates(maximum_temperature_c=12.0))
    plan = plan_by_rule('30 min', gated, drive(), BatteryState(-3.0, 0.9), Goal(25.0))
    heated, temperature_c = plan.hvch_battery_power_w > 0.0, plan.battery_temperature_c
    assert heated[50] and temperature_c[1:][heated].max() < 12.0
