# SPDX-License-Identifier: Apache-2.0
"""Parameters and their settings."""

from math import nan

import pytest

from bev_preheat.control.settings import settings_of


@pytest.mark.parametrize('value, target_c', [
    (0.0, None), (-0.0, None), (nan, None), (12.5, 12.5), (-3.0, -3.0)])
def test_a_target_of_0_or_nan_is_the_vehicles(value, target_c):
    settings = settings_of({'target_battery_temperature': value})
    assert settings.target_temperature_c == target_c
