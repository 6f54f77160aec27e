# SPDX-License-Identifier: Apache-2.0
"""
The results of the public interface.

Each has `to_dict()`, the JSON of the command of the same name; `to_frame()`, a pandas.DataFrame over time;
`plot()`, the picture of that command; and one line as its text.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, TYPE_CHECKING

from bev_preheat.interface.result import Result
from bev_preheat.optional_packages import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from bev_preheat.charging.heating_choice import HeatingChoice
    from bev_preheat.charging.session import Session
    from bev_preheat.charging.stop import ChargingStop
    from bev_preheat.charging.worth import Worth
    from bev_preheat.nonlinear_program.solve import Optimum
    from bev_preheat.numerics import Curve, FloatArray
    from bev_preheat.planning.plan import Plan
    from bev_preheat.planning.situation import Goal
    from bev_preheat.planning.trip import Trip
    from bev_preheat.route import Route
    from bev_preheat.vehicle import Vehicle


def _frame(columns: dict[str, FloatArray]) -> DataFrame:
    """Return a DataFrame with `time_s` as its index; columns of steps (N,) get NaN at the end (N + 1,)."""
    require('pandas')
    import numpy as np
    import pandas
    instants = len(columns['time_s'])
    return pandas.DataFrame({name: np.append(values, np.nan) if len(values) < instants else values
                             for name, values in columns.items()}).set_index('time_s')


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

    @property
    def status(self) -> str:
        """Name of the planning.status.Status."""
        return self.plan.status.name

    @property
    def explanation(self) -> str:
        """The plan as a sentence."""
        return self.plan.explanation

    @property
    def heating_start_s(self) -> float | None:
        """Instant at which the heater is first switched on [s]; None: it stays off."""
        return self.plan.heating_start_s

    @property
    def heating_end_s(self) -> float | None:
        """Instant at which it is last switched off [s]; None: on arrival, or it stays off."""
        return self.plan.heating_end_s

    @property
    def arrival_temperature_c(self) -> float:
        """Battery temperature on arrival [deg C]."""
        return self.plan.arrival_temperature_c

    @property
    def arrival_soc(self) -> float:
        """State of charge on arrival, 0 ... 1."""
        return self.plan.arrival_soc

    @property
    def heating_energy_wh(self) -> float:
        """Electrical energy of the heater for the battery [Wh]."""
        return self.plan.energy_wh.hvch_electric

    @property
    def battery_energy_wh(self) -> float:
        """Energy drawn from the cells [Wh]."""
        return self.plan.energy_wh.battery_total

    @property
    def time_s(self) -> FloatArray:
        """Instants [s], (N + 1,)."""
        return self.plan.time_s

    @property
    def battery_temperature_c(self) -> FloatArray:
        """Battery temperature [deg C], (N + 1,)."""
        return self.plan.battery_temperature_c

    @property
    def soc(self) -> FloatArray:
        """State of charge, 0 ... 1, (N + 1,)."""
        return self.plan.soc

    @property
    def hvch_battery_power_w(self) -> FloatArray:
        """Mean electrical power for the battery in each step [W], (N,)."""
        return self.plan.hvch_battery_power_w

    @property
    def friction_brake_power_w(self) -> FloatArray:
        """Mean power at the friction brake, which the battery cannot accept [W], (N,)."""
        return self.plan.friction_brake_power_w

    @property
    def heater_limit_w(self) -> FloatArray:
        """Power of the heater left by the cabin in each step [W], (N,); constraint (9g)."""
        return self._trip.heater_limit_w

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
        return _frame({name: getattr(self, name) for name in (
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
    """The optimum of the nonlinear program; `solved` is the nonlinear_program.solve.Optimum."""

    solved: Optimum

    @property
    def marginal_cost_wh_per_k(self) -> float:
        """Cost of one more kelvin on arrival [Wh/K]; NaN if the program is infeasible."""
        return self.solved.marginal_cost_wh_per_k

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
        require('pandas')
        import pandas
        return pandas.DataFrame([
            {'method': name, 'heating_start_s': each.heating_start_s,
             'arrival_temperature_c': each.arrival_temperature_c, 'heating_energy_wh': each.heating_energy_wh,
             'battery_energy_wh': each.battery_energy_wh, 'above_optimum_wh': self.above_optimum_wh.get(name, 0.0)}
            for name, each in (*self.plans.items(), ('optimum', self.optimum))]).set_index('method')

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


@dataclass(frozen=True, eq=False, repr=False)
class SessionResult(Result):
    """
    A charging session; times in seconds after plugging in.

    `problem` says why the session does not end, None if it does. `choice` is the decision on heating at the
    charger, with the costs of heating never and always.
    """

    vehicle: Vehicle
    stop: ChargingStop
    session: Session
    choice: HeatingChoice

    @property
    def charger_heating(self) -> str:
        """Decision on heating at the charger: 'unable', 'never', 'always' or 'limited'."""
        return self.choice.decision.value

    @property
    def charger_heating_sentence(self) -> str:
        """The decision as a sentence; '' for a car that cannot heat at the charger."""
        return self.choice.sentence()

    @property
    def problem(self) -> str | None:
        """Reason for which the departure's state of charge is not reached; None: it is."""
        return self.session.problem

    @property
    def time_s(self) -> FloatArray:
        """Instants [s], (N + 1,)."""
        return self.session.time_s

    @property
    def battery_temperature_c(self) -> FloatArray:
        """Battery temperature [deg C], (N + 1,)."""
        return self.session.battery_temperature_c

    @property
    def soc(self) -> FloatArray:
        """State of charge, 0 ... 1, (N + 1,)."""
        return self.session.soc

    @property
    def charging_power_w(self) -> FloatArray:
        """Mean power into the battery's terminals in each step [W], (N,)."""
        return self.session.charging_power_w

    @property
    def hvch_battery_power_w(self) -> FloatArray:
        """Mean electrical power of the heater for the battery in each step [W], (N,)."""
        return self.session.hvch_battery_power_w

    @property
    def charging_time_s(self) -> float:
        """Duration until the departure's state of charge [s]; infinite if it is never reached."""
        return self.session.charging_time_s

    @property
    def bought_energy_wh(self) -> float:
        """Energy bought until then [Wh]; infinite if it is never reached."""
        return self.session.bought_energy_wh

    def to_dict(self) -> dict[str, Any]:
        """Return a session as in the JSON of `preheat charge`."""
        return {**self.session.as_dictionary(), 'charger_heating': self.choice.as_dictionary()}

    def to_frame(self) -> DataFrame:
        """Return temperature, state of charge and powers over time; needs pandas."""
        return _frame({name: getattr(self, name) for name in (
            'time_s', 'battery_temperature_c', 'soc', 'charging_power_w', 'hvch_battery_power_w')})

    def in_words(self) -> str:
        """Return duration, charge and temperatures as one line."""
        return (self.problem or f'{self.charging_time_s / 60.0:.1f} min') + (
            f' from {100.0 * self.soc[0]:.0f} to {100.0 * self.soc[-1]:.0f} %, '
            f'{self.battery_temperature_c[0]:.1f} to {self.battery_temperature_c[-1]:.1f} degC') + (
            '' if self.problem else f'; bought {self.bought_energy_wh / 1e3:.2f} kWh')

    def _figure(self) -> Figure:
        from bev_preheat.drawing.charging_figure import make_session_figure
        return make_session_figure(self.vehicle, self.stop, {'session': self.session},
                                   f'vehicle {self.vehicle.name}')

    def _draw(self, axis: Axes) -> None:
        from bev_preheat.drawing.charging_figure import draw_charging_power
        draw_charging_power(axis, self.session)


