# SPDX-License-Identifier: Apache-2.0
"""
Your own car from its data sheet
================================

``make_vehicle`` needs an energy, a voltage or a number of cells, the chemistry and the charging power; other
values are assumed. The figures below are those of a mid-size car. :doc:`/tutorials/your_car` makes the same
car on the command line, as a file that you can correct value by value.
"""

import matplotlib.pyplot as plt

import bev_preheat as bp

sheet = {'chemistry': 'nmc', 'usable_energy_kwh': 77.0, 'gross_energy_kwh': 82.0,
         'battery_mass_kg': 493.0, 'cells_in_series': 96, 'charging_power_kw': 135.0,
         'vehicle_mass_kg': 2200.0}
car = bp.make_vehicle('my car', **sheet)

# %%
# Assumed values
# --------------
# Each vehicle lists its assumed values. Plans are only as good as these.

print(f'{len(car.assumed)} values are assumed:')
for key in car.assumed:
    print(f'  {key}')

# %%
# Implausible figures are refused: a wrong unit is the most frequent mistake.

try:
    bp.make_vehicle('my car', **{**sheet, 'charging_power_kw': 135e3})
except bp.InvalidInput as error:
    print(error)

# %%
# How much do assumptions matter?
# -------------------------------
# The power of the heater is missing in the data sheet. Three cars with different heaters drive the same road;
# the cabin takes 2 kW of each. With 8 kW the plan can wait; 4 kW and 6 kW heat from the start and miss the
# target. Routes given as legs of road use the car's own mass and air resistance.

figure, (temperature, heater) = plt.subplots(2, 1, sharex=True, figsize=(8.0, 5.5), layout='constrained')
for heater_kw, colour in ((4.0, '#0072B2'), (6.0, '#E69F00'), (8.0, '#D55E00')):
    variant = bp.make_vehicle('my car', heater_power_kw=heater_kw, **sheet)
    route = bp.load_route('legs/reference', variant)
    plan = bp.plan(variant, route, bp.BatteryState(temperature_c=-7.0, soc=0.9))
    label = (f'{heater_kw:.0f} kW heater: {plan.arrival_temperature_c:.1f} °C, '
             f'{plan.heating_energy_wh / 1e3:.2f} kWh')
    minutes = plan.time_s / 60.0
    temperature.plot(minutes, plan.battery_temperature_c, color=colour, label=label)
    heater.stairs(plan.hvch_battery_power_w / 1e3, minutes, color=colour, baseline=None, linewidth=1.5)
temperature.axhline(25.0, color='gray', linestyle=':', label='target')
temperature.set_ylabel('battery temperature [°C]')
temperature.legend(title='battery on arrival, energy for heating')
heater.set_ylabel('heater power for\nthe battery [kW]')
heater.set_xlabel('time since the start [min]')
for axes in (temperature, heater):
    axes.grid(alpha=0.3)
plt.show()
