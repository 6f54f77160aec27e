# SPDX-License-Identifier: Apache-2.0
"""A sensor with an offset, with and without a known standing time."""

from dataclasses import replace

import pytest

from bev_preheat.planning.situation import Goal
from bev_preheat.simulation.scenario import load_scenario
from bev_preheat.simulation.scenario_drive import drive_scenario


@pytest.mark.deep
@pytest.mark.costly
def test_the_car_arrives_nearer_to_its_target_where_it_is_known_how_long_it_stood():
    known = load_scenario('sensor_offset')
    known = replace(known, route=known.route.before(600.0), goal=Goal(-1.0))
    errors_k = [drive_scenario(scenario).arrival_c - scenario.goal.target_temperature_c
                for scenario in (known, replace(known, standing_time_s=0.0))]
    offset_k = known.imperfections.sensors.temperature_offset_k
    # Without it, the whole offset is missing on arrival.
    assert errors_k[1] == pytest.approx(-offset_k, abs=0.3)
    assert errors_k[0] > errors_k[1] + 0.5
