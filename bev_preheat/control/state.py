# SPDX-License-Identifier: Apache-2.0
"""The planner's state between two steps: one value, which `supervisor.step` replaces at each instant."""

from __future__ import annotations

from typing import NamedTuple

from bev_preheat.control.command import Commander
from bev_preheat.control.decision import Command, Decision, Moment, Unserved, WITHOUT_ROUTE
from bev_preheat.control.decision_maker import DecisionMaker
from bev_preheat.control.heater import Answers, FAULTS
from bev_preheat.control.inbox import Inbox
from bev_preheat.control.inputs import Measurement, Mission
from bev_preheat.control.knowledge import Knowledge
from bev_preheat.control.learning import Learning, StandReport
from bev_preheat.control.preparation import Preparation
from bev_preheat.control.preparation_goal import PreparationGoal
from bev_preheat.control.regime import RegimeReport
from bev_preheat.control.settings import Settings
from bev_preheat.estimation.before_restart import DriverChoices, LastSeen, NO_CHOICES
from bev_preheat.estimation.estimate import Estimate
from bev_preheat.estimation.hypotheses import Heater, HeaterReport
from bev_preheat.estimation.prior import Learned
from bev_preheat.estimation.signal_checks import SignalVerdict
from bev_preheat.planning.status import Status
from bev_preheat.tunables import SHARE_STEPS
from bev_preheat.vehicle.description import HVCH, Vehicle


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
    the `answers` of the heat sources with `heater_refusal`, the sentence on heat that the HVCH refuses ('' for
    none), and the other sources that are `unserved`.
    `screened` is the latest measurement with the signals that hold, `seen_before` the battery before a restart,
    None: unknown.

    Knowledge, about the `known_vehicle`: `knowledge` of regime and signals, `learning` about the car.

    Decisions: the `decision_maker`, the decision as it was `intended`, and the `decision` with the status and
    sentence of the command; the `commander`, the `latest_command` and the `published_status`, None before the
    first. `is_in_doubt`: it is uncertain that the vehicle charges on the latest mission.

    The properties are what diagnostics, files, simulations and studies read.
    """

    known_vehicle: Vehicle
    inbox: Inbox
    knowledge: Knowledge
    learning: Learning
    seen_before: LastSeen | None = None
    now_ns: int = 0
    preparation: Preparation = Preparation()
    answers: Answers = Answers()
    heater_refusal: str = ''
    unserved: tuple[Unserved, ...] = ()
    inactive: str = ''
    screened: Screened = Screened()
    decision_maker: DecisionMaker = DecisionMaker()
    intended: Decision = WITHOUT_ROUTE
    decision: Decision = WITHOUT_ROUTE
    commander: Commander = Commander()
    latest_command: Command | None = None
    published_status: Status | None = None
    is_in_doubt: bool = False

    @classmethod
    def begun(cls, vehicle: Vehicle, settings: Settings, learned: Learned | None = None,
              last_seen: LastSeen | None = None, choices: DriverChoices = NO_CHOICES) -> State:
        """Return the State without input, but with the knowledge from before a restart; None: unknown."""
        return cls(vehicle, Inbox.empty(vehicle, settings, choices), Knowledge(), Learning.begun(
            vehicle, learned, last_seen), last_seen, answers=Answers().of_vehicle(vehicle))

    # Inputs

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle as its file describes it."""
        return self.inbox.vehicle

    @property
    def settings(self) -> Settings:
        """The Settings."""
        return self.inbox.settings

    @property
    def is_enabled(self) -> bool:
        """Whether preheating is switched on."""
        return self.inbox.is_enabled

    @property
    def mission(self) -> Mission | None:
        """The Mission of the route; None without one."""
        return self.inbox.mission

    @property
    def active_mission(self) -> Mission | None:
        """The Mission that is planned for: the one made for the `preparation_goal`, else that of the route."""
        timetable = self.preparation.timetable or self.inbox.timetable
        return None if timetable is None else timetable.mission

    @property
    def preparation_goal(self) -> PreparationGoal | None:
        """The current PreparationGoal; None without one."""
        return self.preparation.goal

    @property
    def measurement(self) -> Measurement | None:
        """The latest valid Measurement with the signals that hold; None before the first."""
        arrived, screened = self.inbox.measurement, self.screened
        return screened.holding if arrived is screened.as_arrived else arrived

    @property
    def moment(self) -> Moment:
        """The Moment of `now_ns`; its measurement is without the signals that do not hold."""
        reports = self.learning.reports if self.settings.estimation else {}
        suspected = tuple((name, report.suspected) for name, report in reports.items()
                          if report.suspected is not None)
        inputs = self.inbox.moment(self.now_ns, self.preparation.timetable, self.measurement, self.screened.doubt)
        return inputs._replace(
            heater_refusal=self.heater_refusal, inactive=self.inactive, unserved=self._all_unserved,
            heater_share=self.answers.hvch.limited_share(self.now_ns, self.settings),
            suspected=suspected, regime=self.regime, estimate=self.estimate, temperature_c=self.temperature_c,
            direction=self.commander.direction, heated_s=self.answers.heated_s(self.now_ns, self.vehicle))

    @property
    def _all_unserved(self) -> tuple[Unserved, ...]:
        """Those that refuse, that is tried, and those that are dead or derated by the estimation."""
        if not self.unserved and len(self.learning.estimators) == 1:
            return ()
        reports, refused = self.source_reports, {each.name for each in self.unserved}
        tried = [name for name in (self.learning.trial.name,) if name in reports and name not in refused]
        return (*self.unserved, *(
            Unserved(name, f'A heat source does not heat: the {name} is switched off to tell which.', False)
            for name in tried), *(
            Unserved(name, FAULTS[report.heater].format(name, share=100.0 * report.share), False,
                     round(SHARE_STEPS * report.share) / SHARE_STEPS)
            for name, report in reports.items()
            if name not in refused and report.heater in (Heater.DEAD, Heater.DERATED)))

    @property
    def source_reports(self) -> dict[str, HeaterReport]:
        """The reports on heat sources beside the HVCH, by name."""
        return {name: report for name, report in self.learning.reports.items()
                if name != HVCH} if self.settings.estimation else {}

    # Knowledge

    @property
    def regime(self) -> RegimeReport:
        """The RegimeReport, by evidence."""
        return self.knowledge.regimes.report

    @property
    def signal_verdicts(self) -> tuple[SignalVerdict, ...]:
        """The SignalVerdicts; () while every signal holds."""
        verdicts, scale = self.knowledge.doubts.verdicts, self.inbox.scale_verdict
        return verdicts if scale is None else (*verdicts, scale)

    @property
    def estimate(self) -> Estimate | None:
        """The latest estimation.estimate.Estimate; None without one."""
        return self.learning.estimate if self.settings.estimation else None

    @property
    def temperature_c(self) -> float | None:
        """The battery's temperature [deg C], estimated or as measured; None before the first."""
        if self.estimate is not None:
            return self.estimate.temperature_c
        return None if self.measurement is None else self.measurement.state.temperature_c

    @property
    def last_seen(self) -> LastSeen | None:
        """The battery as it was seen last: estimated, measured, or from before a restart; None: unknown."""
        estimate, measurement = self.estimate, self.measurement
        if estimate is not None:
            return LastSeen(estimate.temperature_c, min(max(estimate.soc, 0.0), 1.0), estimate.stamp_ns)
        if measurement is None:
            return self.seen_before
        return LastSeen(measurement.state.temperature_c, measurement.state.soc, measurement.stamp_ns)

    @property
    def stand_report(self) -> StandReport | None:
        """The report on the trip's first battery state; None without one."""
        return self.learning.stand_watch.report if self.settings.estimation else None
