# SPDX-License-Identifier: Apache-2.0
"""
The alpine pass: heating for the descent
========================================

A cold battery takes little charging power. On a long descent the friction brakes then turn into heat the
energy that the drivetrain could have recovered. So it pays to heat the battery *before* the descent, an hour
before the charger. A plan with one switch-on, late, cannot do that. See :doc:`/explanation/planning` for the
method.
"""

import matplotlib.pyplot as plt
import numpy as np

import bev_preheat as bp

vehicle = bp.load_vehicle('reference')
route = bp.load_route('alpine_pass', vehicle)
state = bp.BatteryState(temperature_c=-10.0, soc=0.9)

# %%
# Three plans
# -----------
# ``compare`` returns the plans of all methods as they would be driven: a plan that ignores the battery's
# limits loses the power that the battery refuses.

compared = bp.compare(vehicle, route, state)
best, paper = compared.plans['value_function'], compared.plans['paper']
print('               from the cells   heating    brakes   on arrival')
for name, plan in (('value_function', best), ('paper', paper), ('optimum', compared.optimum)):
    braked_wh = float(plan.friction_brake_power_w @ np.diff(plan.time_s)) / 3600.0
    print(f'{name:15}{plan.battery_energy_wh:11.0f} Wh{plan.heating_energy_wh:7.0f} Wh'
          f'{braked_wh:7.0f} Wh{plan.arrival_temperature_c:10.1f} °C')

# %%
# Each interval of heating has a reason: ``DESCENT`` warms the battery in advance, ``SURPLUS`` uses power that
# would otherwise be braked away, ``ARRIVAL`` is for the charger.

for reason in ('DESCENT', 'SURPLUS', 'ARRIVAL'):
    intervals = [each for each in best.to_dict()['stretches'] if each['reason'] == reason]
    start_min, end_min = intervals[0]['start_s'] / 60.0, intervals[-1]['end_s'] / 60.0
    print(f'{reason:8} {start_min:4.1f} ... {end_min:4.1f} min: '
          f'{sum(each["energy_wh"] for each in intervals):5.0f} Wh')

# %%
# The drive
# ---------
# Negative power charges the battery; the shaded region is not allowed. ``value_function`` heats on the climb,
# and the limit falls just far enough for the descent. The paper's plan begins the descent with a colder
# battery: its power is cut off at the limit, and the friction brakes take the rest.

figure, (temperature, heater, power, brake) = plt.subplots(
    4, 1, sharex=True, figsize=(8.0, 9.0), layout='constrained', height_ratios=(1.3, 0.8, 1.6, 0.8))
for plan, name, colour in ((best, 'value_function', '#0072B2'),
                           (paper, "the paper's plan, driven", '#009E73')):
    minutes = plan.time_s / 60.0
    temperature.plot(minutes, plan.battery_temperature_c, color=colour, label=name)
    heater.stairs(plan.hvch_battery_power_w / 1e3, minutes, color=colour, baseline=None, linewidth=1.5)
    power.stairs(plan.battery_power_w / 1e3, minutes, color=colour, baseline=None, label=name)
    power.plot(minutes, plan.charge_limit_w / 1e3, color=colour, linestyle='--', linewidth=1.0,
               label=f'charge limit, {name}')
    brake.stairs(plan.friction_brake_power_w / 1e3, minutes, color=colour, fill=True, alpha=0.6)
power.fill_between(best.time_s / 60.0, best.charge_limit_w / 1e3, -100.0, color='#0072B2', alpha=0.12)
power.axhline(0.0, color='black', linewidth=0.6)
power.set_ylim(-40.0, 55.0)
temperature.axhline(25.0, color='gray', linestyle=':', label='target')
temperature.set_ylabel('battery\ntemperature [°C]')
heater.set_ylabel('heater power for\nthe battery [kW]')
power.set_ylabel('battery power [kW]')
brake.set_ylabel('friction brake\n[kW]')
brake.set_xlabel('time since the start [min]')
temperature.legend()
power.legend(ncols=2, fontsize='small', loc='lower right')
for axes in (temperature, heater, power, brake):
    axes.grid(alpha=0.3)
plt.show()
