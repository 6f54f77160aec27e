# SPDX-License-Identifier: Apache-2.0
"""
One step of the planner: events and the time in, one output out.

    admit (checks, age, order) -> know (regime, signals) -> learn -> decide (goal, plan) -> gate -> output

The node, the simulated drives and every replay call `Supervisor.step`, the only way to change the planner's state.
Instants are integers, in nanoseconds of the node's clock.
"""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.control.command import Commander
from bev_preheat.control.decision import Command, Decision, WITHOUT_ROUTE
from bev_preheat.control.decision_maker import DecisionMaker
from bev_preheat.control.events import (
    Event,
    PreparationEnded,
    PreparationWanted,
    ProgressArrived,
    ProgressUnreadable,
    Reconfigured,
)
from bev_preheat.control.inbox import Inbox
from bev_preheat.control.knowledge import Knowledge
from bev_preheat.control.obstacle import find_obstacle
from bev_preheat.control.preparation import PreparationControl
from bev_preheat.errors import InvalidInput, LONGEST_PROBLEM, shortened
from bev_preheat.estimation.driver_choices import NO_CHOICES
from bev_preheat.estimation.last_seen import LastSeen
from bev_preheat.planning.status import Status

if TYPE_CHECKING:
    from bev_preheat.control.admitted import AdmittedInputs
    from bev_preheat.control.inputs import Measurement, Mission
    from bev_preheat.control.preparation_goal import PreparationGoal, PreparationOutcome
    from bev_preheat.control.regime import RegimeReport
    from bev_preheat.control.settings import Settings
    from bev_preheat.control.soak_watch import StandReport
    from bev_preheat.control.timetable import Timetable
    from bev_preheat.estimation.driver_choices import DriverChoices
    from bev_preheat.estimation.estimate import Estimate
    from bev_preheat.estimation.prior import Learned
    from bev_preheat.signals.verdict import SignalVerdict
    from bev_preheat.vehicle.description import Vehicle


# Positions: no plan is made for them alone.
PLACES = ProgressArrived, ProgressUnreadable


class Refusal(NamedTuple):
    """An input that was refused: its source and an InvalidInput."""

    source: str
    error: InvalidInput


class StepOutput(NamedTuple):
    """
    Everything to publish after a step; None: not published.

    `has_new_status`: the decision's status differs from that of the latest published decision. `refusals` are
    those of this step's events. `failure` is the sentence of an unexpected exception, '' for none. `outcomes`
    are those of the preparation goals that ended.
    """

    command: Command | None = None
    decision: Decision | None = None
    has_new_status: bool = False
    refusals: tuple[Refusal, ...] = ()
    failure: str = ''
    outcomes: tuple[PreparationOutcome, ...] = ()


