# SPDX-License-Identifier: Apache-2.0
"""
The results of the public interface: their base, plans, and comparisons of plans.

Each has `to_dict()`, the JSON of the command of the same name; `to_frame()`, a pandas.DataFrame over time;
`plot()`, the picture of that command; and one line as its text.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from html import escape
import io
from operator import attrgetter
from typing import Any, Generic, TYPE_CHECKING, TypeVar

from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import check_outputs, OutputFile, PICTURE_SUFFIXES
from bev_preheat.optional_packages import is_installed, require

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from bev_preheat.numerics import Curve, FloatArray
    from bev_preheat.planning.plan import Optimum, Plan
    from bev_preheat.planning.situation import Goal
    from bev_preheat.planning.trip import Trip
    from bev_preheat.route import Route
    from bev_preheat.vehicle import Vehicle

PICTURE_DPI = 75
Value = TypeVar('Value')


class Part(property, Generic[Value]):
    """A read-only value of an object that a result holds, by its dotted path."""

    def __init__(self, path: str, doc: str) -> None:
        super().__init__(attrgetter(path))
        self.__doc__ = doc

    if TYPE_CHECKING:
        def __get__(self, result: object, owner: type | None = None) -> Value:  # type: ignore[override]
            ...


class Result:
    """A result: `in_words()` is its line, `plot` its picture; a notebook shows both."""

    def in_words(self) -> str:
        """Return the result as one short line."""
        raise NotImplementedError

    def _figure(self) -> Figure:
        """Return the picture of the command."""
        raise NotImplementedError

    def _draw(self, axis: Axes) -> None:
        """Draw the most important panel."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return f'<{type(self).__name__}: {self.in_words()}>'

    def _repr_html_(self) -> str:
        """Return line and picture for a notebook; without matplotlib the line."""
        text = f'<p>{escape(self.in_words())}</p>'
        if not is_installed('matplotlib'):
            return text
        drawn = io.BytesIO()
        self._figure().savefig(drawn, format='png', dpi=PICTURE_DPI)
        return f'{text}<img alt="" src="data:image/png;base64,{b64encode(drawn.getvalue()).decode()}">'

    def plot(self, file: str | Path | None = None, ax: Axes | None = None) -> Axes | list[Axes]:
        """
        Draw the result and return its axes; needs matplotlib.

        Without `ax` all panels are drawn, those of the command's picture, into `file` if given (PNG, SVG, PDF by
        suffix), and a list of their axes is returned. With `ax` the most important panel is drawn there.
        """
        require('matplotlib')
        check_outputs([OutputFile('file', file, PICTURE_SUFFIXES)])
        if ax is not None:
            if file is not None:
                raise InvalidInput('plot: file and ax are given; give file or ax')
            if not hasattr(ax, 'get_figure'):
                raise InvalidInput(f'ax: must be Axes of Matplotlib, not {type(ax).__name__}')
            self._draw(ax)
            return ax
        figure = self._figure()
        if file is not None:
            from bev_preheat.drawing.figure import save_figure
            save_figure(figure, file)
        return list(figure.axes)


def frame(columns: dict[str, FloatArray]) -> DataFrame:
    """Return a DataFrame with `time_s` as its index; columns of steps (N,) get NaN at the end (N + 1,)."""
    require('pandas')
    import numpy as np
    import pandas
    instants = len(columns['time_s'])
    return pandas.DataFrame({name: np.append(values, np.nan) if len(values) < instants else values
                             for name, values in columns.items()}).set_index('time_s')


def rows_frame(rows: Iterable[dict[str, Any]], index: str) -> DataFrame:
    """Return a DataFrame of rows, with one column as its index."""
    require('pandas')
    import pandas
    return pandas.DataFrame(rows).set_index(index)


