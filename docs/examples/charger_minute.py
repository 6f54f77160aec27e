# SPDX-License-Identifier: Apache-2.0
"""
The cost of a minute at the charger
===================================

Preheating costs energy and saves time at the charger. Whether it pays depends on the price of energy and on
the value of the driver's time. ``charging_session`` simulates the session, ``worth`` compares all targets.
:doc:`/explanation/worth` has the theory.
"""

import matplotlib.pyplot as plt
import numpy as np

import bev_preheat as bp

vehicle = bp.load_vehicle('mid_size_lfp')
CHARGER_W = 150e3

# %%
# Cold and warm
# -------------
# The same session, from 10 to 80 %, for three temperatures on arrival. The car heats its battery while it
# charges.

figure, (charging, share) = plt.subplots(2, 1, sharex=True, figsize=(8.0, 6.0), layout='constrained')
for arrival_c, colour in ((-5.0, '#0072B2'), (10.0, '#009E73'), (25.0, '#D55E00')):
    session = bp.charging_session(
        vehicle, bp.BatteryState(arrival_c, soc=0.10), CHARGER_W, departure_soc=0.80, ambient_c=-10.0)
    label = (f'{arrival_c:+.0f} °C on arrival: {session.charging_time_s / 60.0:.0f} min, '
             f'{session.bought_energy_wh / 1e3:.1f} kWh bought')
    minutes = session.time_s / 60.0
    charging.stairs(session.charging_power_w / 1e3, minutes, color=colour, baseline=None, label=label)
    share.plot(minutes, 100.0 * session.soc, color=colour)
charging.set_ylabel('charging power [kW]')
charging.legend()
share.set_ylabel('state of charge [%]')
share.set_xlabel('time at the charger [min]')
for axes in (charging, share):
    axes.grid(alpha=0.3)
plt.show()

# %%
# The best target for each value of time
# --------------------------------------
# An hour's drive to the charger at -10 °C; energy costs 0.50 for each kWh, in any currency. ``worth`` finds
# the target that costs least in energy and time. Repeated over the value of an hour, it shows when heating
# starts to pay, and the price of the saved minutes.

route = bp.load_route('legs/reference', vehicle)
state = bp.BatteryState(temperature_c=-10.0, soc=0.9)
values_per_h = np.geomspace(0.5, 50.0, 21)
results = [bp.worth(vehicle, route, state, CHARGER_W, departure_soc=0.80, energy_price_per_kwh=0.50,
                    value_of_time_per_h=value) for value in values_per_h]
print(results[-1].verdict)

arrival_c = [each.to_dict()['best']['arrival_temperature_c'] for each in results]
saved_min = [each.saved_charging_time_s / 60.0 for each in results]
bought_wh = [[each.to_dict()[case]['bought_energy_wh'] for case in ('best', 'without_heating')]
             for each in results]
extra_cost = [0.50 * (best_wh - unheated_wh) / 1e3 for best_wh, unheated_wh in bought_wh]
for value, saved, cost in list(zip(values_per_h, saved_min, extra_cost, strict=True))[::5]:
    print(f'an hour is worth {value:5.2f}: {saved:4.1f} min saved for {cost:.2f}')

figure, (target, minutes_saved) = plt.subplots(
    2, 1, sharex=True, figsize=(8.0, 5.5), layout='constrained')
target.plot(values_per_h, arrival_c, 'o-', color='#D55E00')
target.set_ylabel('best battery temperature\non arrival [°C]')
minutes_saved.plot(values_per_h, saved_min, 'o-', color='#0072B2')
minutes_saved.set_ylabel('time saved at\nthe charger [min]')
minutes_saved.set_xlabel('value of an hour at the charger [currency/h]')
minutes_saved.set_xscale('log')
break_even_per_h = results[0].break_even_value_of_time_per_h
for axes in (target, minutes_saved):
    axes.axvline(break_even_per_h, color='gray', linestyle='--',
                 label=f'heating pays from {break_even_per_h:.2f} an hour')
    axes.grid(alpha=0.3, which='both')
target.legend(loc='lower right')
minutes_saved.xaxis.set_major_formatter('{x:g}')
plt.show()
