# SPDX-License-Identifier: Apache-2.0
"""
Identify synthetic cars: python3 -m bev_preheat_studies.identification --help.

Prints for each parameter the errors and the coverage of the 90 % intervals.
"""

from __future__ import annotations

import argparse

from bev_preheat.console.terminal import print_records, result_console
from bev_preheat_studies.identification.study import study_car, summary


def main() -> None:
    """Run the study and print its table."""
    parser = argparse.ArgumentParser(prog='python3 -m bev_preheat_studies.identification',
                                     description='Identify synthetic cars and compare with the truth.')
    parser.add_argument('--cars', type=int, default=100)
    parser.add_argument('--first', type=int, default=0, help='seed of the first car')
    parser.add_argument('--vehicle', default='small_car', help='vehicle file around which cars are drawn')
    parser.add_argument('--without-heater', action='store_true')
    arguments = parser.parse_args()
    console, cars = result_console(), []
    for seed in range(arguments.first, arguments.first + arguments.cars):
        cars.append(study_car(arguments.vehicle, seed, not arguments.without_heater))
        last = cars[-1][0]
        console.print(f'car {seed}: {last.structure}, left out {last.left_out_rmse_k:.2f} K, '
                      f'{last.duration_s:.1f} s',
                      markup=False)
    print_records(console, f'{arguments.cars} synthetic cars around {arguments.vehicle}',
                  ('parameter', 'cars', 'median error', '95 % error', 'coverage', 'identified'),
                  [(name, f'{count}', f'{100 * median:+.1f} %', f'{100 * most:.1f} %', f'{100 * covered:.0f} %',
                    f'{100 * identified:.0f} %')
                   for name, count, median, most, covered, identified in summary(cars)],
                  ('left', *['right'] * 5))


if __name__ == '__main__':
    main()
