# SPDX-License-Identifier: Apache-2.0
"""
`python3 -m bev_preheat_studies.tunables`: which numbers in the planner's step matter.

Reads the numbers that stand as constants in the rooms of the step, with the comment above each as its reason, and
drives the same drawn cars again with each number 30 % smaller and larger. Prints by how much arrivals (mean and
worst), energy, switch-ons and verdicts on the heater move. Numbers that move nothing on these drives are listed,
and those without a comment. Numbers of planning that the native core has built in are driven without it
(`--without-core`, slow); whole numbers, which count something, move by at least 1. A number from which another one
is computed when its module is loaded moves nothing there.
"""

from __future__ import annotations

from argparse import RawDescriptionHelpFormatter
import ast
from dataclasses import asdict, dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
import sys
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.console.output import add_json_argument, json_output, write_json
from bev_preheat.console.parser import OneLineParser
from bev_preheat.console.program import run_program
from bev_preheat.console.terminal import print_records, progress_bar, result_console
from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import check_outputs
from bev_preheat.native.library import use_core
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.numbered import run_numbered
from bev_preheat_studies.robustness.car_study import result_of
from bev_preheat_studies.robustness.drawn_cars import Conditions
from bev_preheat_studies.workers import Workers

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Sequence

    # Arrivals above the target [K], heating energies [Wh], switch-ons, and verdicts on heaters.
    Figures = tuple[list[float], list[float], int, tuple[str, ...]]

ROOMS = ('control', 'estimation', 'signals', 'planning')
FACTORS = (0.7, 1.3)
# The same drives are equal to the last digit; less than this is nothing [K] and [Wh].
LEAST_MOVE = 1e-9


