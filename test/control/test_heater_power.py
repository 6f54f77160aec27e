# SPDX-License-Identifier: Apache-2.0
"""The heater's power: commands, compared with sums over every millisecond, and the answers of its controller."""

from dataclasses import replace
from math import inf

from hypothesis import given
from hypothesis import strategies as st
import pytest
from simulated_drives import drive

from bev_preheat.control.events import HeaterStatusArrived, HeaterStatusUnreadable
from bev_preheat.control.heater import CommandHistory, HeaterAnswers, HeaterStatus, SourcePower
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput
from bev_preheat.estimation.hypotheses import Heater, HeaterReport
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.planner import plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route import load_route
from bev_preheat.simulation.heater import HeaterFault
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.simulation.supervised_drive import START_NS
from bev_preheat.tunables import CONFIRMED_WITHIN_S, LEAST_STATUS_S
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import HeatingGates, HeatSource
from bev_preheat.vehicle.heater_controller import Refusal
from bev_preheat.vehicle.variants import DriveInputs

MS = 1_000_000
COMMANDS = st.lists(st.tuples(st.integers(1, 400), st.sampled_from([0.0, 900.0, 5300.0, 7000.0])),
                    max_size=12)


@pytest.mark.costly
@given(commands=COMMANDS, start_ms=st.integers(0, 3000), length_ms=st.integers(1, 3000))
def test_mean_is_that_of_every_millisecond(commands, start_ms, length_ms):
    history, now_ms, noted = CommandHistory(), 0, []
    for later_ms, power_w in commands:
        now_ms += later_ms
        history = history.noted(now_ms * MS, power_w)
        noted.append((now_ms, power_w))

    def at(instant_ms):
        return next((power_w for since_ms, power_w in reversed(noted) if since_ms <= instant_ms), 0.0)

    every_w = [at(instant_ms) for instant_ms in range(start_ms, start_ms + length_ms)]
    assert history.mean_w(start_ms * MS, (start_ms + length_ms) * MS) == pytest.approx(
        sum(every_w) / length_ms, abs=1e-6)
    assert history.mean_w(start_ms * MS, start_ms * MS) == at(start_ms)


@given(commands=COMMANDS, forgotten_ms=st.integers(0, 5000), later_ms=st.integers(0, 5000))
def test_time_of_heating_is_that_of_every_millisecond(commands, forgotten_ms, later_ms):
    history, now_ms, noted, forgotten = CommandHistory(), 0, [(0, 0.0)], False
    for after_ms, power_w in commands:
        now_ms += after_ms
        if now_ms > forgotten_ms and not forgotten:
            history = history.without_heating(forgotten_ms * MS)
            forgotten = True
        history = history.noted(now_ms * MS, power_w)
        noted.append((now_ms, power_w))
    if not forgotten:
        forgotten_ms = now_ms
        history = history.without_heating(now_ms * MS)
    end_ms = now_ms + later_ms
    ends_ms = [since_ms for since_ms, _ in noted[1:]] + [end_ms]
    heated_ms = sum(max(0, until_ms - max(since_ms, forgotten_ms))
                    for (since_ms, power_w), until_ms in zip(noted, ends_ms) if power_w > 0.0)
    assert history.heated_s(end_ms * MS) == pytest.approx(heated_ms / 1e3, abs=1e-9)


def test_a_clock_that_is_set_back_voids_what_was_commanded():
    history = CommandHistory().noted(5000 * MS, 900.0).noted(9000 * MS, 5300.0).noted(7000 * MS, 7000.0)
    assert [history.power_w(instant_ms * MS) for instant_ms in (6000, 8000)] == [0.0, 7000.0]
    assert history.heating_for_s(9500 * MS) == 2.5 and history.heating_for_s(6000 * MS) == 0.0
    answers, settings = HeaterAnswers(), Settings()
    for stamp_ns in (9000 * MS, 5000 * MS):
        answers = answers.with_answer(HeaterStatus(stamp_ns, 0.0, 0.0), stamp_ns, settings)
    assert answers.status.stamp_ns == 5000 * MS


# From 2 kW in air of -10 degC to 3 kW in air of 10 degC.
SOURCE_W, ANY = Table((-10.0, 10.0), (0.0,), ((2000.0,), (3000.0,))), Table((0.0,), (0.0,), ((1.0,),))


@pytest.mark.parametrize('only_while, shares_cabin_limit, speed_mps, cabin_w, expected_w', [
    ('', False, 0.0, 800.0, 2250.0), ('', False, 20.0, 800.0, 2250.0), ('', True, 20.0, 800.0, 2250.0 - 800.0),
    ('', True, 20.0, 4000.0, 0.0), ('driving', False, 0.0, 800.0, 0.0), ('driving', False, 20.0, 800.0, 2250.0),
    ('standing', True, 0.0, 800.0, 2250.0 - 800.0), ('standing', False, 20.0, 800.0, 0.0)])
