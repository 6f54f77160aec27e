# SPDX-License-Identifier: Apache-2.0
"""Recordings for tests: small, made by formulas of their own."""

import numpy as np

from bev_preheat.logs.recording import Recording, Series


def recording(name='drive', seconds=1200, **changes):
    """Return a Recording of a drive with a battery of 0.1 ohm and 380 V; a change of None removes a signal."""
    time_s = np.arange(float(seconds))
    current_a = 40.0 + 60.0 * np.sin(time_s / 7.0) + 20.0 * np.sin(time_s / 31.0)
    values = {
        'battery_temperature_c': np.round(5.0 + 5.0 * time_s / seconds), 'soc': 0.8 - np.cumsum(current_a) / 3.6e5,
        'voltage_v': 380.0 - 0.1 * current_a, 'current_a': current_a, 'speed_mps': np.full(seconds, 15.0),
        'ambient_c': np.full(seconds, 0.0), 'cabin_heater_w': np.full(seconds, 1000.0),
        'auxiliary_w': np.full(seconds, 400.0)}
    series = {key: Series(time_s, value) for key, value in values.items()}
    for key, change in changes.items():
        if change is None:
            series.pop(key, None)
        else:
            series[key] = change if isinstance(change, Series) else Series(time_s, change(series[key].value))
    return Recording(name, series)


def night(name='night', hours=8.0, start_c=15.0, ambient_c=-5.0, time_constant_s=4e4):
    """Return a Recording of a battery that cools with a time constant [s], one reading a minute, unrounded."""
    time_s = np.arange(0.0, hours * 3600.0, 60.0)
    still = np.zeros(len(time_s))
    values = {
        'battery_temperature_c': ambient_c + (start_c - ambient_c) * np.exp(-time_s / time_constant_s),
        'soc': still + 0.6, 'power_w': still, 'speed_mps': still, 'ambient_c': still + ambient_c,
        'cabin_heater_w': still, 'auxiliary_w': still}
    return Recording(name, {key: Series(time_s, value) for key, value in values.items()})
