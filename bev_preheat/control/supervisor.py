# SPDX-License-Identifier: Apache-2.0
"""
One step of the planner: a State, the time and events in, a State and one output out.

    admit (checks, age, order) -> know (regime, signals) -> learn -> decide (goal, plan) -> gate -> output
The node, the simulated drives and every replay take this step, with a Supervisor that keeps the State between two.
The result of a stage is kept if a later one fails. Instants are integers, in nanoseconds of the node's clock.
"""
from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from bev_preheat.control.decision import Command, Decision, find_obstacle, Unserved
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
from bev_preheat.control.heater import Answers, FAULTS, HeaterAnswers
from bev_preheat.control.inbox import InputChanges, NO_CHANGES
from bev_preheat.control.inputs import Measurement
from bev_preheat.control.knowledge import Knowledge
from bev_preheat.control.learning import Learning
from bev_preheat.control.preparation_goal import PreparationOutcome
from bev_preheat.control.settings import Settings
from bev_preheat.control.state import Screened, State
from bev_preheat.errors import InvalidInput, LONGEST_PROBLEM, shortened
from bev_preheat.estimation.before_restart import DriverChoices, LastSeen, NO_CHOICES
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.estimation.prior import Learned
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat.tunables import SHARE_STEPS
from bev_preheat.vehicle.description import Vehicle

# Positions, and answers of the heater: no plan is made for them alone.
WITHOUT_PLAN = ProgressArrived, ProgressUnreadable, HeaterStatusArrived, HeaterStatusUnreadable


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


def step(state: State, now_ns: int, *events: Event) -> tuple[State, StepOutput]:
    """
    Return the State after an instant, and the StepOutput.

    Each event (see `events`) is admitted and planned for; positions wait for the next other event. Without
    an event time passes: the command is renewed, and a decision whose inputs have expired is dropped. An
    unexpected exception switches the heater off.
    """
    refusals: list[Refusal] = []
    try:
        state = state._replace(now_ns=now_ns)
        for event in events:
            state, error = admit(state, event)
            if isinstance(error, InvalidInput):
                refusals.append(Refusal(event.source, error))
            elif error is not None:
                raise error
        before, state = state, heed_heater(state)
        is_heater_news = state is not before
        has_news = bool(events) or is_heater_news
        if not is_heater_news and events and all(
                isinstance(event, WITHOUT_PLAN) for event in events):
            output = StepOutput()
        else:
            if has_news:
                changes = state.inbox.changes
                # A measurement that cannot be learned from must not be tried again and again.
                state = state._replace(inbox=state.inbox._replace(changes=replace(changes, measurements=())))
                state = know(state, changes, events)
            before, state = state, pass_time(state)
            # A trip that has just ended needs another decision, whatever the clock does.
            state, obstacle = decide(state, has_news or state.inbox.timetable is not before.inbox.timetable)
            state, obstacle = conclude_preparation(state, obstacle)
            state = give_command(state, obstacle)
            state, output = publish(state, has_news)
    except Exception as error:
        state, output = fail(state, now_ns, f'{type(error).__name__}: {error}')
    outcomes = state.preparation.outcomes
    return state._replace(preparation=state.preparation._replace(outcomes=())), output._replace(
        refusals=tuple(refusals), outcomes=outcomes)


def fail(state: State, now_ns: int, what: str) -> tuple[State, StepOutput]:
    """Return the State and the StepOutput that switch the heater off after an exception, given as text."""
    what = shortened(what, LONGEST_PROBLEM)
    decision = Decision(Status.INTERNAL_ERROR, f'Planning failed: {what}')
    state = _off(state, now_ns, Status.INTERNAL_ERROR)._replace(intended=decision, decision=decision)
    return state, StepOutput(command=state.latest_command, failure=what)


def stop(state: State, now_ns: int) -> tuple[State, StepOutput]:
    """Return the State and the StepOutput that leave the heater off when the process ends."""
    state = _off(state, now_ns, Status.SHUTTING_DOWN)
    return state, StepOutput(command=state.latest_command)


# The stages of a step


def admit(state: State, event: Event) -> tuple[State, Exception | None]:
    """Return the State with an event, and the exception if it is refused, or if that fails."""
    now_ns, inbox, preparation, answers = state.now_ns, state.inbox, state.preparation, state.answers
    error: Exception | None = None
    match event:
        case PreparationWanted(goal):
            preparation, error = preparation.begun(goal, state.moment)
            inbox = inbox if error is not None else inbox.with_other_goal()
        case PreparationEnded(goal, ending, explanation):
            preparation = preparation.ended(goal, ending, explanation, state.moment)
            inbox = inbox if preparation is state.preparation else inbox.with_other_goal()
        case HeaterStatusArrived(status, name):
            try:
                answers = answers.changed(name, lambda each: each.with_answer(status, now_ns, state.settings))
            except InvalidInput as refusal:
                error = refusal
        case HeaterStatusUnreadable():
            error = event.error
        case ActivationChanged():
            state = state._replace(inactive='' if event.is_active else event.why_not)
        case _:
            inbox, error = inbox.taken(event, now_ns)
    if isinstance(error, InvalidInput) and isinstance(event, HeaterStatusArrived | HeaterStatusUnreadable):
        problem = error
        answers = answers.changed(event.name, lambda each: each.with_problem(problem))
    return state._replace(inbox=inbox, preparation=preparation, answers=answers), error


