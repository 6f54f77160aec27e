# SPDX-License-Identifier: Apache-2.0
"""Routes of a few parts with constant propulsion power, and drawn segments."""

from hypothesis import strategies as st
import numpy as np

from bev_preheat.route.segments import make_route


def route_of(*parts, step_s=30.0, speed_mps=20.0, rms=1.0, ambient_c=-12.0, cabin_w=1500.0, auxiliary_w=400.0):
    """Return a Route of parts (number of steps, propulsion power [W]); `rms` is its share of the power."""
    power_w = np.concatenate([np.full(count, float(value)) for count, value in parts])
    return make_route({
        'duration_s': [step_s], 'speed_mps': [speed_mps], 'propulsion_power_w': power_w,
        'propulsion_power_rms_w': rms * np.abs(power_w), 'ambient_temperature_c': [ambient_c],
        'cabin_heating_power_w': np.broadcast_to(cabin_w, len(power_w)), 'auxiliary_power_w': [auxiliary_w]}, None)


def segments(min_size=1, max_size=40, **ranges):
    """Return a strategy of lists of segments; `ranges` are the (least, most) of more or other columns."""
    return st.lists(st.fixed_dictionaries({name: st.floats(*ends) for name, ends in {
        'duration_s': (1.0, 90.0), 'speed_mps': (0.0, 35.0), 'ambient_temperature_c': (-25.0, 10.0),
        'cabin_heating_power_w': (0.0, 8e3), 'auxiliary_power_w': (0.0, 2e3), **ranges}.items()}),
        min_size=min_size, max_size=max_size)


def columns_of(drawn):
    """Return the columns of drawn segments, as arrays (N,); `deviation_w` [W] becomes the root mean square."""
    columns = {name: np.array([segment[name] for segment in drawn]) for name in drawn[0]}
    if 'deviation_w' in columns:
        columns['propulsion_power_rms_w'] = np.hypot(columns['propulsion_power_w'], columns.pop('deviation_w'))
    return columns
