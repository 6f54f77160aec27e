# SPDX-License-Identifier: Apache-2.0
"""
A wrong model in closed loop
============================

A plan is only as good as its model. In a car the planner plans again on each battery state, and learns from
the drive: how much heat the battery stores, how much leaks away, whether the heater answers. Here the true
car is not that of the vehicle file. :doc:`/explanation/estimation` explains the estimate,
:doc:`/explanation/how_good` has many drives.
"""

import matplotlib.pyplot as plt

import bev_preheat as bp

vehicle = bp.load_vehicle('reference')
route = bp.load_route('reference', vehicle)
state = bp.BatteryState(temperature_c=-7.0, soc=0.9)

# %%
# Three cars
# ----------
# The first differs from its file in all that the model knows, and its sensor shows whole degrees, with noise.
# The heater of the second gives only half of the commanded power. The heater of the third fails after 42 min.

wrong = bp.Mismatch(heat_capacity=1.12, leakage=1.3, resistance=0.9, propulsion_power=1.05)
coarse = bp.Sensors(temperature_resolution_k=1.0, temperature_noise_k=0.2, current_noise_a=2.0)
faults = {'wrong model, coarse sensor': [],
          'and a heater with half of its power': [bp.HeaterFault(0.0, share=0.5)],
          'and a heater that fails after 42 min': [bp.HeaterFault(42 * 60.0, share=0.0)]}
drives = {name: bp.drive(vehicle, route, state, mismatch=wrong, sensors=coarse, heater_faults=each)
          for name, each in faults.items()}
for name, drive in drives.items():
    print(f'{name:37}: {drive.arrival_error_k:+6.2f} K on arrival, heater {drive.heater_verdict}')

# %%
# The drives
# ----------
# A plan that trusts the file starts heating after 32 min. The planner knows its uncertainty: it starts ten
# minutes earlier, switches off once the target is certain, and arrives within a fraction of a kelvin. A weak
# heater shows only when it is used: the prediction drops within a quarter of an hour, and the heater then
# stays on until arrival, too late for the target. After a failure the prediction follows the battery down.
# Both faults are reported as a derated heater (:doc:`/reference/diagnostics`).

trusting = bp.plan(vehicle, route, state)
print(f'a plan that trusts the file starts heating after {trusting.heating_start_s / 60.0:.0f} min')
for name, drive in drives.items():
    print(f'{name}: after {drive.time_s[drive.command_w > 0.0][0] / 60.0:.0f} min')

figure, (temperature, prediction, heater) = plt.subplots(
    3, 1, sharex=True, figsize=(8.0, 7.5), layout='constrained')
for (name, drive), colour in zip(drives.items(), ('#0072B2', '#E69F00', '#D55E00'), strict=True):
    minutes = drive.time_s / 60.0
    temperature.plot(minutes, drive.true_temperature_c, color=colour, label=name)
    prediction.plot(minutes, drive.predicted_arrival_temperature_c, color=colour)
    heater.plot(minutes, drive.command_w / 1e3, color=colour)
for axes in (temperature, prediction):
    axes.axhline(25.0, color='gray', linestyle=':', label='target')
temperature.set_ylabel('true battery\ntemperature [°C]')
prediction.set_ylabel('predicted temperature\non arrival [°C]')
heater.set_ylabel('heater command [kW]')
heater.set_xlabel('time since the start [min]')
temperature.legend()
for axes in (temperature, prediction, heater):
    axes.grid(alpha=0.3)
plt.show()