class Supervisor:
    """
    The planner's state between two steps.

    The properties show the state after the latest step; reading them changes nothing.
    """

    def __init__(self, vehicle: Vehicle, settings: Settings, learned: Learned | None = None,
                 last_seen: LastSeen | None = None, choices: DriverChoices = NO_CHOICES) -> None:
        """
        Start without input.

        From before a restart: the Learned (None: start from the vehicle file), the battery's
        LastSeen (None: unknown), and the DriverChoices that still count.
        """
        self._inbox = Inbox(vehicle, settings, choices)
        self._last_seen = last_seen
        self._preparation = PreparationControl()
        self._knowledge = Knowledge(vehicle)
        self._decision_maker = DecisionMaker(vehicle, learned, last_seen)
        self._commander = Commander()
        # The latest measurement: as it arrived, with only the signals that hold, and the sentence on the others.
        self._arrived: Measurement | None = None
        self._screened: Measurement | None = None
        self._doubt: str | None = None
        self._inputs = self._admitted()
        # As it was made, and with the status and sentence of the command.
        self._decision = self._shown = WITHOUT_ROUTE
        self._latest_command: Command | None = None
        self._published_status: Status | None = None

    def step(self, now_ns: int, *events: Event) -> StepOutput:
        """
        Return the StepOutput of an instant.

        Each event (see `events`) is admitted and planned for; positions wait for the next other event. Without
        an event time passes: the command is renewed, and a decision whose inputs have expired is dropped. An
        unexpected exception switches the heater off.
        """
        refusals: tuple[Refusal, ...] = ()
        try:
            refusals = tuple(refusal for event in events if (refusal := self._admit(event, now_ns)) is not None)
            if not events:
                output = self._let_time_pass(now_ns)
            elif all(isinstance(event, PLACES) for event in events):
                output = StepOutput()
            else:
                output = self._react(now_ns, events)
        except Exception as error:
            output = self.fail(now_ns, f'{type(error).__name__}: {error}')
        return output._replace(refusals=refusals, outcomes=self._preparation.take_outcomes())

    def later_decisions(self) -> tuple[Decision, ...]:
        """
        Return a Decision for each later leg of the current one.

        They are planned when they are asked for, so that the command does not wait for them. Raises anything that
        planning raises.
        """
        return self._decision_maker.decide_later(self._inputs, self._shown)

    def _react(self, now_ns: int, events: tuple[Event, ...]) -> StepOutput:
        self._learn_from_changes(now_ns, events)
        obstacle = self._decide(now_ns)
        return self._publication(self._command(now_ns, self._conclude_preparation(now_ns, obstacle)))

    def _let_time_pass(self, now_ns: int) -> StepOutput:
        self._inputs = self._admitted()
        obstacle = self._obstacle(now_ns)
        self._decision = obstacle or self._decision
        command = self._command(now_ns, self._conclude_preparation(now_ns, obstacle))
        if self._shown.status is self._published_status:
            return StepOutput(command)
        return self._publication(command)

    def fail(self, now_ns: int, what: str) -> StepOutput:
        """Return the StepOutput that switches the heater off after an exception, given in words."""
        what = shortened(what, LONGEST_PROBLEM)
        self._decision = self._shown = Decision(Status.INTERNAL_ERROR, f'Planning failed: {what}')
        return StepOutput(command=self._off(now_ns, Status.INTERNAL_ERROR), failure=what)

    def stop(self, now_ns: int) -> StepOutput:
        """Return the StepOutput that leaves the heater off when the process ends."""
        return StepOutput(command=self._off(now_ns, Status.SHUTTING_DOWN))

    # The state after the latest step

    @property
    def vehicle(self) -> Vehicle:
        """The Vehicle, as its file describes it."""
        return self._inbox.vehicle

    @property
    def settings(self) -> Settings:
        """The Settings."""
        return self._inbox.settings

    @property
    def is_enabled(self) -> bool:
        """Whether preheating is switched on."""
        return self._inbox.is_enabled

    @property
    def choices(self) -> DriverChoices:
        """The DriverChoices, which outlive the process."""
        return self._inbox.choices

    @property
    def last_seen(self) -> LastSeen | None:
        """The battery's LastSeen: estimated, measured, or from before a restart; None: unknown."""
        if self.estimate is not None:
            return LastSeen(self.estimate.temperature_c, min(max(self.estimate.soc, 0.0), 1.0),
                            self.estimate.stamp_ns)
        if self.measurement is None:
            return self._last_seen
        state = self.measurement.state
        return LastSeen(state.temperature_c, state.soc, self.measurement.stamp_ns)

    @property
    def rivals(self) -> str:
        """Names of other nodes that command the same heater; '' for none."""
        return self._inbox.rivals

    @property
    def mission(self) -> Mission | None:
        """The current Mission; None without a route."""
        return self._inbox.mission

    @property
    def active_mission(self) -> Mission | None:
        """The Mission that is planned for: the one made for `preparation_goal`, else that of the route."""
        timetable = self._preparation.timetable or self._inbox.timetable
        return None if timetable is None else timetable.mission

    @property
    def preparation_goal(self) -> PreparationGoal | None:
        """The current PreparationGoal; None without one."""
        return self._preparation.goal

    @property
    def temperature_c(self) -> float | None:
        """The battery's temperature [deg C], estimated or as measured; None before the first."""
        if self.estimate is not None:
            return self.estimate.temperature_c
        return None if self.measurement is None else self.measurement.state.temperature_c

    @property
    def latest_mission(self) -> Mission | None:
        """The latest Mission, including one dropped because it does not fit the parameters."""
        return self._inbox.latest_mission

    @property
    def timetable(self) -> Timetable | None:
        """The Timetable of the current Mission; None without a route."""
        return self._inbox.timetable

    @property
    def refused_progress(self) -> str | None:
        """The sentence of the latest route progress's refusal; None after a valid one, or a route."""
        return self._inbox.refused_progress

    @property
    def measurement(self) -> Measurement | None:
        """The latest valid Measurement with the signals that hold; None before the first."""
        return self._inputs.measurement

    @property
    def regime(self) -> RegimeReport:
        """Whether the vehicle drives, stands or is charged, by evidence."""
        return self._knowledge.regime

    @property
    def signal_verdicts(self) -> tuple[SignalVerdict, ...]:
        """The SignalVerdicts that hold; () while every signal does."""
        scale = self._inbox.scale_verdict
        return self._knowledge.verdicts if scale is None else (*self._knowledge.verdicts, scale)

    @property
    def overtaken_states(self) -> int:
        """Number of battery states dropped because a later one had arrived a moment before them."""
        return self._inbox.overtaken_states

    @property
    def refused_route(self) -> str | None:
        """The sentence of the latest route plan's refusal; None after a valid one."""
        return self._inbox.refused_route

    @property
    def unit_warnings(self) -> list[str]:
        """Sentences on fields of the current route that look like wrong units."""
        return self._inbox.unit_warnings

    @property
    def estimate(self) -> Estimate | None:
        """The latest estimation.estimate.Estimate; None without one."""
        return self._decision_maker.estimate if self.settings.estimation else None

    @property
    def stand_report(self) -> StandReport | None:
        """The StandReport on the trip's first battery state; None without one."""
        return self._decision_maker.stand_report if self.settings.estimation else None

    @property
    def decision(self) -> Decision:
        """The current Decision, with the status and the sentence of the latest command."""
        return self._shown

    @property
    def latest_command(self) -> Command | None:
        """The latest Command; None before the first."""
        return self._latest_command

    # Parts of a step

    def _admitted(self) -> AdmittedInputs:
        """Return the AdmittedInputs of now; a measurement without the signals that do not hold."""
        arrived = self._inbox.measurement
        return self._inbox.admitted(
            self._preparation.timetable, self._screened if arrived is self._arrived else arrived, self._doubt)

    def _admit(self, event: Event, now_ns: int) -> Refusal | None:
        """Take an event in; return its Refusal, None if it is accepted."""
        try:
            if isinstance(event, PreparationWanted):
                self._preparation.begin(event.preparation_goal, self._admitted(), now_ns)
                self._inbox.note_other_goal()
            elif isinstance(event, PreparationEnded):
                if self._preparation.end(
                        event.preparation_goal, event.ending, event.explanation, self._admitted()):
                    self._inbox.note_other_goal()
            else:
                self._inbox.admit(event, now_ns)
        except InvalidInput as error:
            return Refusal(event.source, error)
        return None

    def _learn_from_changes(self, now_ns: int, events: tuple[Event, ...]) -> None:
        """Bring all that is known up to date with the admitted events."""
        changes, history = self._inbox.take_changes(), self._commander.history
        for event in events:
            if isinstance(event, Reconfigured):
                self._reconfigure(event)
        if changes.clock_restarted:
            for part in (self._decision_maker, self._knowledge, self._preparation):
                part.lose_time()
        if changes.has_new_mission:
            self._decision_maker.follow_new_mission()
            self._commander.allow_switching()
        if changes.has_new_trip:
            self._decision_maker.begin_trip()
            history.forget_heating(now_ns)
        self._inputs = self._admitted()
        for measurement in changes.measurements:
            self._see(measurement)
        if self._preparation.goal is not None:
            self._preparation.revise(
                self._inputs, now_ns, 1.0 if self.estimate is None else self.estimate.propulsion_factor)
            self._inputs = self._admitted()

    def _reconfigure(self, event: Reconfigured) -> None:
        if event.learned or event.vehicle is not self._decision_maker.vehicle:
            self._decision_maker = DecisionMaker(event.vehicle, event.learned)
        if event.vehicle is not self._knowledge.vehicle:
            self._knowledge = Knowledge(event.vehicle)

    def _see(self, measurement: Measurement) -> None:
        """Take a valid Measurement in: check its signals and learn from it."""
        inputs, history, stamp_ns = self._inputs, self._commander.history, measurement.stamp_ns
        known = self._knowledge.see(
            measurement, inputs.active_timetable, history, inputs.settings, inputs.defaults)
        self._arrived, self._screened, self._doubt = measurement, known.measurement, self._knowledge.obstacle
        self._inputs = self._admitted()
        self._preparation.see(known.measurement, history.mean_w(stamp_ns, stamp_ns), self._inputs)
        if self.settings.estimation:
            self._decision_maker.learn(known, inputs.active_timetable, history, inputs.mission)

    def _decide(self, now_ns: int) -> Decision | None:
        """Make the Decision of an instant; return the obstacle, None without one."""
        obstacle = self._obstacle(now_ns)
        if obstacle is not None:
            self._decision = obstacle
            return obstacle
        history = self._commander.history
        self._decision = self._decision_maker.decide(
            self._inputs, self._knowledge.regime, now_ns, self._commander.is_heating, history.heated_s(now_ns))
        # Sentence and deviation are computed when they are read; if that fails, it must fail before the command.
        self._decision.read()
        if self._decision.status in (Status.CHARGING, Status.ARRIVED):
            history.forget_heating(now_ns)
        return None

    def _obstacle(self, now_ns: int) -> Decision | None:
        obstacle = find_obstacle(self._inputs, now_ns)
        if obstacle is not None and obstacle.status is Status.STALE_INPUT:
            self._knowledge.note_expired_state()
        return obstacle

    def _conclude_preparation(self, now_ns: int, obstacle: Decision | None) -> Decision | None:
        """End a preparation goal whose time has come and decide without it; return the obstacle after that."""
        if self._preparation.goal is None or not self._preparation.conclude(
                self._inputs, now_ns, self._decision, obstacle, self.temperature_c):
            return obstacle
        self._inputs = self._admitted()
        self._decision_maker.follow_new_mission()
        self._commander.allow_switching()
        self._commander.history.forget_heating(now_ns)
        return self._decide(now_ns)

    def _command(self, now_ns: int, obstacle: Decision | None) -> Command:
        self._latest_command = self._commander.give(now_ns, self._inputs, self._decision, obstacle)
        self._shown = self._commander.in_words(now_ns, self._inputs, self._decision)
        return self._latest_command

    def _off(self, now_ns: int, reason: Status) -> Command:
        self._latest_command = self._commander.off(now_ns, self.settings, reason)
        return self._latest_command

    def _publication(self, command: Command) -> StepOutput:
        """Return the StepOutput that publishes a Command and the Decision."""
        status, before = self._shown.status, self._published_status
        self._published_status = status
        return StepOutput(command, self._shown, has_new_status=status is not before)
