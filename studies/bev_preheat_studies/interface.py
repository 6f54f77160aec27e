# SPDX-License-Identifier: Apache-2.0
"""The studies in the public Python interface: `import bev_preheat as bp` has these names if they are installed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.interface.functions import goal_of, named_methods
from bev_preheat.interface.inputs import checked
from bev_preheat.interface.results import Result
from bev_preheat.optional_packages import require
from bev_preheat_studies.study import LIMITS, MOST_SITUATIONS, Study

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from bev_preheat.interface.functions import AnyMethod
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.route import Route
    from bev_preheat.vehicle import Vehicle
    from bev_preheat_studies.optimality.sweep import GapResult
    from bev_preheat_studies.robustness.cars import CarResult
    from bev_preheat_studies.table_two import Reproduction


@dataclass(frozen=True, eq=False, repr=False)
class StudyResult(Result):
    """The trips of a study, in order, and their summary by method."""

    methods: tuple[str, ...]
    summary: dict[str, Any]
    trips: tuple[Any, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return summary and trips as in the JSON of the command."""
        return {'summary': self.summary, 'results': [asdict(trip) for trip in self.trips]}

    def to_frame(self) -> DataFrame:
        """Return one row for each trip and method; needs pandas."""
        require('pandas')
        import pandas
        return pandas.DataFrame([
            {'trip': trip.number, 'method': method, **asdict(trip.methods[method])}
            for trip in self.trips for method in self.methods if method in trip.methods]).set_index('trip')


@dataclass(frozen=True, eq=False, repr=False)
class SweepResult(StudyResult):
    """Methods beside the nonlinear program on drawn trips."""

    trips: tuple[GapResult, ...]

    def in_words(self) -> str:
        """Return the number of trips and the largest gap of each method as one line."""
        most = ((name, max((gap_wh for _, gap_wh in self._gaps(name)), default=None)) for name in self.methods)
        gaps = ', '.join(f'{name} –' if gap_wh is None else f'{name} {gap_wh:.2f} Wh' for name, gap_wh in most)
        return f'{len(self.trips)} trips; above the optimum at most: {gaps}'

    def _gaps(self, method: str) -> list[tuple[float, float]]:
        """Return driving time [min] and energy above the optimum [Wh] of the trips that have both."""
        results = ((trip.duration_s / 60.0, trip.methods[method].gap_wh) for trip in self.trips
                   if method in trip.methods)
        return [(duration_min, gap_wh) for duration_min, gap_wh in results if gap_wh is not None]

    def _figure(self) -> Figure:
        from bev_preheat_studies.optimality.sweep_figure import make_sweep_figure
        return make_sweep_figure(self.trips, self.methods)

    def _draw(self, axis: Axes) -> None:
        for name in self.methods:
            axis.plot(*zip(*self._gaps(name)), linestyle='', marker='.', label=name)
        axis.set(xlabel='driving time [min]', ylabel='energy above the optimum [Wh]')
        axis.legend()


@dataclass(frozen=True, eq=False, repr=False)
class RobustnessResult(StudyResult):
    """The planner in closed loop with drawn cars that differ from their vehicle file."""

    trips: tuple[CarResult, ...]

    def in_words(self) -> str:
        """Return the number of trips and the worst error on arrival of each method as one line."""
        worst = ', '.join(f'{name} {self.summary[name]["arrival_error_k"]["worst"]:+.2f} K'
                          for name in self.methods)
        return f'{len(self.trips)} trips; worst error on arrival: {worst}'

    def _figure(self) -> Figure:
        from bev_preheat_studies.robustness.figure import make_robustness_figure
        return make_robustness_figure(self.trips, self.methods)

    def _draw(self, axis: Axes) -> None:
        axis.hist([[trip.methods[name].arrival_error_k for trip in self.trips] for name in self.methods],
                  label=list(self.methods))
        axis.set(xlabel='error on arrival [K]', ylabel='trips')
        axis.legend()


