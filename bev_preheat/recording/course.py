# SPDX-License-Identifier: Apache-2.0
"""The course of a drive as recorded or replayed: commands, temperatures, predictions, and its figures."""

from __future__ import annotations

from dataclasses import dataclass, field
import math
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat.recording.heater_account import RECORDED_HOLD_NS
from bev_preheat.recording.trip_result import span_values, TripResults

if TYPE_CHECKING:
    from bev_preheat.recording.player import Played

# Heater power below this is off [W].
LEAST_HEAT_W = 1.0


class Instant(NamedTuple):
    """
    The course at an instant [ns]: command [W], measured, estimated and predicted arrival temperature [deg C], SoC.

    `deviation_k` [K] is that of the prediction, `start_ns` [ns] the planned start of heating; NaN and None:
    unknown. `until_ns` [ns] is the end of the command's lease.
    """

    now_ns: int
    command_w: float
    measured_c: float
    estimated_c: float
    predicted_c: float
    deviation_k: float
    soc: float
    start_ns: int | None
    status: Status
    until_ns: int


class Said(NamedTuple):
    """A sentence that holds from an instant [ns] on, its status, and the plan's target [deg C] (NaN: none)."""

    now_ns: int
    status: Status
    sentence: str
    target_c: float


@dataclass
class Course:
    """
    A drive, instant by instant; filled by `add`.

    `said` has the sentence at each change of status, `signals` the names of signals in doubt by instant [ns],
    `regimes` the regime by instant [ns], each at its changes. `results` has the heater's energy and each trip.
    """

    instants: list[Instant] = field(default_factory=list)
    said: list[Said] = field(default_factory=list)
    signals: list[tuple[int, str]] = field(default_factory=list)
    regimes: list[tuple[int, str]] = field(default_factory=list)
    results: TripResults = field(default_factory=TripResults)
    _arrived: Instant | None = None
    _predicted: Instant | None = None
    _had_plan: bool = False

    def add(self, played: Played, recorded_w: float | None = None) -> None:
        """
        Add a step.

        `recorded_w` [W] is the heater's recorded power if no planner commanded it, None: one did.
        """
        self.results.add(played, recorded_w)
        state, decision = played.state, played.state.decision
        command, estimate, measurement, plan = (
            state.latest_command, state.estimate, state.measurement, decision.plan if recorded_w is None else None)
        start_ns = None
        if plan is not None and plan.heating_start_s is not None:
            start_ns = decision.plan_start_ns + round(plan.heating_start_s * NS_PER_S)
        instant = Instant(
            played.now_ns, recorded_w if recorded_w is not None else
            0.0 if command is None else command.battery_heating_power_w,
            math.nan if measurement is None else measurement.state.temperature_c,
            math.nan if estimate is None else estimate.temperature_c,
            math.nan if plan is None else plan.arrival_temperature_c, decision.arrival_deviation_k,
            math.nan if measurement is None else measurement.state.soc, start_ns, decision.status,
            played.now_ns + RECORDED_HOLD_NS if recorded_w is not None
            else 0 if command is None else command.valid_until_ns)
        self.instants.append(instant)
        if recorded_w is None and (not self.said or self.said[-1].status is not decision.status):
            target_c = math.nan if decision.target is None or decision.target.target_c is None \
                else decision.target.target_c
            self.said.append(Said(played.now_ns, decision.status, decision.explanation, target_c))
        if plan is not None:
            self._predicted = instant
        self._had_plan |= decision.plan is not None
        if self._arrived is None and decision.status.meaning.is_over and self._had_plan:
            self._arrived = instant
        for known, value in ((self.signals, ', '.join(verdict.signal for verdict in state.signal_verdicts)),
                             (self.regimes, state.regime.regime.value)):
            if not known or known[-1][1] != value:
                known.append((played.now_ns, value))

    @property
    def heating(self) -> list[tuple[int, int]]:
        """The periods of heating, as instants [ns]."""
        periods: list[tuple[int, int]] = []
        begun: int | None = None
        for instant in self.instants:
            if instant.command_w >= LEAST_HEAT_W and begun is None:
                begun = instant.now_ns
            elif instant.command_w < LEAST_HEAT_W and begun is not None:
                periods.append((begun, instant.now_ns))
                begun = None
        if begun is not None:
            periods.append((begun, self.instants[-1].now_ns))
        return periods

    @property
    def energy_wh(self) -> float:
        """The heater's electrical energy [Wh]: as commanded, or of a log as recorded."""
        account = self.results.account
        return (account.delivered_wh if account.commanded_wh is None else account.commanded_wh) or 0.0

    @property
    def arrival(self) -> Instant | None:
        """The Instant of arrival, with the measured temperature; None: the recording ends before."""
        return self._arrived

    @property
    def latest_prediction(self) -> Instant | None:
        """The last Instant with a plan; None without one."""
        return self._predicted

    def as_dictionary(self) -> dict[str, Any]:
        """Return its figures as plain values for JSON."""
        arrival, predicted = self._arrived, self._predicted
        return {
            'start_ns': self.instants[0].now_ns, 'end_ns': self.instants[-1].now_ns, 'steps': len(self.instants),
            'heating': [{'from_ns': begun, 'to_ns': ended} for begun, ended in self.heating],
            'hvch_commanded_wh': self.results.account.commanded_wh,
            'hvch_delivered_wh': self.results.account.delivered_wh,
            'without_command': span_values(self.results.account.without_command),
            'results': [trip.sentences() for trip in self.results.trips],
            'arrival_ns': None if arrival is None else arrival.now_ns,
            'arrival_temperature_c': None if arrival is None else arrival.measured_c,
            'last_predicted_arrival_temperature_c': None if predicted is None else predicted.predicted_c,
            'statuses': [{'at_ns': said.now_ns, 'status': said.status.name, 'sentence': said.sentence}
                         for said in self.said],
            'signals_in_doubt': [{'at_ns': at_ns, 'signals': names} for at_ns, names in self.signals],
            'regimes': [{'at_ns': at_ns, 'regime': name} for at_ns, name in self.regimes]}
