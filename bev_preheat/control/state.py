# SPDX-License-Identifier: Apache-2.0
"""The planner's state between two steps: one value, which `step.step` replaces at each instant."""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.control.command import Commander
from bev_preheat.control.decision import Decision, WITHOUT_ROUTE
from bev_preheat.control.decision_maker import DecisionMaker
from bev_preheat.control.heater_answer import HeaterAnswers
from bev_preheat.control.inbox import Inbox
from bev_preheat.control.knowledge import Knowledge
from bev_preheat.control.learning import Learning
from bev_preheat.control.planner_state import PlannerState
from bev_preheat.control.preparation import Preparation
from bev_preheat.estimation.driver_choices import NO_CHOICES
from bev_preheat.estimation.last_seen import LastSeen

if TYPE_CHECKING:
    from bev_preheat.control.admitted import AdmittedInputs
    from bev_preheat.control.decision import Command
    from bev_preheat.control.inputs import Measurement
    from bev_preheat.control.settings import Settings
    from bev_preheat.estimation.driver_choices import DriverChoices
    from bev_preheat.estimation.estimate import Estimate
    from bev_preheat.estimation.prior import Learned
    from bev_preheat.planning.status import Status
    from bev_preheat.vehicle.description import Vehicle


class Screened(NamedTuple):
    """
    A Measurement `as_arrived`, and `holding`: with only the signals that hold.

    `doubt` is the sentence on signals without which nothing is heated; None if they hold.
    """

    as_arrived: Measurement | None = None
    holding: Measurement | None = None
    doubt: str | None = None


class State(NamedTuple):
    """
    All that the planner remembers, after the step of `now_ns` [ns].

    Inputs: the `inbox`, the `preparation` goal, `inactive`: why a managed node may not heat, '' if it may, and
    the `answers` of the heater with `heater_refusal`, the sentence on heat that it refuses ('' for none).
    `screened` is the latest measurement with the signals that hold, `last_seen` the battery before a restart,
    None: unknown.

    Knowledge, about the `vehicle`: `knowledge` of regime and signals, `learning` about the car.

    Decisions: the `decision_maker`, the `decision` as it was made, and as it is `shown` with the status and
    sentence of the command; the `commander`, the `latest_command` and the `published_status`, None before the
    first. `is_in_doubt`: it is uncertain that the vehicle charges on the latest mission.
    """

    vehicle: Vehicle
    inbox: Inbox
    knowledge: Knowledge
    learning: Learning
    last_seen: LastSeen | None = None
    now_ns: int = 0
    preparation: Preparation = Preparation()
    answers: HeaterAnswers = HeaterAnswers()
    heater_refusal: str = ''
    inactive: str = ''
    screened: Screened = Screened()
    decision_maker: DecisionMaker = DecisionMaker()
    decision: Decision = WITHOUT_ROUTE
    shown: Decision = WITHOUT_ROUTE
    commander: Commander = Commander()
    latest_command: Command | None = None
    published_status: Status | None = None
    is_in_doubt: bool = False

    @classmethod
    def begun(cls, vehicle: Vehicle, settings: Settings, learned: Learned | None = None,
              last_seen: LastSeen | None = None, choices: DriverChoices = NO_CHOICES) -> State:
        """
        Return the State without input.

        From before a restart: the Learned (None: start from the vehicle file), the battery's
        LastSeen (None: unknown), and the DriverChoices that still count.
        """
        return cls(vehicle, Inbox.empty(vehicle, settings, choices), Knowledge(),
                   Learning.begun(vehicle, learned, last_seen), last_seen)

    @property
    def settings(self) -> Settings:
        """The Settings."""
        return self.inbox.settings

    @property
    def estimate(self) -> Estimate | None:
        """The latest estimation.estimate.Estimate; None without one."""
        return self.learning.estimator.estimate if self.settings.estimation else None

    @property
    def inputs(self) -> AdmittedInputs:
        """The AdmittedInputs; the measurement without the signals that do not hold."""
        arrived, screened = self.inbox.measurement, self.screened
        return self.inbox.admitted(
            self.preparation.timetable, screened.holding if arrived is screened.as_arrived else arrived,
            screened.doubt)._replace(heater_refusal=self.heater_refusal, inactive=self.inactive)

    @property
    def view(self) -> PlannerState:
        """The PlannerState: what diagnostics, files, simulations and studies read."""
        inbox, inputs, knowledge = self.inbox, self.inputs, self.knowledge
        active, scale = inputs.active_timetable, inbox.scale_verdict
        return PlannerState(
            vehicle=inbox.vehicle,
            settings=inbox.settings,
            choices=inbox.choices,
            last_seen=self._battery_seen_last(inputs.measurement),
            rivals=inbox.rivals,
            mission=inbox.mission,
            active_mission=None if active is None else active.mission,
            preparation_goal=self.preparation.goal,
            latest_mission=inbox.latest_mission,
            unit_warnings=inbox.unit_warnings,
            refused_route=inbox.refused_route,
            refused_progress=inbox.refused_progress,
            place=None if inbox.timetable is None else inbox.timetable.place,
            overtaken_states=inbox.overtaken_states,
            measurement=inputs.measurement,
            regime=knowledge.regime,
            signal_verdicts=knowledge.verdicts if scale is None else (*knowledge.verdicts, scale),
            estimate=self.estimate,
            stand_report=self.learning.stand_watch.report if inbox.settings.estimation else None,
            decision=self.shown,
            latest_command=self.latest_command,
            heater_answer=self.answers.report(self.now_ns, inbox.settings, self.heater_refusal))

    def _battery_seen_last(self, measurement: Measurement | None) -> LastSeen | None:
        """Return the battery's LastSeen: estimated, measured, or from before a restart; None: unknown."""
        estimate = self.estimate
        if estimate is not None:
            return LastSeen(estimate.temperature_c, min(max(estimate.soc, 0.0), 1.0), estimate.stamp_ns)
        if measurement is None:
            return self.last_seen
        return LastSeen(measurement.state.temperature_c, measurement.state.soc, measurement.stamp_ns)
