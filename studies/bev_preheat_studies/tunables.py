# SPDX-License-Identifier: Apache-2.0
"""
Which numbers in the planner's step matter.

Drives the same drawn cars again with each number of `bev_preheat/tunables.py` 30 % smaller and larger. Prints by
how much arrivals (mean and worst), energy, switch-ons and verdicts on the heater move, and which numbers move
nothing on these drives; `--write` writes the worst change of an arrival into the rows of that file. Whole numbers
move by at least 1. Numbers that the native core has built in move only without it (`--without-core`, slow); a
number from which another one is computed when its module is loaded moves nothing there.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
import re
import sys
from typing import Any, NamedTuple

from rich.console import Console

from bev_preheat import tunables as table
from bev_preheat.commands.parser import Subparsers
from bev_preheat.commands.terminal import print_records
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.core_library import use_core
from bev_preheat_studies.robustness.cars import drive_car
from bev_preheat_studies.robustness.drawn_cars import Conditions
from bev_preheat_studies.study import add_study, check_study_arguments, Study

# Arrivals above the target [K], heating energies [Wh], switch-ons, and verdicts on heaters.
Figures = tuple[list[float], list[float], int, tuple[str, ...]]

# Name, value, unit, reason, and the effect that was written at last.
ROW = re.compile(r'^([A-Z][A-Z0-9_]*) = (.+?) +# (\S+) +\| (.+?)(?: \| ([^|\n]+))?$', re.MULTILINE)
FACTORS = (0.7, 1.3)
# The same drives are equal to the last digit; less than this is nothing [K] and [Wh].
LEAST_MOVE = 1e-9


class Tunable(NamedTuple):
    """A number of the step: its name, value, unit and reason."""

    name: str
    value: float | int
    unit: str
    reason: str

    def times(self, factor: float) -> float | int:
        """Return the value times a factor; a whole number moves by 1 at least."""
        if isinstance(self.value, int):
            moved = round(self.value * factor)
            return moved if moved != self.value else self.value + (1 if factor > 1.0 else -1)
        return self.value * factor


@dataclass(frozen=True)
class Effect:
    """
    The changes on the drives that a number brings, 30 % smaller or larger, whichever is more.

    Of the arrival in the mean and at worst [K], the mean heating energy [Wh], switch-ons and verdicts of all
    drives. `failed`: a drive could not be driven to its end.
    """

    number: int
    tunable: str
    value: float
    reason: str
    mean_k: float = 0.0
    worst_k: float = 0.0
    energy_wh: float = 0.0
    switch_ons: int = 0
    verdicts: int = 0
    failed: str = ''

    @property
    def is_nothing(self) -> bool:
        """Whether nothing moved."""
        return not self.failed and not self.switch_ons and not self.verdicts and max(
            self.mean_k, self.worst_k, self.energy_wh) < LEAST_MOVE


def tunables() -> list[Tunable]:
    """Return the Tunables in the order of their rows."""
    return [Tunable(name, getattr(table, name), unit, reason)
            for name, _, unit, reason, _ in ROW.findall(Path(table.__file__).read_text(encoding='utf-8'))]


def with_effects(text: str, effects: Sequence[Effect]) -> str:
    """Return the text of the table with the worst change of an arrival behind each row that moves something."""
    moved = {effect.tunable: '' if effect.is_nothing else f' | {effect.worst_k:.3f} K' for effect in effects}
    return ROW.sub(lambda row: row[0] if row[1] not in moved else (
        row[0].removesuffix(f' | {row[5]}') + moved[row[1]]), text)


class Drives(NamedTuple):
    """The drives of the study: numbers of drawn cars, the seed, the period [s], and whether the core plans."""

    cars: int
    seed: int
    period_s: float
    has_core: bool

    def figures(self) -> Figures:
        """Return arrivals above the target [K], energies [Wh], switch-ons, and verdicts on heaters."""
        vehicle = load_vehicle('reference')
        conditions = Conditions(
            vehicle, (load_route('reference', vehicle.defaults),), BatteryState(-7.0, 0.9), Goal(25.0, 0.1),
            self.period_s, plant='all')
        use_core(self.has_core)
        drives = [drive_car(conditions, self.seed, ('value_function',), number).methods['value_function']
                  for number in range(self.cars)]
        return ([drive.arrival_error_k for drive in drives], [drive.heating_energy_wh for drive in drives],
                sum(drive.switch_ons for drive in drives), sum((drive.verdicts for drive in drives), ()))


def effect_of(drives: Drives, as_they_are: Figures, found: Sequence[Tunable], number: int) -> Effect:
    """Return the Effect of the Tunable of this number on drives that have the figures `as_they_are`."""
    tunable = found[number]
    effect = Effect(number, tunable.name, tunable.value, tunable.reason)
    errors_k, energies_wh, switch_ons, verdicts = as_they_are
    moves: list[Effect] = []
    for factor in FACTORS:
        set_everywhere(tunable, tunable.times(factor))
        try:
            later_k, later_wh, later_ons, later_verdicts = drives.figures()
        except Exception as error:
            moves.append(replace(effect, failed=f'{factor:g}: {type(error).__name__}: {error}'[:120]))
            continue
        finally:
            set_everywhere(tunable, tunable.value)
        moved_k = [abs(later - first) for later, first in zip(later_k, errors_k)]
        moves.append(replace(
            effect, mean_k=abs(sum(later_k) - sum(errors_k)) / len(errors_k), worst_k=max(moved_k),
            energy_wh=abs(sum(later_wh) - sum(energies_wh)) / len(energies_wh),
            switch_ons=abs(later_ons - switch_ons),
            verdicts=len(set(later_verdicts) ^ set(verdicts)) + abs(len(later_verdicts) - len(verdicts))))
    return max(moves, key=lambda move: (move.failed != '', move.worst_k, move.energy_wh))


def set_everywhere(tunable: Tunable, value: float | int) -> list[Any]:
    """Set a number in all modules that have it, and forget results kept with another one; return the modules."""
    modules = [module for name, module in list(sys.modules.items())
               if name.startswith('bev_preheat') and hasattr(module, tunable.name)]
    for module in modules:
        setattr(module, tunable.name, value)
        for kept in vars(module).values():
            getattr(kept, 'cache_clear', int)()
    return modules


def add_parser(subparsers: Subparsers) -> None:
    """Add the study."""
    parser = add_study(subparsers, 'tunables', run, __doc__, "which numbers in the planner's step matter", 'cars',
                       most=1)
    parser.add_argument('--period', type=float, default=8.0, metavar='S',
                        help='period of battery states and commands [s] (default: %(default)s)')
    parser.add_argument('names', nargs='*', metavar='NAME', help='only these numbers (default: all)')
    parser.add_argument('--write', action='store_true', help='write the effects into bev_preheat/tunables.py')
    parser.add_argument('--without-core', action='store_true', help='plan in Python, so that all numbers count')


def run(arguments: Namespace) -> int:
    """Run the study and print its tables; returns 0."""
    check_study_arguments(arguments, wanted='cars', period=(0.5, 30.0))
    unknown = set(arguments.names) - {each.name for each in tunables()}
    if unknown:
        raise InvalidInput(f'NAME: {", ".join(sorted(unknown))}: bev_preheat/tunables.py has no such number')
    found = [each for each in tunables() if not arguments.names or each.name in arguments.names]
    drives = Drives(arguments.cars, arguments.seed, arguments.period, not arguments.without_core)
    return Study(partial(effect_of, drives, drives.figures(), found), Effect, len(found), {
        'study': 'tunables', 'names': arguments.names, **drives._asdict()}, what='numbers').conduct(
            arguments, partial(_show, arguments.write))


def _show(write: bool, console: Console, effects: list[Effect]) -> dict[str, Any]:
    if write:
        path = Path(table.__file__)
        path.write_text(with_effects(path.read_text(encoding='utf-8'), effects), encoding='utf-8')
    moving = sorted((effect for effect in effects if not effect.is_nothing), key=lambda effect: -effect.worst_k)
    print_records(
        console, f'{len(moving)} of {len(effects)} numbers move something, by +-30 %',
        ('number', 'value', 'arrival, mean [K]', 'worst [K]', 'energy [Wh]', 'switch-ons', 'verdicts'),
        [(effect.tunable, f'{effect.value:g}', f'{effect.mean_k:.3f}', f'{effect.worst_k:.3f}',
          f'{effect.energy_wh:.1f}', str(effect.switch_ons), effect.failed or str(effect.verdicts))
         for effect in moving], ('left', *('right',) * 6))
    unmoved = [each.tunable for each in effects if each.is_nothing]
    console.print(f'Nothing moves by {len(unmoved)}: {", ".join(unmoved)}', soft_wrap=True, markup=False)
    return {}
