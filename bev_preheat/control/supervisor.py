# SPDX-License-Identifier: Apache-2.0
"""
One step of the planner: events and the time in, one output out.

    admit (checks, age, order) -> know (regime, signals) -> learn -> decide (goal, plan) -> gate -> output

The node, the simulated drives and every replay call `Supervisor.step`, the only way to change the planner's state.
Instants are integers, in nanoseconds of the node's clock.
"""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.control.admitted import find_obstacle
from bev_preheat.control.command import Commander
from bev_preheat.control.decision import Command, Decision, WITHOUT_ROUTE
from bev_preheat.control.decision_maker import DecisionMaker
from bev_preheat.control.events import (
    ActivationChanged,
    Event,
    HeaterStatusArrived,
    HeaterStatusUnreadable,
    PreparationEnded,
    PreparationWanted,
    ProgressArrived,
    ProgressUnreadable,
    Reconfigured,
)
from bev_preheat.control.heater_answer import HeaterAnswers
from bev_preheat.control.inbox import Inbox
from bev_preheat.control.knowledge import Knowledge
from bev_preheat.control.planner_state import PlannerState
from bev_preheat.control.preparation import PreparationControl
from bev_preheat.errors import InvalidInput, LONGEST_PROBLEM, shortened
from bev_preheat.estimation.driver_choices import NO_CHOICES
from bev_preheat.estimation.last_seen import LastSeen
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.status import Status

if TYPE_CHECKING:
    from bev_preheat.control.admitted import AdmittedInputs
    from bev_preheat.control.inputs import Measurement
    from bev_preheat.control.preparation_goal import PreparationOutcome
    from bev_preheat.control.settings import Settings
    from bev_preheat.estimation.driver_choices import DriverChoices
    from bev_preheat.estimation.estimate import Estimate
    from bev_preheat.estimation.prior import Learned
    from bev_preheat.vehicle.description import Vehicle


