# SPDX-License-Identifier: Apache-2.0
"""Results of the public interface beyond a plan: charging session, worth of heating, drives, recordings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TYPE_CHECKING

from bev_preheat.interface.results import frame, Part, Result, rows_frame

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from bev_preheat.charging.heating_choice import HeatingChoice
    from bev_preheat.charging.session import Session
    from bev_preheat.charging.stop import ChargingStop
    from bev_preheat.charging.target_worth import Worth
    from bev_preheat.identification.check import Check
    from bev_preheat.identification.result import Identification
    from bev_preheat.numerics import FloatArray
    from bev_preheat.vehicle import Vehicle


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

    charger_heating = Part[str](
        'choice.decision.value', "Decision on heating at the charger: 'unable', 'never', 'always' or 'limited'.")

    @property
    def charger_heating_sentence(self) -> str:
        """The decision as a sentence; '' for a car that cannot heat at the charger."""
        return self.choice.sentence()

    problem = Part[str | None](
        'session.problem', "Reason for which the departure's state of charge is not reached; None: it is.")
    time_s = Part['FloatArray']('session.time_s', 'Instants [s], (N + 1,).')
    battery_temperature_c = Part['FloatArray'](
        'session.battery_temperature_c', 'Battery temperature [deg C], (N + 1,).')
    soc = Part['FloatArray']('session.soc', 'State of charge, 0 ... 1, (N + 1,).')
    charging_power_w = Part['FloatArray'](
        'session.charging_power_w', "Mean power into the battery's terminals in each step [W], (N,).")
    hvch_battery_power_w = Part['FloatArray'](
        'session.hvch_battery_power_w',
        'Mean electrical power of the heater for the battery in each step [W], (N,).')
    charging_time_s = Part[float](
        'session.charging_time_s',
        "Duration until the departure's state of charge [s]; infinite if it is never reached.")
    bought_energy_wh = Part[float](
        'session.bought_energy_wh', 'Energy bought until then [Wh]; infinite if it is never reached.')

    def to_dict(self) -> dict[str, Any]:
        """Return a session as in the JSON of `preheat charge`."""
        return {**self.session.as_dictionary(), 'charger_heating': self.choice.as_dictionary()}

    def to_frame(self) -> DataFrame:
        """Return temperature, state of charge and powers over time; needs pandas."""
        return frame({name: getattr(self, name) for name in (
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

    break_even_value_of_time_per_h = Part[float | None](
        'worth_of_targets.break_even_value_of_time_per_h',
        'Value of an hour at the charger from which some heating pays; None: it never does.')
    verdict = Part[str]('worth_of_targets.verdict', 'The result as a sentence.')

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `preheat worth`, without the uncertainty of its times and the sensitivity."""
        return self.worth_of_targets.as_dictionary()

    def to_frame(self) -> DataFrame:
        """Return one row for each target; needs pandas."""
        return rows_frame(self.to_dict()['targets'], 'target_c')

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
        return frame({name: value for name, value in vars(self).items()
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


@dataclass(frozen=True, eq=False, repr=False)
class CheckResult(Result):
    """How well a vehicle predicts recorded drives: predicted minus measured temperature on arrival."""

    vehicle: Vehicle
    checked: Check

    @property
    def arrival_errors_k(self) -> dict[str, float]:
        """Error on arrival of each recording, by its name [K]."""
        return {trip.trip.name: trip.arrival_error_k for trip in self.checked.trips}

    rmse_k = Part[float]('checked.rmse_k', 'Root mean square of the errors on arrival [K].')
    worst_k = Part[float]('checked.worst_k', 'Largest magnitude of an error on arrival [K].')

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `preheat check`."""
        return self.checked.as_dictionary()

    def to_frame(self) -> DataFrame:
        """Return one row for each recording; needs pandas."""
        return rows_frame(self.to_dict()['trips'], 'name')

    def in_words(self) -> str:
        """Return the errors on arrival as one line."""
        return (f'vehicle {self.vehicle.name}: RMSE {self.rmse_k:.2f} K, worst {self.worst_k:.2f} K on arrival of '
                f'{len(self.checked.trips)} recordings')

    def _figure(self) -> Figure:
        from bev_preheat.drawing.identification_figures import check_figure
        return check_figure(self.checked)

    def _draw(self, axis: Axes) -> None:
        from bev_preheat.drawing.identification_figures import draw_arrival_errors
        draw_arrival_errors(axis, self.checked)


@dataclass(frozen=True, eq=False, repr=False)
class IdentificationResult(Result):
    """An identified car: its Vehicle, and how far it can be trusted."""

    vehicle: Vehicle
    identified: Identification

    rmse_k = Part[float](
        'identified.rmse_k',
        'Root mean square of the errors on arrival [K], each of a fit that has not seen that recording.')
    worst_k = Part[float]('identified.worst_k', 'Largest magnitude of such an error [K].')
    verdict = Part[tuple[str, ...]](
        'identified.verdict', 'Sentences on the trust that the vehicle deserves, the most important first.')
    record_next = Part[tuple[str, ...]](
        'identified.record_next',
        'Sentences on recordings that would improve the vehicle, the most valuable first.')

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `preheat identify`."""
        return self.identified.as_dictionary()

    def to_frame(self) -> DataFrame:
        """Return one row for each parameter: prior, estimate and 90 % interval; needs pandas."""
        return rows_frame(self.to_dict()['parameters'], 'name')

    def in_words(self) -> str:
        """Return the errors on arrival and the verdict's first sentence as one line."""
        return (f'vehicle {self.vehicle.name}: RMSE {self.rmse_k:.2f} K, worst {self.worst_k:.2f} K on arrival'
                + ''.join(f'; {sentence}' for sentence in self.verdict[:1]))

    def _figure(self) -> Figure:
        return self._check._figure()

    def _draw(self, axis: Axes) -> None:
        self._check._draw(axis)

    @property
    def _check(self) -> CheckResult:
        return CheckResult(self.vehicle, self.identified.check)