def test_a_source_draws_no_more_than_air_speed_and_cabin_leave(
        only_while, shares_cabin_limit, speed_mps, cabin_w, expected_w):
    drive = DriveInputs(speed_mps, -5.0, 9e3, 0.0, 9e3, cabin_w, 400.0, 0.0)
    source = HeatSource('motor', SOURCE_W, ANY, only_while, shares_cabin_limit)
    assert SourcePower(source).limit_w(7000.0, drive, 12.0) == pytest.approx(expected_w)
    assert SourcePower().limit_w(7000.0, drive, 12.0) == 7000.0


VEHICLE = load_vehicle('reference')
ROUTE = load_route('reference', VEHICLE.defaults)
STATE, GOAL = BatteryState(-7.0, 0.9), Goal(25.0, 0.0, True)
# So cold that it is heated within a quarter of an hour.
COLD = BatteryState(-25.0, 0.9)
NOW_NS = 5_000 * NS_PER_S
SETTINGS = Settings()
# Of battery states and heater statuses [s], within all timeouts: fewer plans than with one a second.
PERIOD_S = 4.0


def as_it_is(answer, measured_w, now_ns):
    return HeaterStatus(now_ns, answer.requested_w, answer.active_w, answer.refusal, answer.sentence)


def measured(answer, measured_w, now_ns):
    return HeaterStatus(
        now_ns, answer.requested_w, answer.active_w, answer.refusal, answer.sentence, measured_w=measured_w)


def driven(until_s, told_by_heater=None, state=STATE, vehicle=VEHICLE, route=ROUTE, goal=GOAL, period_s=PERIOD_S,
           **how):
    """Yield a Seen for each command of a drive until an instant [s]."""
    return drive(vehicle, DrivePhase(route, goal), state, until_s, told_by_heater,
                 sensors=Sensors(period_s=period_s), **how)


@pytest.mark.parametrize('estimation', [True, False])
def test_what_the_car_refuses_is_not_promised(estimation):
    gated = replace(VEHICLE, heating_gates=HeatingGates(minimum_soc=0.95))
    steps = list(driven(500.0 if estimation else 1000.0, as_it_is, COLD, gated, planned_for=VEHICLE,
                        estimation=estimation))
    _, command, decision, planner, car = steps[-1]
    assert decision.status is Status.TARGET_UNREACHABLE
    assert decision.sentence is None or decision.explanation == decision.sentence
    assert decision.explanation.startswith(
        'The heater does not heat (LOW_CHARGE): the state of charge is ')
    assert '. Driving alone does not warm the battery enough: arrival in ' in decision.explanation
    # The promise is the drive without heating, which an independent plan gives from the start.
    unheated = plan_unheated(VEHICLE, ROUTE, COLD, GOAL)
    assert decision.plan.arrival_temperature_c == pytest.approx(unheated.arrival_temperature_c, abs=0.3)
    assert car.plant.energy_wh.hvch_electric == 0.0
    # Never claimed, although heat is commanded, so that it begins as soon as the car allows it.
    assert all(seen.decision.status is not Status.HEATING for seen in steps)
    assert command.battery_heating_power_w > 0.0
    # The heater does as its controller says.
    if estimation:
        assert planner.state.estimate.heater.heater is Heater.ANSWERS


def test_refusal_that_ends_is_forgotten():
    def refuses_for_a_while(answer, measured_w, now_ns):
        # The first 500 s of the drive.
        if now_ns < START_NS + 500 * NS_PER_S:
            return HeaterStatus(now_ns, answer.requested_w, 0.0, Refusal.HEATER_FAULT, 'coolant is low')
        return as_it_is(answer, measured_w, now_ns)

    steps = list(driven(600.0, refuses_for_a_while))
    refused, served = next(seen for seen in steps if seen.at_s >= 479.0), steps[-1]
    assert 'The heater does not heat (HEATER_FAULT): coolant is low.' in refused.decision.explanation
    assert served.decision.status is Status.WAITING
    assert 'does not heat' not in served.decision.explanation


