# SPDX-License-Identifier: Apache-2.0
"""
One step of the planner: what happened and the time in, outputs out.

The node, the simulated drives and every replay call `Supervisor.step`, and nothing else changes what
the planner does. Instants are integers, in nanoseconds of the node's clock.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.control.command import Commander, find_obstacle
from bev_preheat.control.decision import Command, Decision, WITHOUT_ROUTE
from bev_preheat.control.decision_maker import DecisionMaker
from bev_preheat.control.events import Event, ProgressArrived, ProgressUnreadable, Reconfigured
from bev_preheat.control.inbox import Inbox
from bev_preheat.control.knowledge import Knowledge
from bev_preheat.errors import InvalidInput, LONGEST_PROBLEM, shortened
from bev_preheat.estimation.driver_choices import NO_CHOICES
from bev_preheat.estimation.last_seen import LastSeen
from bev_preheat.native.library import use_core
from bev_preheat.planning.status import Status

if TYPE_CHECKING:
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


# Where the vehicle is, which nothing is planned for by itself.
PLACES = ProgressArrived, ProgressUnreadable


class Refusal(NamedTuple):
    """An input that was refused: its source and an InvalidInput."""

    source: str
    error: InvalidInput


class StepOutput(NamedTuple):
    """
    What is to be published, None where nothing is.

    `later_decisions` belong to `decision`, one for each later leg. `has_new_status`: the decision's
    status is another one than that of the decision before. `refusals` are the Refusals of this
    step's events. `failure` is the sentence of an exception that nobody foresaw, '' for none.
    `outcomes` are those of the wishes that ended.
    """

    command: Command | None = None
    decision: Decision | None = None
    later_decisions: tuple[Decision, ...] = ()
    has_new_status: bool = False
    refusals: tuple[Refusal, ...] = ()
    failure: str = ''
    outcomes: tuple[PreparationOutcome, ...] = ()


class Supervisor:
    """
    Inbox, judgement and command, joined in one step.

    The properties show the state after the latest step; asking for them changes nothing.
    """

    def __init__(self, vehicle: Vehicle, settings: Settings, learned: Learned | None = None,
                 last_seen: LastSeen | None = None, choices: DriverChoices = NO_CHOICES) -> None:
        """
        Start without input.

        From before a restart: the Learned (None: start from the vehicle file), the battery's
        LastSeen (None: unknown), and the DriverChoices that still count.
        """
        use_core(settings.compiled_core)
        self._inbox = Inbox(vehicle, settings, choices)
        self._last_seen = last_seen
        self._knowledge = Knowledge(vehicle)
        self._decision_maker = DecisionMaker(vehicle, learned, last_seen)
        self._commander = Commander()
        # As it was made, and as the command says it.
        self._decision = self._shown = WITHOUT_ROUTE
        self._latest_command: Command | None = None
        self._published_status: Status | None = None

    def step(self, now_ns: int, *events: Event) -> Iterator[StepOutput]:
        """
        Yield the Outputs of an instant, the urgent ones first; take them all.

        Each event (see `events`) is delivered and planned for; where the vehicle is, with the next
        other event. Without an event time passes: the command is renewed, and a decision whose
        inputs have expired is dropped. An exception that nobody foresaw switches the heater off.
        """
        try:
            yield from self._react(now_ns, events) if events else self._let_time_pass(now_ns)
        except Exception as error:
            yield self.fail(now_ns, f'{type(error).__name__}: {error}')
        outcomes = self._inbox.preparation.take_outcomes()
        if outcomes:
            yield StepOutput(outcomes=outcomes)

    def _react(self, now_ns: int, events: tuple[Event, ...]) -> Iterator[StepOutput]:
        refusals = tuple(filter(None, [self._deliver(event, now_ns) for event in events]))
        use_core(self._inbox.settings.compiled_core)
        if all(isinstance(event, PLACES) for event in events):
            yield StepOutput(refusals=refusals)
            return
        self._attend_to_changes(now_ns, events)
        self._decide(now_ns)
        yield StepOutput(command=self._command(now_ns), refusals=refusals)
        # The command does not wait for the plans of later legs.
        yield self._publication()

    def _let_time_pass(self, now_ns: int) -> Iterator[StepOutput]:
        self._decision = self._obstacle(now_ns) or self._decision
        self._conclude_preparation(now_ns)
        yield StepOutput(command=self._command(now_ns))
        if self._shown.status is not self._published_status:
            yield self._publication()

    def fail(self, now_ns: int, what: str) -> StepOutput:
        """Return the Output that switches the heater off after an exception, told in words."""
        what = shortened(what, LONGEST_PROBLEM)
        self._decision = self._shown = Decision(Status.INTERNAL_ERROR, f'Planning failed: {what}')
        return StepOutput(command=self._off(now_ns, Status.INTERNAL_ERROR), failure=what)

    def stop(self, now_ns: int) -> StepOutput:
        """Return the Output that leaves the heater off when the process ends."""
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
        return None if self._inbox.active_timetable is None else self._inbox.active_timetable.mission

    @property
    def preparation_goal(self) -> PreparationGoal | None:
        """The Wish that is pursued; None: none is."""
        return self._inbox.preparation.goal

    @property
    def temperature_c(self) -> float | None:
        """The battery's temperature [deg C], estimated or as measured; None before the first."""
        if self.estimate is not None:
            return self.estimate.temperature_c
        return None if self.measurement is None else self.measurement.state.temperature_c

    @property
    def latest_mission(self) -> Mission | None:
        """The Mission, or the one that was dropped because it does not fit the parameters."""
        return self._inbox.latest_mission

    @property
    def timetable(self) -> Timetable | None:
        """When the current Mission is where; None without a route."""
        return self._inbox.timetable

    @property
    def refused_progress(self) -> str | None:
        """The sentence of the latest route progress's refusal; None after a valid one, or a route."""
        return self._inbox.refused_progress

    @property
    def measurement(self) -> Measurement | None:
        """The latest valid Measurement; None before the first."""
        return self._inbox.measurement

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
        """How many battery states were dropped because a later one came a moment before them."""
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
        """What the first battery state of the trip says of the sensor; None: nothing."""
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

    def _deliver(self, event: Event, now_ns: int) -> Refusal | None:
        """Return the Refusal of an event; None if it is accepted."""
        try:
            event.deliver(self._inbox, now_ns)
        except InvalidInput as error:
            return Refusal(event.source, error)
        return None

    def _attend_to_changes(self, now_ns: int, events: tuple[Event, ...]) -> None:
        changes = self._inbox.take_changes()
        for event in events:
            if isinstance(event, Reconfigured) and (
                    event.learned or event.vehicle is not self._decision_maker.vehicle):
                self._decision_maker = DecisionMaker(event.vehicle, event.learned)
            if isinstance(event, Reconfigured) and event.vehicle is not self._knowledge.vehicle:
                self._knowledge = Knowledge(event.vehicle)
        if changes.clock_restarted:
            self._decision_maker.lose_time()
            self._knowledge.lose_time()
        if changes.has_new_mission:
            self._decision_maker.follow_new_mission()
            self._commander.allow_switching()
        if changes.has_new_trip:
            self._decision_maker.begin_trip()
            self._commander.history.forget_heating(now_ns)
        inbox, history = self._inbox, self._commander.history
        for measurement in changes.measurements:
            known = self._knowledge.see(
    measurement,
    inbox.active_timetable,
    history,
    inbox.settings,
     inbox.defaults)
            inbox.measurement, inbox.doubt = known.measurement, self._knowledge.obstacle
            inbox.preparation.see(
                known.measurement, history.mean_w(measurement.stamp_ns, measurement.stamp_ns), inbox)
            if self.settings.estimation:
                self._decision_maker.learn(known, inbox.active_timetable, history, inbox.mission)
        if self.preparation_goal is not None:
            inbox.preparation.revise(
                inbox, now_ns, 1.0 if self.estimate is None else self.estimate.propulsion_factor)

    def _decide(self, now_ns: int) -> None:
        self._judge(now_ns)
        self._conclude_preparation(now_ns)

    def _conclude_preparation(self, now_ns: int) -> None:
        """Where the time of a wish has come, decide on what is left without it."""
        inbox = self._inbox
        if self.preparation_goal is not None and inbox.preparation.conclude(
                inbox, now_ns, self._decision, self.temperature_c):
            self._decision_maker.follow_new_mission()
            self._commander.allow_switching()
            self._commander.history.forget_heating(now_ns)
            self._judge(now_ns)

    def _judge(self, now_ns: int) -> None:
        obstacle = self._obstacle(now_ns)
        if obstacle is not None:
            self._decision = obstacle
            return
        history = self._commander.history
        self._decision = self._decision_maker.decide(
            self._inbox, self._knowledge.regime, now_ns, self._commander.is_heating, history.heated_s(now_ns))
        # Worked out when they are read. Where that fails the decision has failed, before any command.
        self._decision.read()
        if self._decision.status in (Status.CHARGING, Status.ARRIVED):
            history.forget_heating(now_ns)

    def _obstacle(self, now_ns: int) -> Decision | None:
        obstacle = find_obstacle(self._inbox, now_ns)
        if obstacle is not None and obstacle.status is Status.STALE_INPUT:
            self._knowledge.note_expired_state()
        return obstacle

    def _command(self, now_ns: int) -> Command:
        self._latest_command = self._commander.give(now_ns, self._inbox, self._decision)
        self._shown = self._commander.in_words(now_ns, self._inbox, self._decision)
        return self._latest_command

    def _off(self, now_ns: int, reason: Status) -> Command:
        self._latest_command = self._commander.off(now_ns, self.settings, reason)
        return self._latest_command

    def _publication(self) -> StepOutput:
        later_decisions = self._decision_maker.decide_later(self._inbox, self._shown)
        status, before = self._shown.status, self._published_status
        self._published_status = status
        return StepOutput(decision=self._shown, later_decisions=later_decisions,
                      has_new_status=status is not before)
