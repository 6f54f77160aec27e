# SPDX-License-Identifier: Apache-2.0
"""Voltages that are not this battery's, and a charge of 0 that the voltage contradicts."""

import pytest

from bev_preheat.estimation.electrical import electrical_check
from bev_preheat.vehicle import load_vehicle

# U = 365 + 75 s + 15 s^3 [V], R = 4.3125 / (T + 45) [ohm].
CHECK = electrical_check(load_vehicle('reference'))


def voltage_v(soc, temperature_c, current_a):
    """Return the terminal voltage [V] by hand."""
    return 365.0 + 75.0 * soc + 15.0 * soc**3 - 4.3125 / (temperature_c + 45.0) * current_a


@pytest.mark.parametrize('volts', [12.6, 16.0, 24.0, 65.535, 300.0, 640.0])
def test_a_voltage_of_another_battery_is_named(volts):
    doubt = CHECK.voltage_doubt(volts, 45.0, 5.0, 0.8)
    assert doubt.startswith(
        f'voltage: {volts:g} V is not that of this battery: 429 V are expected at 80.0 % and 45 A')


@pytest.mark.parametrize('current_a', [-300.0, 0.0, 45.0, 600.0])
@pytest.mark.parametrize('temperature_c', [-30.0, 5.0, 45.0])
@pytest.mark.parametrize('soc', [0.05, 0.5, 1.0])
@pytest.mark.parametrize('share', [0.85, 1.0, 1.15])
def test_a_pack_that_is_near_its_file_is_believed(soc, temperature_c, current_a, share):
    volts = share * voltage_v(soc, temperature_c, 0.0) - (4.3125 / (temperature_c + 45.0)) * current_a
    assert CHECK.voltage_doubt(volts, current_a, temperature_c, soc) == ''


def test_a_charge_of_0_contradicts_the_voltage_of_a_fuller_battery():
    assert CHECK.charge_doubt(394.5, 47.0, 5.0, 0.0) == (
        'percentage: 0.0 % contradicts 394.5 V: an empty battery has 360.9 V; the field may not be set')
    for soc, contradicts in ((0.0, False), (0.05, False), (0.2, True), (0.6, True), (1.0, True)):
        assert bool(CHECK.charge_doubt(voltage_v(soc, 5.0, 47.0), 47.0, 5.0, 0.0)) is contradicts
    # An unset field reads 0.
    assert CHECK.charge_doubt(394.5, 47.0, 5.0, 0.02) == ''


def test_the_voltage_vouches_for_a_charge_or_for_its_hundredth():
    full, empty = voltage_v(0.8, 5.0, 47.0), voltage_v(0.008, 5.0, 47.0)
    assert CHECK.is_nearer(full, 47.0, 5.0, 0.8, 0.008)
    assert not CHECK.is_nearer(empty, 47.0, 5.0, 0.8, 0.008)