def heed_heater(state: State) -> State:
    """Return the State with the sentences on heat that the heat sources refuse."""
    now_ns, settings, answers = state.now_ns, state.settings, state.answers
    refusal = answers.hvch.refusal(now_ns, settings)
    unserved = []
    for source, each in zip(state.vehicle.heat_sources, answers.others):
        share = each.limited_share(now_ns, settings)
        if sentence := each.refusal(now_ns, settings, source.cools):
            unserved.append(Unserved(each.name, sentence, True))
        elif share < 1.0:
            sentence = FAULTS[Heater.DERATED].format(each.name, share=100.0 * share)
            unserved.append(Unserved(each.name, sentence, False, max(1, round(SHARE_STEPS * share)) / SHARE_STEPS))
    return state if (refusal, tuple(unserved)) == (state.heater_refusal, state.unserved) else state._replace(
        heater_refusal=refusal, unserved=tuple(unserved))


def know(state: State, changes: InputChanges, events: tuple[Event, ...]) -> State:
    """Return the State with all that is known brought up to date with the admitted events and their changes."""
    state = state._replace(inbox=state.inbox._replace(changes=NO_CHANGES))
    state = _with_vehicle(state, next((
        event.learned for event in events if isinstance(event, Reconfigured) and event.learned), None))
    if changes.clock_restarted:
        state = state._replace(
            learning=state.learning.without_instants(), knowledge=state.knowledge.without_instants(),
            preparation=state.preparation.without_instants(),
            answers=state.answers.each(HeaterAnswers.without_instants))
    if changes.has_new_mission:
        state = _with_new_mission(state, changes.has_new_trip)
    if changes.has_new_trip:
        state = state._replace(
            learning=state.learning.on_new_trip(),
            answers=state.answers.each(lambda each: each.on_new_trip(state.now_ns)))
    for measurement in changes.measurements:
        state = learn(state, measurement)
    return state._replace(preparation=state.preparation.revised(state.moment))


def learn(state: State, measurement: Measurement) -> State:
    """Return the State with a valid Measurement: its signals are checked, and it is learned from."""
    temperature_c = state.temperature_c
    if temperature_c is None:
        temperature_c = measurement.state.temperature_c
    powers = state.answers.powers(state.vehicle, temperature_c, state.learning.shares)
    knowledge, known = state.knowledge.seen(measurement, state.moment, powers)
    state = state._replace(
        knowledge=knowledge, inbox=state.inbox.with_timetable(known.timetable),
        screened=Screened(measurement, known.measurement, knowledge.obstacle))
    moment = state.moment
    state = state._replace(preparation=state.preparation.seen(known.measurement, known.command_w, moment.mission))
    if not moment.settings.estimation:
        return state
    state = state._replace(learning=state.learning.learned(known, moment, powers))
    if state.estimate is None:
        return state
    learning, reports, judged = state.learning, state.learning.reports, []
    for answers in state.answers.of_all:
        report, is_refuted = reports.get(answers.name), False
        if report is not None:
            answers, is_refuted = answers.judged(report, state.now_ns, state.settings)
        judged.append(answers)
        if is_refuted:
            learning = learning.with_acquitted_heater(answers.name)
    return state._replace(answers=Answers(judged[0], tuple(judged[1:])), learning=learning)


def pass_time(state: State) -> State:
    """
    Return the State in which a trip whose time is over has ended.

    A recent battery state must confirm the time: a clock that jumps ahead for a moment ends no trip.
    """
    timetable, measurement = state.inbox.timetable, state.inbox.measurement
    timeout_ns = state.settings.battery_state_timeout_s * NS_PER_S
    if timetable is None or measurement is None or state.now_ns - measurement.stamp_ns > timeout_ns:
        return state
    passed = timetable.passed(state.now_ns)
    return state if passed is timetable else state._replace(inbox=state.inbox.with_timetable(passed))


def decide(state: State, is_due: bool) -> tuple[State, Decision | None]:
    """Return the State with its Decision, another if it `is_due`, and the obstacle to heating, if any."""
    moment = state.moment
    obstacle = find_obstacle(moment)
    if obstacle is not None:
        if obstacle.status is Status.STALE_INPUT:
            state = state._replace(knowledge=state.knowledge._replace(feed=state.knowledge.feed.expired()))
        return state._replace(intended=obstacle), obstacle
    if not is_due:
        return state, None
    maker, decision = state.decision_maker.decide(moment)
    # Sentence and deviation are computed when they are read; if that fails, it must fail before the command.
    decision.read()
    answers = state.answers
    if decision.status in (Status.CHARGING, Status.ARRIVED):
        answers = answers.each(lambda each: each.without_heating(moment.now_ns))
    return state._replace(decision_maker=maker, intended=decision, answers=answers), None