@dataclass(frozen=True, eq=False, repr=False)
class PlanResult(Result):
    """
    A plan with its vehicle, route and goal; times in seconds after the start of the route.

    Shapes for N steps: values at instants (N + 1,), such as `time_s`, `battery_temperature_c` and `soc`; mean
    powers of steps (N,), such as `hvch_battery_power_w`.
    """

    vehicle: Vehicle
    route: Route
    goal: Goal
    plan: Plan

    status = Part[str]('plan.status.name', 'Name of the planning.status.Status.')
    explanation = Part[str]('plan.explanation', 'The plan as a sentence.')
    heating_start_s = Part[float | None](
        'plan.heating_start_s', 'Instant at which the heater is first switched on [s]; None: it stays off.')
    heating_end_s = Part[float | None](
        'plan.heating_end_s', 'Instant at which it is last switched off [s]; None: on arrival, or it stays off.')
    arrival_temperature_c = Part[float]('plan.arrival_temperature_c', 'Battery temperature on arrival [deg C].')
    arrival_soc = Part[float]('plan.arrival_soc', 'State of charge on arrival, 0 ... 1.')
    heating_energy_wh = Part[float](
        'plan.energy_wh.hvch_electric', 'Electrical energy of the heater for the battery [Wh].')
    battery_energy_wh = Part[float]('plan.energy_wh.battery_total', 'Energy drawn from the cells [Wh].')
    time_s = Part['FloatArray']('plan.time_s', 'Instants [s], (N + 1,).')
    battery_temperature_c = Part['FloatArray'](
        'plan.battery_temperature_c', 'Battery temperature [deg C], (N + 1,).')
    soc = Part['FloatArray']('plan.soc', 'State of charge, 0 ... 1, (N + 1,).')
    hvch_battery_power_w = Part['FloatArray'](
        'plan.hvch_battery_power_w', 'Mean electrical power for the battery in each step [W], (N,).')
    source_power_w = Part['dict[str, FloatArray]'](
        'plan.source_power_w', 'That of each heat source by name [W], (N,) each; empty for the HVCH alone.')
    friction_brake_power_w = Part['FloatArray'](
        'plan.friction_brake_power_w',
        'Mean power at the friction brake, which the battery cannot accept [W], (N,).')
    heater_limit_w = Part['FloatArray'](
        '_trip.hvch_limit_w', 'Power of the heater left by the cabin in each step [W], (N,); constraint (9g).')

    @property
    def battery_power_w(self) -> FloatArray:
        """Mean power of the cells P_b in each step, charging negative [W], (N,)."""
        from bev_preheat.planning.plan import accounts_of
        return accounts_of(self._trip, self.plan).battery_power_w

    @property
    def charge_limit_w(self) -> FloatArray:
        """Most power that the battery may take at each instant, negative [W], (N + 1,); constraint (9i)."""
        return self._limit_w(self.vehicle.battery.charge_power_limit)

    @property
    def discharge_limit_w(self) -> FloatArray:
        """Most power that the battery may give at each instant [W], (N + 1,); constraint (9i)."""
        return self._limit_w(self.vehicle.battery.discharge_power_limit)

    @property
    def energy_wh(self) -> dict[str, float]:
        """Energies of the trip by name [Wh], the rows of the paper's Table II, as in the JSON."""
        return asdict(self.plan.energy_wh)

    @property
    def _trip(self) -> Trip:
        from bev_preheat.planning.trip import make_trip
        return make_trip(self.vehicle, self.route)

    def _limit_w(self, limit: Curve) -> FloatArray:
        import numpy as np

        from bev_preheat.numerics import ARRAYS
        return np.broadcast_to(limit.function(ARRAYS)(self.soc, self.battery_temperature_c), self.soc.shape)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `preheat plan`, without its `sensitivity`."""
        return self.plan.as_dictionary()

    def to_frame(self) -> DataFrame:
        """Return temperature, state of charge and power over time; needs pandas."""
        return frame({name: getattr(self, name) for name in (
            'time_s', 'battery_temperature_c', 'soc', 'hvch_battery_power_w')})

    def in_words(self) -> str:
        """Return status, heating and arrival as one line."""
        start_s, end_s = self.heating_start_s, self.heating_end_s
        heats = 'does not heat' if start_s is None else (
            f'heats from min {start_s / 60.0:.1f} to '
            + ('arrival' if end_s is None else f'min {end_s / 60.0:.1f}'))
        return (f'{self.status}, {heats}, arrives at {self.arrival_temperature_c:.1f} degC and '
                f'{100.0 * self.arrival_soc:.1f} %; heater {self.heating_energy_wh / 1e3:.2f} kWh')

    def _figure(self) -> Figure:
        from bev_preheat.drawing.plan_figure import make_plan_figure
        return make_plan_figure(self.vehicle, self.route, self.goal, [self.plan], f'vehicle {self.vehicle.name}')

    def _draw(self, axis: Axes) -> None:
        from bev_preheat.drawing.plan_figure import draw_battery_temperatures
        draw_battery_temperatures(axis, [self.plan], self.goal)


@dataclass(frozen=True, eq=False, repr=False)
class OptimumResult(PlanResult):
    """The optimum of the nonlinear program; `solved` is the planning.plan.Optimum."""

    solved: Optimum

    marginal_cost_wh_per_k = Part[float](
        'solved.marginal_cost_wh_per_k',
        'Cost of one more kelvin on arrival [Wh/K]; NaN if the program is infeasible.')

    @property
    def infeasible(self) -> tuple[str, ...]:
        """Limits that cannot be kept, as sentences; () if the program is feasible."""
        return tuple(self.solved.infeasible)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `preheat optimum`."""
        return self.solved.as_dictionary()


