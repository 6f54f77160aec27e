# SPDX-License-Identifier: Apache-2.0
"""Whole numbers in an itinerary are floats: a ROS message refuses integers there."""

from bev_preheat.control.itinerary import load_itinerary
from bev_preheat.vehicle.loading import load_vehicle

ITINERARY = """
name: whole_numbers
legs:
- {route: alpine_pass, target_battery_temperature_c: 20, minimum_arrival_soc: 0, stop_duration_s: 1200,
   departure_temperature_c: 25, departure_soc: 1}
- {route: alpine_pass, target_battery_temperature_c: 15}
"""


def test_whole_numbers_of_an_itinerary_are_floats(tmp_path):
    file = tmp_path / 'whole.yaml'
    file.write_text(ITINERARY)
    mission = load_itinerary(file, load_vehicle('reference')).mission
    first, second = mission.legs
    numbers = (first.target_temperature_c, first.minimum_arrival_soc, second.target_temperature_c,
               second.departure.temperature_c, second.departure.soc)
    assert numbers == (20.0, 0.0, 15.0, 25.0, 1.0)
    assert all(isinstance(number, float) for number in numbers)
