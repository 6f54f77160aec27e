# SPDX-License-Identifier: Apache-2.0
"""
When to heat: a map over ambient temperature and trip length
============================================================

The later the heater starts, the less heat leaks away; if it starts too late, the battery arrives cold. The
right moment depends on the weather and on the length of the trip, because a long drive warms the battery by
itself. A plan takes less than a millisecond, so a map of two thousand trips is drawn in a second.
"""

import matplotlib.pyplot as plt
import numpy as np

import bev_preheat as bp

vehicle = bp.load_vehicle('mid_size_lfp')
TARGET_C = 25.0

# %%
# A grid of trips
# ---------------
# ``make_route`` takes columns of numbers; a single number holds for all segments. The car drives 100 km/h at
# a steady propulsion power of 17 kW, in segments of a minute. It was parked outside, so the battery starts as
# cold as the air.

ambient_c = np.linspace(-20.0, 20.0, 33)
trip_min = np.arange(10, 121, 2)
heating_min = np.zeros((len(ambient_c), len(trip_min)))
missed_k = np.zeros_like(heating_min)

for row, outside_c in enumerate(ambient_c):
    for column, minutes in enumerate(trip_min):
        route = bp.make_route({'duration_s': np.full(minutes, 60.0), 'speed_mps': 100.0 / 3.6,
                               'propulsion_power_w': 17e3, 'ambient_temperature_c': outside_c}, vehicle)
        plan = bp.plan(vehicle, route, bp.BatteryState(outside_c, soc=0.9), TARGET_C)
        if plan.heating_start_s is not None:
            heating_min[row, column] = minutes - plan.heating_start_s / 60.0
        missed_k[row, column] = max(0.0, TARGET_C - plan.arrival_temperature_c)

print(f'{heating_min.size} plans; the longest heating lasts {heating_min.max():.0f} min')

# %%
# The map
# -------
# Read it so: at -10 °C, on a trip of 90 min, heating starts as many minutes before arrival as the colour
# says. In the hatched region the trip is too short: the heater runs from the start and the battery still
# arrives colder than wanted. The lines say by how many kelvin.

figure, axes = plt.subplots(figsize=(8.0, 5.2), layout='constrained')
colours = axes.pcolormesh(trip_min, ambient_c, heating_min, shading='nearest', cmap='cividis')
figure.colorbar(colours, label='heating starts before arrival [min]')
axes.contourf(trip_min, ambient_c, missed_k, levels=[0.5, 100.0], colors='none', hatches=['///'])
lines = axes.contour(trip_min, ambient_c, missed_k, levels=[0.5, 5.0, 10.0, 20.0, 30.0], colors='white')
axes.clabel(lines, fmt=lambda kelvin: f'{kelvin:g} K short')
axes.set_xlabel('trip length [min]')
axes.set_ylabel('ambient temperature, also of the battery at the start [°C]')
axes.set_title(f'{vehicle.name}: target {TARGET_C:.0f} °C, steady 100 km/h')
plt.show()