# Positions: no plan is made for them alone.
PLACES = ProgressArrived, ProgressUnreadable
ANSWERS = HeaterStatusArrived, HeaterStatusUnreadable


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
    """The planner between two steps; `state` shows it."""

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
        self._answers = HeaterAnswers()
        # The sentence on heat that the heater refuses; '' for none.
        self._heater_refusal = ''
        # Why a managed node may not heat; '' if it may.
        self._inactive = ''
        self._now_ns = 0
        # The latest measurement: as it arrived, with only the signals that hold, and the sentence on the others.
        self._arrived: Measurement | None = None
        self._screened: Measurement | None = None
        self._doubt: str | None = None
        self._inputs = self._admitted()
        # As it was made, and with the status and sentence of the command.
        self._decision = self._shown = WITHOUT_ROUTE
        self._latest_command: Command | None = None
        self._published_status: Status | None = None
        # Whether it is uncertain that the vehicle charges on the latest mission.
        self._is_in_doubt = False

    def step(self, now_ns: int, *events: Event) -> StepOutput:
        """
        Return the StepOutput of an instant.

        Each event (see `events`) is admitted and planned for; positions wait for the next other event. Without
        an event time passes: the command is renewed, and a decision whose inputs have expired is dropped. An
        unexpected exception switches the heater off.
        """
        refusals: list[Refusal] = []
        try:
            self._now_ns = now_ns
            for event in events:
                self._admit(event, now_ns, refusals)
            refused, self._heater_refusal = self._heater_refusal, self._answers.refusal(
                now_ns, self._inbox.settings, self._commander.history)
            if not events and refused == self._heater_refusal:
                output = self._let_time_pass(now_ns)
            elif events and refused == self._heater_refusal and all(
                    isinstance(event, (*PLACES, *ANSWERS)) for event in events):
                output = StepOutput()
            else:
                output = self._react(now_ns, events)
        except Exception as error:
            output = self.fail(now_ns, f'{type(error).__name__}: {error}')
        return output._replace(refusals=tuple(refusals), outcomes=self._preparation.take_outcomes())

    def later_decisions(self) -> tuple[Decision, ...]:
        """
        Return a Decision for each later leg of the current one.

        They are planned when they are asked for, so that the command does not wait for them. Raises anything that
        planning raises.
        """
        return self._decision_maker.decide_later(self._inputs, self._shown)

    def _react(self, now_ns: int, events: tuple[Event, ...]) -> StepOutput:
        self._learn_from_changes(now_ns, events)
        self._pass_time(now_ns)
        self._inputs = self._with_timetable(self._inputs)
        obstacle = self._decide(now_ns)
        return self._publication(self._command(now_ns, self._conclude_preparation(now_ns, obstacle)))

    def _let_time_pass(self, now_ns: int) -> StepOutput:
        timetable = self._inbox.timetable
        self._pass_time(now_ns)
        self._inputs = self._admitted()
        if timetable is self._inbox.timetable:
            obstacle = self._obstacle(now_ns)
            self._decision = obstacle or self._decision
        else:
            # The trip has ended: the plan before no longer counts, whatever the clock does.
            obstacle = self._decide(now_ns)
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

    @property
    def state(self) -> PlannerState:
        """The PlannerState after the latest step; reading it changes nothing."""
        inbox, inputs, knowledge, estimate = self._inbox, self._inputs, self._knowledge, self._estimate
        active, scale = self._preparation.timetable or inbox.timetable, inbox.scale_verdict
        return PlannerState(
            vehicle=inbox.vehicle,
            settings=inbox.settings,
            choices=inbox.choices,
            last_seen=self._seen_last(),
            rivals=inbox.rivals,
            mission=inbox.mission,
            active_mission=None if active is None else active.mission,
            preparation_goal=self._preparation.goal,
            latest_mission=inbox.latest_mission,
            unit_warnings=inbox.unit_warnings,
            refused_route=inbox.refused_route,
            refused_progress=inbox.refused_progress,
            place=None if inbox.timetable is None else inbox.timetable.place,
            overtaken_states=inbox.overtaken_states,
            measurement=inputs.measurement,
            regime=knowledge.regime,
            signal_verdicts=knowledge.verdicts if scale is None else (*knowledge.verdicts, scale),
            estimate=estimate,
            stand_report=self._decision_maker.stand_report if inbox.settings.estimation else None,
            decision=self._shown,
            latest_command=self._latest_command,
            heater_answer=self._answers.report(self._now_ns, inbox.settings, self._heater_refusal))

    # Parts of a step

    @property
    def _estimate(self) -> Estimate | None:
        """The latest estimation.estimate.Estimate; None without one."""
        return self._decision_maker.estimate if self._inbox.settings.estimation else None

    def _seen_last(self) -> LastSeen | None:
        """Return the battery's LastSeen: estimated, measured, or from before a restart; None: unknown."""
        estimate, measurement = self._estimate, self._inputs.measurement
        if estimate is not None:
            return LastSeen(estimate.temperature_c, min(max(estimate.soc, 0.0), 1.0), estimate.stamp_ns)
        if measurement is None:
            return self._last_seen
        return LastSeen(measurement.state.temperature_c, measurement.state.soc, measurement.stamp_ns)

    def _admitted(self) -> AdmittedInputs:
        """Return the AdmittedInputs of now; a measurement without the signals that do not hold."""
        arrived = self._inbox.measurement
        return self._inbox.admitted(
            self._preparation.timetable, self._screened if arrived is self._arrived else arrived, self._doubt
        )._replace(heater_refusal=self._heater_refusal, inactive=self._inactive)

    def _pass_time(self, now_ns: int) -> None:
        """
        End the trip if its time is over.

        A recent battery state must confirm the time: a clock that jumps ahead for a moment ends no trip.
        """
        timetable, measurement = self._inbox.timetable, self._inbox.measurement
        timeout_ns = self._inbox.settings.battery_state_timeout_s * NS_PER_S
        if timetable is not None and measurement is not None and now_ns - measurement.stamp_ns <= timeout_ns:
            self._inbox.keep(timetable.passed(now_ns))

    def _with_timetable(self, inputs: AdmittedInputs) -> AdmittedInputs:
        """Return AdmittedInputs with the latest Timetable of the route."""
        timetable = self._inbox.timetable
        return inputs._replace(timetable=timetable, active_timetable=self._preparation.timetable or timetable)

    def _admit(self, event: Event, now_ns: int, refusals: list[Refusal]) -> None:
        """Take an event in, or add its Refusal."""
        try:
            if isinstance(event, PreparationWanted):
                self._preparation.begin(event.preparation_goal, self._admitted(), now_ns)
                self._inbox.note_other_goal()
            elif isinstance(event, PreparationEnded):
                if self._preparation.end(
                        event.preparation_goal, event.ending, event.explanation, self._admitted()):
                    self._inbox.note_other_goal()
            elif isinstance(event, HeaterStatusArrived):
                self._answers.accept(event.status, now_ns, self._inbox.settings)
            elif isinstance(event, ActivationChanged):
                self._inactive = '' if event.is_active else event.why_not
            elif isinstance(event, HeaterStatusUnreadable):
                raise event.error
            else:
                self._inbox.admit(event, now_ns)
        except InvalidInput as error:
            refusals.append(Refusal(event.source, error))
            if isinstance(event, ANSWERS):
                self._answers.refuse(error)

    def _learn_from_changes(self, now_ns: int, events: tuple[Event, ...]) -> None:
        """Bring all that is known up to date with the admitted events."""
        changes = self._inbox.take_changes()
        for event in events:
            if isinstance(event, Reconfigured):
                self._reconfigure(event)
        if changes.clock_restarted:
            for part in (self._decision_maker, self._knowledge, self._preparation, self._answers):
                part.lose_time()
        if changes.has_new_mission:
            self._decision_maker.follow_new_mission()
            if not self._is_doubt_revised(changes.has_new_trip):
                self._commander.allow_switching()
        if changes.has_new_trip:
            self._decision_maker.begin_trip()
            self._answers.begin_trip()
            self._answers.history.forget_heating(now_ns)
        self._inputs = self._admitted()
        for measurement in changes.measurements:
            self._see(measurement)
        if self._preparation.goal is not None:
            estimate = self._estimate
            self._preparation.revise(
                self._inputs, now_ns, 1.0 if estimate is None else estimate.propulsion_factor)
            self._inputs = self._admitted()

    def _is_doubt_revised(self, has_new_trip: bool) -> bool:
        """
        Return whether a new mission may differ in its probability of charging alone.

        Such a one switches no heater at once.

        It is so if charging is uncertain on this mission, or was on the one before of the same trip.
        """
        mission, was_in_doubt = self._inbox.mission, self._is_in_doubt
        self._is_in_doubt = mission is not None and any(leg.prospect.probability < 1.0 for leg in mission.legs)
        return not has_new_trip and (was_in_doubt or self._is_in_doubt)

    def _reconfigure(self, event: Reconfigured) -> None:
        if event.learned or event.vehicle is not self._decision_maker.vehicle:
            self._decision_maker = DecisionMaker(event.vehicle, event.learned)
        if event.vehicle is not self._knowledge.vehicle:
            self._knowledge = Knowledge(event.vehicle)

    def _see(self, measurement: Measurement) -> None:
        """Take a valid Measurement in: check its signals and learn from it."""
        inputs, history = self._inputs, self._answers.history
        known = self._knowledge.see(measurement, inputs, history)
        self._inbox.keep(known.timetable)
        inputs = self._with_timetable(inputs)
        self._arrived, self._screened, self._doubt = measurement, known.measurement, self._knowledge.obstacle
        self._inputs = inputs._replace(measurement=self._screened, doubt=self._doubt)
        self._preparation.see(known.measurement, known.command_w, self._inputs)
        if inputs.settings.estimation:
            self._decision_maker.learn(known, inputs.active_timetable, history, inputs.mission)
            estimate = self._decision_maker.estimate
            if estimate is not None and self._answers.judge(
                    estimate.heater, self._now_ns, inputs.settings, self._commander.history):
                self._decision_maker.acquit_heater()

    def _decide(self, now_ns: int) -> Decision | None:
        """Make the Decision of an instant; return the obstacle, None without one."""
        obstacle = self._obstacle(now_ns)
        if obstacle is not None:
            self._decision = obstacle
            return obstacle
        history = self._answers.history
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
                self._inputs, now_ns, self._decision, obstacle, self.state.temperature_c):
            return obstacle
        self._inputs = self._admitted()
        self._decision_maker.follow_new_mission()
        self._commander.allow_switching()
        self._answers.history.forget_heating(now_ns)
        return self._decide(now_ns)

    def _command(self, now_ns: int, obstacle: Decision | None) -> Command:
        self._latest_command = self._commander.give(now_ns, self._inputs, self._decision, obstacle)
        self._answers.note_command(
            now_ns, self._latest_command.battery_heating_power_w, self._inbox.settings)
        self._shown = self._commander.in_words(now_ns, self._inputs, self._decision)
        return self._latest_command

    def _off(self, now_ns: int, reason: Status) -> Command:
        self._latest_command = self._commander.off(now_ns, self._inbox.settings, reason)
        self._answers.note_command(now_ns, 0.0, self._inbox.settings)
        return self._latest_command

    def _publication(self, command: Command) -> StepOutput:
        """Return the StepOutput that publishes a Command and the Decision."""
        status, before = self._shown.status, self._published_status
        self._published_status = status
        return StepOutput(command, self._shown, has_new_status=status is not before)