@dataclass(frozen=True, eq=False, repr=False)
class WorthResult(Result):
    """The cost of each target, and the best one."""

    vehicle: Vehicle
    worth_of_targets: Worth

    @property
    def best_target_c(self) -> float | None:
        """Target that costs least [deg C]; None: heating does not pay."""
        worth = self.worth_of_targets
        return None if worth.best is worth.without_heating else worth.best.target_c

    @property
    def saved_charging_time_s(self) -> float:
        """Time at the charger that the best target saves compared with no heating [s]."""
        worth = self.worth_of_targets
        return worth.without_heating.charging_time_s - worth.best.charging_time_s

    @property
    def break_even_value_of_time_per_h(self) -> float | None:
        """Value of an hour at the charger from which some heating pays; None: it never does."""
        return self.worth_of_targets.break_even_value_of_time_per_h

    @property
    def verdict(self) -> str:
        """The result as a sentence."""
        return self.worth_of_targets.verdict

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `preheat worth`, without the uncertainty of its times and the sensitivity."""
        return self.worth_of_targets.as_dictionary()

    def to_frame(self) -> DataFrame:
        """Return one row for each target; needs pandas."""
        require('pandas')
        import pandas
        return pandas.DataFrame(self.to_dict()['targets']).set_index('target_c')

    def in_words(self) -> str:
        """Return the best target and its saving as one line."""
        if self.best_target_c is None:
            return 'heating does not pay'
        return (f'best target {self.best_target_c:.1f} degC, saves {self.saved_charging_time_s / 60.0:.1f} min at '
                'the charger')

    def _figure(self) -> Figure:
        from bev_preheat.drawing.charging_figure import make_worth_figure
        return make_worth_figure(self.worth_of_targets, f'vehicle {self.vehicle.name}')

    def _draw(self, axis: Axes) -> None:
        from bev_preheat.drawing.charging_figure import draw_costs
        draw_costs(axis, self.worth_of_targets)


@dataclass(frozen=True, eq=False, repr=False)
class DriveResult(Result):
    """
    A drive of a simulated car under the planner; arrays with one entry for each of its steps, (N,).

    Instants [s]; battery temperature: true, measured and estimated [deg C], NaN before the first; predicted
    temperature on arrival [deg C]; heater command [W].
    """

    time_s: FloatArray
    true_temperature_c: FloatArray
    measured_temperature_c: FloatArray
    estimated_temperature_c: FloatArray
    predicted_arrival_temperature_c: FloatArray
    command_w: FloatArray
    arrival_temperature_c: float
    arrival_soc: float
    target_temperature_c: float
    heating_energy_wh: float
    battery_energy_wh: float
    heater_verdict: str

    @property
    def arrival_error_k(self) -> float:
        """True temperature on arrival above the target [K]."""
        return self.arrival_temperature_c - self.target_temperature_c

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain numbers, texts and lists."""
        return {name: value if isinstance(value, (float, str)) else value.tolist()
                for name, value in {**vars(self), 'arrival_error_k': self.arrival_error_k}.items()}

    def to_frame(self) -> DataFrame:
        """Return the arrays over time; needs pandas."""
        return _frame({name: value for name, value in vars(self).items()
                       if not isinstance(value, (float, str))})

    def in_words(self) -> str:
        """Return arrival, error and heat as one line."""
        return (f'arrives at {self.arrival_temperature_c:.1f} degC ({self.arrival_error_k:+.2f} K) and '
                f'{100.0 * self.arrival_soc:.1f} %; heater {self.heating_energy_wh / 1e3:.2f} kWh, '
                f'{self.heater_verdict}')

    def _figure(self) -> Figure:
        from bev_preheat.drawing.drive_figure import make_drive_figure
        return make_drive_figure('Simulated drive under the planner', self._temperatures_c,
                                 (self.time_s, self.command_w), self.target_temperature_c)

    def _draw(self, axis: Axes) -> None:
        from bev_preheat.drawing.drive_figure import draw_temperatures
        draw_temperatures(axis, self._temperatures_c, self.target_temperature_c)

    @property
    def _temperatures_c(self) -> dict[str, tuple[FloatArray, FloatArray]]:
        from bev_preheat.drawing.drive_figure import ESTIMATED, MEASURED, PREDICTED, TRUE
        return {name: (self.time_s, values_c) for name, values_c in (
            (PREDICTED, self.predicted_arrival_temperature_c), (MEASURED, self.measured_temperature_c),
            (TRUE, self.true_temperature_c), (ESTIMATED, self.estimated_temperature_c))}
