# SPDX-License-Identifier: Apache-2.0
"""
A fleet on two workers
======================

What does preheating save a fleet at the charger over a winter? Each trip is independent, so
``concurrent.futures`` spreads the trips over processes. Trips are drawn from a seed and their number: the
result is the same on any number of workers. :doc:`/explanation/how_good` has the large study,
``python3 -m bev_preheat_studies fleet``.
"""

from concurrent.futures import ProcessPoolExecutor
import multiprocessing

import matplotlib.pyplot as plt
import numpy as np

import bev_preheat as bp

CARS = ('small_hatchback', 'mid_size_lfp', 'large_suv')
TRIPS = 48


def savings_of(number):
    """Return car, ambient temperature [°C], saved minutes and extra energy [kWh] of trip `number`."""
    random = np.random.default_rng([2024, number])
    car = CARS[number % len(CARS)]
    vehicle = bp.load_vehicle(car)
    ambient_c = random.normal(-3.0, 6.0)
    minutes = int(random.integers(30, 76))
    speed_mps = random.uniform(80.0, 120.0) / 3.6
    power_w = 12.0 * speed_mps ** 2 + 6e3 + random.normal(0.0, 2e3, minutes)
    route = bp.make_route({'duration_s': np.full(minutes, 60.0), 'speed_mps': speed_mps,
                           'propulsion_power_w': power_w, 'ambient_temperature_c': ambient_c}, vehicle)
    state = bp.BatteryState(ambient_c, soc=0.7)
    worth = bp.worth(vehicle, route, state, charger_power_w=150e3, departure_soc=0.8).to_dict()
    best, without = worth['best'], worth['without_heating']
    return (car, ambient_c, (without['charging_time_s'] - best['charging_time_s']) / 60.0,
            (best['bought_energy_wh'] - without['bought_energy_wh']) / 1e3)


# %%
# Two workers
# -----------
# A script that starts processes needs the line with ``__main__``, because each worker imports the script.

if __name__ == '__main__':
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context('fork')) as workers:
        trips = list(workers.map(savings_of, range(TRIPS), chunksize=4))

    for car in CARS:
        saved_min = np.array([trip[2] for trip in trips if trip[0] == car])
        energy_kwh = np.array([trip[3] for trip in trips if trip[0] == car])
        print(f'{car:15}: median {np.median(saved_min):4.1f} min for {np.median(energy_kwh):4.2f} kWh; '
              f'one trip in ten {np.quantile(saved_min, 0.9):4.1f} min or more')

# %%
# Savings over the weather
# ------------------------
# One point is one trip. The colder the day, the more minutes a warm battery saves. A short trip leaves no
# time to heat a large battery, so the points of one car lie far apart.

if __name__ == '__main__':
    figure, (saved, energy) = plt.subplots(2, 1, sharex=True, figsize=(8.0, 6.0), layout='constrained')
    for car, colour, mark in zip(CARS, ('#0072B2', '#E69F00', '#009E73'), 'os^', strict=True):
        own = [trip for trip in trips if trip[0] == car]
        _, ambient_c, saved_min, extra_kwh = zip(*own, strict=True)
        saved.plot(ambient_c, saved_min, mark, color=colour, alpha=0.8, label=car)
        energy.plot(ambient_c, extra_kwh, mark, color=colour, alpha=0.8)
    saved.set_ylabel('time saved at the charger [min]')
    saved.legend()
    energy.set_ylabel('energy bought beyond that\nwithout preheating [kWh]')
    energy.set_xlabel('ambient temperature [°C]')
    for axes in (saved, energy):
        axes.grid(alpha=0.3)
    plt.show()