def conclude_preparation(state: State, obstacle: Decision | None) -> tuple[State, Decision | None]:
    """Return the State without a preparation goal whose time has come, with another Decision, and the obstacle."""
    if state.preparation.goal is None:
        return state, obstacle
    state = state._replace(preparation=state.preparation.concluded(state.moment, state.intended, obstacle))
    if state.preparation.goal is not None:
        return state, obstacle
    return decide(state._replace(
        decision_maker=state.decision_maker.for_new_mission(), commander=state.commander.free_to_switch(),
        answers=state.answers.each(lambda each: each.without_heating(state.now_ns))), is_due=True)


def give_command(state: State, obstacle: Decision | None) -> State:
    """Return the State with the command of its instant, and the Decision as it is shown with it."""
    moment = state.moment
    commander, command = state.commander.give(moment, state.intended, obstacle)
    commander, decision = commander.in_words(moment, state.intended)
    return state._replace(
        commander=commander, latest_command=command, decision=decision,
        answers=state.answers.with_command(state.now_ns, command, state.settings))


def publish(state: State, has_news: bool) -> tuple[State, StepOutput]:
    """Return the State after its StepOutput, which has a Decision if that may have changed."""
    status, before = state.decision.status, state.published_status
    if not has_news and status is before:
        return state, StepOutput(state.latest_command)
    return state._replace(published_status=status), StepOutput(
        state.latest_command, state.decision, has_new_status=status is not before)


def _off(state: State, now_ns: int, reason: Status) -> State:
    commander, command = state.commander.off(now_ns, state.settings, reason)
    return state._replace(
        commander=commander, latest_command=command,
        answers=state.answers.with_command(now_ns, command, state.settings))


def _with_vehicle(state: State, learned: Learned | None) -> State:
    """Return the State for the vehicle of its inputs, and for a Learned about the car, if either is new."""
    vehicle, is_new = state.vehicle, state.vehicle is not state.known_vehicle
    if learned or is_new:
        state = state._replace(learning=Learning.begun(vehicle, learned), decision_maker=DecisionMaker())
    return state._replace(known_vehicle=vehicle, knowledge=Knowledge(), answers=state.answers.of_vehicle(
        vehicle)) if is_new else state


def _with_new_mission(state: State, has_new_trip: bool) -> State:
    """
    Return the State for another route plan, which frees the heater's switch.

    It does not if it may differ from the one before in its probability of charging alone: charging is uncertain on
    this mission, or was on the one before of the same trip.
    """
    mission, was_in_doubt = state.inbox.mission, state.is_in_doubt
    is_in_doubt = mission is not None and any(leg.prospect.probability < 1.0 for leg in mission.legs)
    is_doubt_revised = not has_new_trip and (was_in_doubt or is_in_doubt)
    return state._replace(
        decision_maker=state.decision_maker.for_new_mission(), is_in_doubt=is_in_doubt,
        commander=state.commander if is_doubt_revised else state.commander.free_to_switch())


class Supervisor:
    """The planner: its State, which each step replaces by another one."""

    def __init__(self, vehicle: Vehicle, settings: Settings, learned: Learned | None = None,
                 last_seen: LastSeen | None = None, choices: DriverChoices = NO_CHOICES) -> None:
        """Start without input; the arguments are those of `State.begun`."""
        self._state = State.begun(vehicle, settings, learned, last_seen, choices)

    def step(self, now_ns: int, *events: Event) -> StepOutput:
        """Take a `step` with events at an instant [ns]; return its StepOutput."""
        return self._keep(*step(self._state, now_ns, *events))

    def fail(self, now_ns: int, what: str) -> StepOutput:
        """Return the StepOutput that switches the heater off after an exception, given as text."""
        return self._keep(*fail(self._state, now_ns, what))

    def stop(self, now_ns: int) -> StepOutput:
        """Return the StepOutput that leaves the heater off when the process ends."""
        return self._keep(*stop(self._state, now_ns))

    def later_decisions(self) -> tuple[Decision, ...]:
        """Return a Decision for each later leg, planned only now: no command waits. Raises as planning does."""
        return self._state.decision_maker.decide_later(self._state.moment, self._state.decision)

    @property
    def state(self) -> State:
        """The State after the latest step."""
        return self._state

    def go_on_from(self, state: State) -> None:
        """Go on from a State, of a recording or of before a restart."""
        self._state = state

    def _keep(self, state: State, output: StepOutput) -> StepOutput:
        self._state = state
        return output