def test_the_share_that_a_limited_heater_reports_is_planned_with():
    def limited(answer, measured_w, now_ns):
        return HeaterStatus(now_ns, answer.requested_w, 0.5 * answer.requested_w, Refusal.HEATER_FAULT, 'half')

    steps = list(driven(inf, limited, COLD, route=ROUTE.before(1500.0), faults=(HeaterFault(0.0, share=0.5),)))
    early = next(seen for seen in steps if seen.at_s >= 120.0)
    assert early.decision.explanation.startswith('The heater delivers only 50 % of its command. ')
    assert early.command.battery_heating_power_w == pytest.approx(7000.0 - 1978.0)
    # The car knows how warm it gets; the other half would be 6 K more.
    assert early.decision.plan.arrival_temperature_c == pytest.approx(steps[-1].car.plant.temperature_c, abs=1.0)


def test_honest_answers_change_no_drive():
    # Heated for some minutes in the middle.
    silent_s, honest_s = (
        [seen.at_s for seen in driven(590.0, told_by_heater, route=ROUTE.before(600.0), goal=Goal(-4.6))
         if seen.command.total_w > 0.0] for told_by_heater in (None, measured))
    assert silent_s[0] == pytest.approx(honest_s[0], abs=40.0) and silent_s[0] > 60.0
    # A heater is on or off, and half a minute more or less is worth little.
    assert len(silent_s) == pytest.approx(len(honest_s), abs=30.0)


def test_dead_heater_whose_controller_measures_0_w_is_not_promised_within_seconds():
    steps = list(driven(300.0, measured, COLD, faults=(HeaterFault(0.0, share=0.0),), period_s=1.0))
    commanded_s = next(seen.at_s for seen in steps if seen.command.total_w > 0.0)
    refused_s = next(seen.at_s for seen in steps if 'it reports 0 W' in seen.decision.explanation)
    assert refused_s - commanded_s <= CONFIRMED_WITHIN_S + LEAST_STATUS_S + 1.0
    assert steps[-1].planner.state.answers.hvch.doubt == ''


@pytest.mark.parametrize('lie, faults, words', [
    (as_it_is, (HeaterFault(0.0, share=0.0),), 'battery temperature and power show no heat'),
    (lambda answer, measured_w, now_ns: HeaterStatus(
        now_ns, answer.requested_w, 0.0, Refusal.HEATER_FAULT, 'broken'), (),
     'battery temperature and power show more heat than it reports')], ids=['claims heat', 'denies heat'])
def test_answers_that_battery_and_power_contradict_are_doubted(lie, faults, words):
    *_, last = driven(1400.0, lie, COLD, faults=faults)
    answer = last.planner.state.answers.hvch
    assert words in answer.doubt
    assert answer.doubt.startswith('hvch_status is in doubt: it reports ')
    assert last.planner.state.heater_refusal == ''


@pytest.mark.parametrize('from_c, measured_w, faults, accused', [
    (COLD.temperature_c, 0.0, (), set()), (-7.0, 5022.0, (), set()),
    (-7.0, 0.0, (HeaterFault(0.0, stuck_on=True),), {Heater.STUCK_ON})])
def test_a_measured_power_that_is_wrong_accuses_no_healthy_heater(from_c, measured_w, faults, accused):
    told, doubts = {Heater.ANSWERS}, ['']
    for seen in driven(inf, lambda answer, _, now_ns: measured(answer, measured_w, now_ns), BatteryState(
            from_c, 0.9), faults=faults):
        state = seen.planner.state
        if state.estimate is not None and state.answers.hvch.status is not None:
            told.add(state.estimate.heater.heater)
            doubts.append(state.answers.hvch.doubt)
        # On for half a minute after the doubt.
        if doubts[-30:][0]:
            break
    assert told == {Heater.ANSWERS} | accused
    assert doubts[-1].startswith(f'hvch_status is in doubt: it reports {measured_w:.0f} W')


def answers_with(seconds=0.0, **fields):
    """Return answers to 5 kW that were commanded for some seconds."""
    commanded = CommandHistory().noted(NOW_NS - round(seconds * NS_PER_S), 5000.0)
    return HeaterAnswers(commanded=commanded).with_answer(HeaterStatus(
        **{'stamp_ns': NOW_NS, 'requested_w': 5000.0, 'active_w': 0.0, **fields}), NOW_NS, SETTINGS)


def test_silent_heater_refuses_nothing_and_is_reported():
    answers = answers_with(60.0, refusal=Refusal.LOW_CHARGE)
    later_ns = NOW_NS + 6 * NS_PER_S
    assert answers.refusal(later_ns, SETTINGS) == ''
    assert 'hvch_status is 6 s old' in answers.silence(later_ns, SETTINGS)
    # Commands count as served again.
    answers = answers.with_command(later_ns, 4000.0, SETTINGS)
    assert answers.history.power_w(later_ns) == 4000.0


