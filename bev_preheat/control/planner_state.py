# SPDX-License-Identifier: Apache-2.0
"""The planner's state after a step, as one value: for diagnostics, files, simulations and studies."""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.control.decision import Command, Decision
    from bev_preheat.control.heater_answer import HeaterAnswerReport
    from bev_preheat.control.inputs import Measurement, Mission
    from bev_preheat.control.preparation_goal import PreparationGoal
    from bev_preheat.control.regime import RegimeReport
    from bev_preheat.control.settings import Settings
    from bev_preheat.control.soak_watch import StandReport
    from bev_preheat.control.timetable import PlaceReport
    from bev_preheat.estimation.driver_choices import DriverChoices
    from bev_preheat.estimation.estimate import Estimate
    from bev_preheat.estimation.last_seen import LastSeen
    from bev_preheat.signals.verdict import SignalVerdict
    from bev_preheat.vehicle.description import Vehicle


class PlannerState(NamedTuple):
    """
    The state after the latest step.

    Inputs: the `vehicle` as its file describes it, the `settings`, the driver's `choices` and the battery's
    `last_seen` (None: unknown), which outlive the process; `rivals`, the names of other nodes that command the
    same heater ('' for none). `mission` is that of the route (None without one), `active_mission` that which is
    planned for: the one made for `preparation_goal`, else that of the route. `latest_mission` may have been
    dropped because it does not fit the parameters; `unit_warnings` are sentences on fields of the current
    route that look like wrong units, `refused_route` and `refused_progress` the sentences of the latest refusals
    (None after a valid input). `place` is the place by route progress, None before the first.
    `overtaken_states` is the number of battery states dropped because a later one had arrived a moment before
    them. `measurement` is the latest valid one with the signals that hold; None before the first.

    Knowledge: the `regime`, by evidence; `signal_verdicts`, () while every signal holds; `estimate` and
    `stand_report`, the report on the trip's first battery state; None without one.

    Results: the current `decision`, with the status and the sentence of `latest_command` (None before the first).
    `heater_answer` is the report on `hvch_status`; None before the first.
    """

    vehicle: Vehicle
    settings: Settings
    choices: DriverChoices
    last_seen: LastSeen | None
    rivals: str
    mission: Mission | None
    active_mission: Mission | None
    preparation_goal: PreparationGoal | None
    latest_mission: Mission | None
    unit_warnings: tuple[str, ...]
    refused_route: str | None
    refused_progress: str | None
    place: PlaceReport | None
    overtaken_states: int
    measurement: Measurement | None
    regime: RegimeReport
    signal_verdicts: tuple[SignalVerdict, ...]
    estimate: Estimate | None
    stand_report: StandReport | None
    decision: Decision
    latest_command: Command | None
    heater_answer: HeaterAnswerReport | None = None

    @property
    def is_enabled(self) -> bool:
        """Whether preheating is switched on."""
        return self.choices.switched_off_ns is None

    @property
    def temperature_c(self) -> float | None:
        """The battery's temperature [deg C], estimated or as measured; None before the first."""
        if self.estimate is not None:
            return self.estimate.temperature_c
        return None if self.measurement is None else self.measurement.state.temperature_c