class Tunable(NamedTuple):
    """A number in the code: its module, its name, its value, and the comment above it ('': none)."""

    module: str
    name: str
    value: float | int
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
    drives.
    `failed`: a drive could not be driven to its end.
    """

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


def tunables(rooms: Sequence[str] = ROOMS) -> list[Tunable]:
    """Return the Tunables of rooms of the product, by module and line."""
    found = []
    for room in rooms:
        spec = find_spec(f'bev_preheat.{room}')
        assert spec is not None and spec.submodule_search_locations
        for path in sorted(Path(spec.submodule_search_locations[0]).glob('*.py')):
            found += _of_file(f'bev_preheat.{room}.{path.stem}', path.read_text(encoding='utf-8'))
    return found


def _of_file(module: str, text: str) -> list[Tunable]:
    lines, found = text.splitlines(), []
    for node in ast.parse(text).body:
        if not isinstance(node, ast.Assign):
            continue
        target, value = node.targets[0], node.value
        pairs = (zip(target.elts, value.elts) if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
                 else ((target, value),))
        for name, number in pairs:
            if not (isinstance(name, ast.Name) and name.id.isupper() and isinstance(number, ast.Constant)):
                continue
            if isinstance(number.value, int | float) and not isinstance(number.value, bool):
                found.append(Tunable(module, name.id, number.value, _comment_above(lines, node.lineno - 1)))
    return found


def _comment_above(lines: Sequence[str], at: int) -> str:
    """Return the comment above a line and the constants directly above it."""
    words: list[str] = []
    for line in reversed(lines[:at]):
        if line.startswith('#'):
            words.insert(0, line.lstrip('# '))
        elif words or not line.strip():
            break
    return ' '.join(words)


class _Drives(NamedTuple):
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
        drives = [result_of(conditions, self.seed, ('value_function',), number).methods['value_function']
                  for number in range(self.cars)]
        return ([drive.arrival_error_k for drive in drives], [drive.heating_energy_wh for drive in drives],
                sum(drive.switch_ons for drive in drives), sum((drive.verdicts for drive in drives), ()))


def effect_of(drives: _Drives, as_they_are: Figures, found: Sequence[Tunable], number: int) -> Effect:
    """Return the Effect of the Tunable of this number on drives that have the figures `as_they_are`."""
    tunable = found[number]
    effect = Effect(f'{tunable.module.removeprefix("bev_preheat.")}.{tunable.name}', tunable.value, tunable.reason)
    errors_k, energies_wh, switch_ons, verdicts = as_they_are
    moves: list[Effect] = []
    for factor in FACTORS:
        before = _set(tunable, tunable.times(factor))
        try:
            later_k, later_wh, later_ons, later_verdicts = drives.figures()
        except Exception as error:
            moves.append(Effect(*_head(effect), failed=f'{factor:g}: {type(error).__name__}: {error}'[:120]))
            continue
        finally:
            for module, value in before:
                setattr(module, tunable.name, value)
        moved_k = [abs(later - first) for later, first in zip(later_k, errors_k)]
        moves.append(Effect(
            *_head(effect), abs(sum(later_k) - sum(errors_k)) / len(errors_k), max(moved_k),
            abs(sum(later_wh) - sum(energies_wh)) / len(energies_wh), abs(later_ons - switch_ons),
            len(set(later_verdicts) ^ set(verdicts)) + abs(len(later_verdicts) - len(verdicts))))
    return max(moves, key=lambda move: (move.failed != '', move.worst_k, move.energy_wh))


def _head(effect: Effect) -> tuple[str, float, str]:
    return effect.tunable, effect.value, effect.reason


def _set(tunable: Tunable, value: float | int) -> list[tuple[Any, Any]]:
    """Set a number wherever it is known by its name; return (module, value before) of each."""
    home = import_module(tunable.module)
    original, before = getattr(home, tunable.name), []
    for name, module in list(sys.modules.items()):
        if name.startswith('bev_preheat') and vars(module).get(tunable.name) is original and (
                module is home or _imports(module, tunable)):
            before.append((module, original))
            setattr(module, tunable.name, value)
    return before


def _imports(module: Any, tunable: Tunable) -> bool:
    """Return whether a module has the number from the module of the Tunable."""
    text = Path(module.__file__).read_text(encoding='utf-8') if getattr(module, '__file__', None) else ''
    return any(isinstance(node, ast.ImportFrom) and node.module == tunable.module and any(
        alias.name == tunable.name for alias in node.names) for node in ast.walk(ast.parse(text)))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and print its tables; returns the exit status."""
    return run_program('tunables', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    parser = OneLineParser(prog='python3 -m bev_preheat_studies.tunables', description=__doc__,
                           formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument('--cars', type=int, default=4, metavar='N', help='drawn cars (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='default: %(default)s')
    parser.add_argument('--period', type=float, default=4.0, metavar='S',
                        help='period of battery states and commands [s] (default: %(default)s)')
    parser.add_argument('--room', choices=ROOMS, action='append', help='only this room; may be repeated')
    parser.add_argument('--without-core', action='store_true', help='plan in Python, so that all numbers count')
    add_json_argument(parser)
    parsed = parser.parse_args(arguments)
    for name, low, high in (('cars', 1, 1000), ('seed', 0, 2**31), ('period', 0.5, 30.0)):
        if not low <= getattr(parsed, name) <= high:
            raise InvalidInput(f'--{name}: {getattr(parsed, name)} is not allowed; it must be {low} ... {high}')
    check_outputs([json_output(parsed.json)], ())
    return lambda: _study(parsed)


def _study(arguments: Namespace) -> int:
    found = tunables(arguments.room or ROOMS)
    drives = _Drives(arguments.cars, arguments.seed, arguments.period, not arguments.without_core)
    with Workers(None) as workers, progress_bar() as bar:
        task = bar.add_task('numbers', total=len(found))
        effects = []
        task_of = partial(effect_of, drives, drives.figures(), found)
        for effect in run_numbered(workers, task_of, range(len(found))):
            effects.append(effect)
            bar.advance(task)
    if arguments.json:
        write_json(arguments.json, {'drives': drives._asdict(), 'effects': [asdict(effect) for effect in effects]})
    console = result_console(arguments.json)
    moving = sorted((effect for effect in effects if not effect.is_nothing), key=lambda effect: -effect.worst_k)
    print_records(
        console, f'{len(moving)} of {len(effects)} numbers move something on {arguments.cars} drives, by +-30 %',
        ('number', 'value', 'arrival, mean [K]', 'worst [K]', 'energy [Wh]', 'switch-ons', 'verdicts'),
        [(effect.tunable, f'{effect.value:g}', f'{effect.mean_k:.3f}', f'{effect.worst_k:.3f}',
          f'{effect.energy_wh:.1f}', str(effect.switch_ons), effect.failed or str(effect.verdicts))
         for effect in moving], ('left', *('right',) * 6))
    for words, named in (('Nothing moves by', [each.tunable for each in effects if each.is_nothing]),
                         ('Without a reason in the code:', [each.tunable for each in effects if not each.reason])):
        console.print(f'{words} {len(named)}: {", ".join(named)}', soft_wrap=True, markup=False)
    return 0


if __name__ == '__main__':
    sys.exit(main())
