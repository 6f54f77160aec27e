# SPDX-License-Identifier: Apache-2.0
"""
`python3 -m bev_preheat_studies.charger_heating`: heating at the charger always, never, and as chosen.

Draws cars that can heat there, arrivals and prices, each at chargers of 11, 22, 50 and 150 kW, and shows by
charger how much obeying the car and not heating cost above the choice of `preheat charge` and `preheat worth`.
"""

from __future__ import annotations

from argparse import RawDescriptionHelpFormatter
from dataclasses import asdict, dataclass, replace
import math
import sys
from typing import TYPE_CHECKING

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn

from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.stop import ChargingStop
from bev_preheat.charging.target_worth import Prices
from bev_preheat.console.output import add_json_argument, json_output, write_json
from bev_preheat.console.parser import OneLineParser
from bev_preheat.console.program import run_program
from bev_preheat.console.terminal import print_records, progress_bar, result_console
from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import check_outputs
from bev_preheat.numerics.factors import W_PER_KW
from bev_preheat.planning.situation import BatteryState
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.charging import charging_of
from bev_preheat_studies.optimality.charging_trips import (
    AMBIENT_C,
    ARRIVAL_SOC,
    CHARGED_SHARE,
    ENERGY_PRICE,
    HEATER,
    MOST_DEPARTURE_SOC,
    VALUE_OF_TIME,
    VEHICLES,
)

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Sequence

    from bev_preheat.vehicle import Vehicle

CHARGERS_W = (11e3, 22e3, 50e3, 150e3)
# Above the air on arrival [K]; for cars whose file names no limit of heating [deg C].
WARMER_K, LIMIT_C = (0.0, 25.0), 25.0
CABIN_W, AUXILIARY_W = (500.0, 3000.0), (200.0, 800.0)
PERCENT = 100.0


@dataclass(frozen=True)
class HeatedStop:
    """
    One stop: charger [W], air and battery on arrival [deg C], and the costs; infinite if a session never ends.

    `decision` is the value of the HeatingDecision, `chosen_s` its charging time [s].
    """

    number: int
    vehicle: str
    charger_w: float
    ambient_c: float
    arrival_c: float
    decision: str
    always: float
    never: float
    chosen: float
    chosen_s: float


def draw_stops(seed: int, number: int) -> list[HeatedStop]:
    """Return the HeatedStops of one drawn car and arrival, one for each of CHARGERS_W."""
    random = np.random.default_rng([seed, number])
    vehicle = _draw_vehicle(random)
    ambient_c = random.uniform(*AMBIENT_C)
    state = BatteryState(ambient_c + random.uniform(*WARMER_K), random.uniform(*ARRIVAL_SOC))
    departure_soc = min(state.soc + random.uniform(*CHARGED_SHARE), MOST_DEPARTURE_SOC)
    cabin_w = min(random.uniform(*CABIN_W), 0.8 * vehicle.hvch.maximum_power_w)
    auxiliary_w = random.uniform(*AUXILIARY_W)
    prices = Prices(random.uniform(*ENERGY_PRICE), random.uniform(*VALUE_OF_TIME))
    stops = []
    for charger_w in CHARGERS_W:
        choice = ChargerHeating(vehicle, ChargingStop(
            charger_w, departure_soc, ambient_c, cabin_w, auxiliary_w), prices).compare(state)
        stops.append(HeatedStop(number, vehicle.name, charger_w, ambient_c, state.temperature_c,
                                choice.decision.value, choice.cost_always, choice.cost_never, choice.cost,
                                choice.session.charging_time_s))
    return stops


def _draw_vehicle(random: np.random.Generator) -> Vehicle:
    vehicle = load_vehicle(str(random.choice(VEHICLES)))
    charging = charging_of(vehicle)
    return replace(
        vehicle, charging=replace(
            charging, battery_heating=True, heating_limit_c=charging.heating_limit_c or LIMIT_C),
        hvch=replace(vehicle.hvch, maximum_power_w=vehicle.hvch.maximum_power_w * random.uniform(*HEATER)))


def row(charger_w: float, stops: Sequence[HeatedStop]) -> tuple[str, ...]:
    """Return the row of one charger: decisions, and the excess cost of always and never over the choice."""
    ended = [stop for stop in stops if math.isfinite(stop.chosen)]
    figures = [f'{charger_w / W_PER_KW:.0f} kW', str(len(ended))]
    figures += [str(sum(stop.decision == decision for stop in ended))
                for decision in ('never', 'always', 'limited')]
    for costs in ([stop.always for stop in ended], [stop.never for stop in ended],
                  [min(stop.always, stop.never) for stop in ended]):
        excess = np.array([PERCENT * (cost / stop.chosen - 1.0) for cost, stop in zip(costs, ended)])
        finite = excess[np.isfinite(excess)]
        figures += [f'{np.median(finite):.2f}', f'{finite.max():.1f}'] if len(finite) else ['–', '–']
    return (*figures, str(sum(math.isinf(stop.never) for stop in ended)))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and print its table; returns the exit status."""
    return run_program('charger_heating', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    parser = OneLineParser(prog='python3 -m bev_preheat_studies.charger_heating', description=__doc__,
                           formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument('--cars', type=int, default=100, metavar='N', help='drawn cars (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='default: %(default)s')
    add_json_argument(parser)
    parsed = parser.parse_args(arguments)
    for name, low, high in (('cars', 1, 100_000), ('seed', 0, 2**31)):
        if not low <= getattr(parsed, name) <= high:
            raise InvalidInput(f'--{name}: {getattr(parsed, name)} is not allowed; it must be {low} ... {high}')
    check_outputs([json_output(parsed.json)], ())
    return lambda: _study(parsed)


def _study(arguments: Namespace) -> int:
    stops: list[HeatedStop] = []
    with progress_bar(TextColumn('cars'), BarColumn(), MofNCompleteColumn()) as progress:
        for number in progress.track(range(arguments.cars)):
            stops += draw_stops(arguments.seed, number)
    if arguments.json:
        write_json(arguments.json, {'seed': arguments.seed, 'stops': [asdict(stop) for stop in stops]})
    console = result_console(arguments.json)
    print_records(
        console, f'{arguments.cars} cars, each at {len(CHARGERS_W)} chargers; cost above the choice (%)',
        ('charger', 'stops', 'never', 'always', 'limited', 'always: median', 'worst', 'never: median', 'worst',
         'better of both: median', 'worst', 'end only heated'),
        [row(charger_w, [stop for stop in stops if stop.charger_w == charger_w]) for charger_w in CHARGERS_W],
        ('right',) * 12)
    dearer = sum(stop.chosen > min(stop.always, stop.never) * (1.0 + 1e-9) for stop in stops
                 if math.isfinite(stop.chosen))
    console.print(f'The choice costs more than the better of both in {dearer} of {len(stops)} stops.',
                  soft_wrap=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