@dataclass(frozen=True, eq=False, repr=False)
class ReproductionResult(Result):
    """The cells of the paper's Table II beside ours."""

    reproduced: Reproduction

    def in_words(self) -> str:
        """Return the largest difference of a predicted cell as one line."""
        worst = max((cell for cell in self.reproduced.cells if cell.origin == 'predicted'),
                    key=lambda cell: abs(cell.difference_percent))
        return (f'{len(self.reproduced.cells)} cells; largest difference of a predicted one: '
                f'{worst.difference_percent:+.2f} % ({worst.column}, {worst.row})')

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `preheat reproduce`."""
        return self.reproduced.as_dictionary()

    def to_frame(self) -> DataFrame:
        """Return one row for each cell; needs pandas."""
        require('pandas')
        import pandas
        return pandas.DataFrame([
            {**asdict(cell), 'difference_percent': cell.difference_percent} for cell in self.reproduced.cells]
        ).set_index(['column', 'row'])

    def _figure(self) -> Figure:
        return self.reproduced.figure()

    def _draw(self, axis: Axes) -> None:
        from bev_preheat.drawing.plan_figure import draw_battery_temperatures
        from bev_preheat_studies.table_two import GOAL
        draw_battery_temperatures(axis, [self.reproduced.heuristic, self.reproduced.optimum.plan], GOAL)


def _check_ranges(situations: int, seed: int, jobs: int, what: str) -> None:
    for name, value, (low, high) in ((what, situations, (1, MOST_SITUATIONS)), ('seed', seed, LIMITS['seed']),
                                     ('jobs', jobs, LIMITS['jobs'])):
        if not low <= value <= high:
            raise InvalidInput(f'{name}: {value} is not allowed; it must be {low} ... {high}')


@checked
def sweep(vehicle: Vehicle, feasible: int = 300, *, seed: int = 1, limits: bool = False,
          methods: Sequence[AnyMethod] | None = None, jobs: int = 1) -> SweepResult:
    """
    Return methods compared with the nonlinear program on random trips, as `preheat sweep` does; needs casadi.

    Trips are drawn until `feasible` of them are; with `limits` those on which limits are active. `methods` are
    names or functions, None for the built-in ones. `jobs` are the processes; the result does not depend on them,
    and with functions there is one. Raises InvalidInput and MissingPackage.
    """
    require('casadi')
    from bev_preheat.planning.planner import METHODS
    from bev_preheat_studies.optimality.sweep import summarise_gaps, sweep_study
    _check_ranges(feasible, seed, jobs, 'feasible')
    names = tuple(METHODS) if methods is None else named_methods(methods)
    if jobs > 1 and not all(isinstance(method, str) for method in methods or ()):
        raise InvalidInput('methods: a function is known in this process only; leave out jobs')
    trips = tuple(sweep_study(vehicle, feasible, seed, 'limits' if limits else 'free', names).run(jobs))
    return SweepResult(names, summarise_gaps(trips, names), trips)


@checked
def robustness(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal | float | None = None, *,
               trips: int = 300, seed: int = 1, fault: str = 'none', plant: str = 'nominal',
               jobs: int = 1) -> RobustnessResult:
    """
    Return the planner in closed loop with cars that differ from their file, as `preheat robustness` does.

    `fault` and `plant` are names of a heater fault and of effects that the model leaves out; other arguments are
    as in `plan` and `sweep`. Raises InvalidInput.
    """
    from bev_preheat.planning.situation import check_situation
    from bev_preheat_studies.robustness.cars import CarResult, drive_car, summarise_drives
    from bev_preheat_studies.robustness.drawn_cars import Conditions, FAULTS, PLANTS
    from bev_preheat_studies.robustness.driven import COMPARED
    for name, value, allowed in (('fault', fault, FAULTS), ('plant', plant, PLANTS)):
        if value not in allowed:
            raise InvalidInput(f'{name}: {value!r} is not one of {", ".join(allowed)}')
    _check_ranges(trips, seed, jobs, 'trips')
    goal = goal_of(vehicle, goal)
    check_situation(vehicle, route, state, goal)
    names = tuple(COMPARED)
    conditions = Conditions(vehicle, (route,), state, goal, plant=plant, fault=fault)
    results = tuple(Study(partial(drive_car, conditions, seed, names), CarResult, trips).run(jobs))
    return RobustnessResult(names, summarise_drives(results, names), results)


@checked
def reproduce(vehicle: Vehicle | None = None) -> ReproductionResult:
    """
    Return the paper's Table II beside ours, as `preheat reproduce` does; needs casadi.

    `vehicle` is the one to compute with, None for the reference. Raises InvalidInput and MissingPackage.
    """
    require('casadi')
    from bev_preheat_studies.table_two import reproduce as reproduce_table
    return ReproductionResult(reproduce_table(vehicle))