@dataclass(frozen=True, eq=False, repr=False)
class ComparisonResult(Result):
    """
    The plans of all methods by name, and the optimum.

    `above_optimum_wh` is the battery energy of each plan above the optimum's [Wh], None if the plan does not reach
    the same; `difference` says why not ('' if it does).
    """

    plans: dict[str, PlanResult]
    optimum: OptimumResult
    above_optimum_wh: dict[str, float | None]
    difference: dict[str, str]

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `preheat compare`, without the sensitivity."""
        return {'plans': {name: plan.to_dict() for name, plan in self.plans.items()},
                'optimum': self.optimum.to_dict(), 'gap_wh': self.above_optimum_wh,
                'difference': {name: text or None for name, text in self.difference.items()}}

    def to_frame(self) -> DataFrame:
        """Return one row for each method, and one for the optimum; needs pandas."""
        return rows_frame([
            {'method': name, 'heating_start_s': each.heating_start_s,
             'arrival_temperature_c': each.arrival_temperature_c, 'heating_energy_wh': each.heating_energy_wh,
             'battery_energy_wh': each.battery_energy_wh, 'above_optimum_wh': self.above_optimum_wh.get(name, 0.0)}
            for name, each in (*self.plans.items(), ('optimum', self.optimum))], 'method')

    def in_words(self) -> str:
        """Return the energy of each method above the optimum as one line."""
        above = (f'{name} {difference or "–"}' if gap_wh is None else f'{name} {gap_wh:+.1f} Wh'
                 for (name, gap_wh), difference in zip(self.above_optimum_wh.items(), self.difference.values()))
        return f'above the optimum of {self.optimum.battery_energy_wh / 1e3:.2f} kWh: {", ".join(above)}'

    def _figure(self) -> Figure:
        from bev_preheat.drawing.plan_figure import make_plan_figure
        best = self.optimum
        return make_plan_figure(best.vehicle, best.route, best.goal, self._plans, f'vehicle {best.vehicle.name}')

    def _draw(self, axis: Axes) -> None:
        from bev_preheat.drawing.plan_figure import draw_battery_temperatures
        draw_battery_temperatures(axis, self._plans, self.optimum.goal)

    @property
    def _plans(self) -> list[Plan]:
        return [*(each.plan for each in self.plans.values()), self.optimum.plan]