@pytest.mark.parametrize('age_s, words', [(6.0, '6 s old; at most 5 s'), (-2.0, '2 s ahead of the clock')])
def test_status_of_another_time_is_refused(age_s, words):
    answers = HeaterAnswers()
    with pytest.raises(InvalidInput, match=words):
        answers.with_answer(HeaterStatus(NOW_NS - round(age_s * NS_PER_S), 0.0, 0.0), NOW_NS, SETTINGS)


def test_statuses_alone_give_no_command_and_bad_ones_are_reported():
    supervisor = Supervisor(VEHICLE, SETTINGS)
    output = supervisor.step(NOW_NS, HeaterStatusArrived(HeaterStatus(NOW_NS, 0.0, 0.0)))
    assert (output.command, output.decision, output.refusals) == (None, None, ())
    output = supervisor.step(NOW_NS, HeaterStatusUnreadable(InvalidInput('active_power: nan W')))
    assert [refusal.source for refusal in output.refusals] == ['hvch_status']
    assert supervisor.state.answers.hvch.problem == 'hvch_status refused: active_power: nan W'
    supervisor.step(NOW_NS, HeaterStatusArrived(HeaterStatus(NOW_NS, 0.0, 0.0)))
    assert supervisor.state.answers.hvch.problem == ''


# A quarter of an hour, which is too short for the target, so it is heated until the gate closes on the way.
@pytest.mark.parametrize('estimation, gates', [
    (False, HeatingGates(maximum_temperature_c=-3.0)), (True, HeatingGates(minimum_soc=0.87)),
    (False, HeatingGates(power_steps_w=(1500.0, 4000.0)))])
def test_commands_keep_the_gates_of_the_vehicle_file(estimation, gates):
    def is_open(seen):
        state = seen.planner.state.measurement.state
        return state.temperature_c < gates.maximum_temperature_c and state.soc >= gates.minimum_soc

    heated_w = set()
    for seen in driven(850.0, vehicle=replace(VEHICLE, heating_gates=gates), route=ROUTE.before(900.0),
                       estimation=estimation, minimum_on_time_s=600.0):
        if seen.command.total_w > 0.0:
            assert is_open(seen)
            heated_w.add(seen.command.total_w)
    assert heated_w == {4000.0} if gates.power_steps_w else heated_w and not is_open(seen)


@pytest.mark.parametrize('refusal', [Refusal.HOT_BATTERY, Refusal.NOT_REFUSED])
def test_the_idle_power_of_a_heater_is_no_heat(refusal):
    # Electronics and pump of a heater on CAN, which counts in steps of 40 W.
    refused = answers_with(60.0, measured_w=40.0, refusal=refusal).refusal(NOW_NS, SETTINGS)
    assert refused.startswith(f'The heater does not heat ({refusal.name})')
    assert answers_with(60.0, measured_w=400.0, refusal=refusal).refusal(NOW_NS, SETTINGS) == ''


@pytest.mark.parametrize('share, active_w, refuses', [(0.9, 0.0, False), (1.1, 0.0, True), (9.0, 40.0, False)])
def test_heat_may_take_a_while_to_be_confirmed_and_any_is_no_refusal(share, active_w, refuses):
    answers = answers_with(share * CONFIRMED_WITHIN_S, active_w=active_w, refusal=Refusal.CABIN_FIRST)
    assert bool(answers.refusal(NOW_NS, SETTINGS)) is refuses


def test_a_doubted_answer_a_lease_that_ended_and_another_clock_leave_no_heat():
    later_ns = NOW_NS + NS_PER_S
    answers = answers_with(5.0, active_w=5000.0)
    doubted, _ = answers.judged(HeaterReport(Heater.DEAD, 0.997, 0.0), NOW_NS, SETTINGS)
    doubted = doubted.with_command(NOW_NS, 1000.0, SETTINGS).with_answer(
        HeaterStatus(later_ns, 5000.0, 5000.0), later_ns, SETTINGS)
    assert doubted.history.power_w(later_ns) == 1000.0
    assert answers.off_since(later_ns).history.power_w(later_ns) == 0.0
    assert answers.without_instants().status is None
    trips = answers, answers.on_new_trip(later_ns)
    assert [each.history.heated_s(later_ns) for each in trips] == [1.0, 0.0]


def test_doubt_ends_with_the_trip():
    answers = answers_with(active_w=5000.0)
    answers, is_refuted = answers.judged(HeaterReport(Heater.DEAD, 0.997, 0.0), NOW_NS, SETTINGS)
    assert not is_refuted
    assert 'probability 99.7 %' in answers.doubt
    assert not answers.are_used(NOW_NS, SETTINGS)
    assert answers.on_new_trip(NOW_NS).are_used(NOW_NS, SETTINGS)
