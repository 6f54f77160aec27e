# SPDX-License-Identifier: Apache-2.0
"""The installed `nlp_checker` over real DDS: what it reports, and that it disturbs nobody."""

from array import array
from contextlib import contextmanager
from math import isnan, nan
import signal
import subprocess
import sys
import threading
import time

from bev_preheat_msgs.msg import HvchCommand, OptimalityReport, PreheatPlan, RoutePlan
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import psutil
import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState
from std_srvs.srv import Trigger

from bev_preheat.control.supervisor import NS_PER_S
from bev_preheat.nodes.convert import mission_from_message, nanoseconds, time_message
from bev_preheat.optimum.solve import solve_optimum
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState as State, Goal
from bev_preheat.vehicle import load_vehicle

LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
FEEDING_PERIOD_S = 0.1
# Exact in the float32 of the message.
TEMPERATURE_C, SOC, TARGET_C = 2.25, 0.8125, 15.0
RESERVE_SOC = 0.15
# No check by itself; steps in which an hour and a half takes the solver most of a minute.
ONLY_ASKED = ('-p', 'check_period:=0.0')
SLOW = (*ONLY_ASKED, '-p', 'planning_step:=1.0', '-p', 'time_limit:=300.0')
LONG_S = 5400
SWITCH = ('-p', 'method:=optimal_switch')
COMMAND_PERIOD_S = 0.1
QUICK_COMMANDS = ('-p', f'command_period:={COMMAND_PERIOD_S}')
# What a busy computer may add.
MARGIN_S = 0.5


def route_plan(stamp_ns, route_id='home', duration_s=2400, **fields):
    """Return a RoutePlan whose target is within reach after 40 min."""
    message = RoutePlan(**{
        'route_id': route_id, 'segment_duration': array('d', [30.0] * (duration_s // 30)),
        'speed': [20.0], 'propulsion_power': [14e3], 'propulsion_power_rms': [17e3],
        'ambient_temperature': [-4.0], 'cabin_heating_power': [1600.0],
        'charging_planned': True, 'target_battery_temperature': TARGET_C,
        'minimum_arrival_soc': RESERVE_SOC, **fields})
    message.header.stamp = time_message(stamp_ns)
    return message


class Surroundings:
    """Route, battery and whoever listens; the battery's states come by themselves once fed."""

    def __init__(self, bench):
        self.bench = bench
        self.reports = bench.record(OptimalityReport, 'optimality_report', LATCHED)
        self.plans = bench.record(PreheatPlan, 'preheat_plan')
        self.commands = bench.record(HvchCommand, 'hvch_command')
        self._diagnostics = bench.record(DiagnosticArray, '/diagnostics')
        self._states = bench.publisher(BatteryState, 'battery_state')
        self._routes = bench.publisher(RoutePlan, 'route_plan', LATCHED)
        self.listeners = 0

    def start(self, name, *arguments):
        """Start an executable, and return its NodeProcess once it listens."""
        process = self.bench.start(name, *arguments)
        self.listeners += 1
        self._states.wait_for_subscription(self.listeners)
        self._routes.wait_for_subscription(self.listeners)
        if name == 'nlp_checker':
            self.reports.wait_for_publisher()
        else:
            self.plans.wait_for_publisher()
            self.commands.wait_for_publisher()
        return process

    def now_ns(self):
        return self.bench.node.get_clock().now().nanoseconds

    def send_state(self, stamp_ns=None, **fields):
        message = BatteryState(**{'temperature': TEMPERATURE_C, 'percentage': SOC, **fields})
        message.header.stamp = time_message(stamp_ns or self.now_ns())
        self._states.publish(message)

    def send_route(self, *arguments, **fields):
        """Publish a route that starts now, and return it."""
        message = route_plan(self.now_ns(), *arguments, **fields)
        self._routes.publish(message)
        return message

    @contextmanager
    def feeding(self):
        """Publish battery states all the time."""
        enough = threading.Event()

        def feed():
            while not enough.wait(FEEDING_PERIOD_S):
                self.send_state()

        thread = threading.Thread(target=feed)
        thread.start()
        try:
            yield
        finally:
            enough.set()
            thread.join()

    def check(self):
        """Ask for a check; return the response."""
        return self.bench.call(Trigger, '/nlp_checker/check', Trigger.Request())

    def diagnosis(self, condition):
        """Wait for (level, message, values by name) of the checker's diagnostics."""
        def own(array_message):
            for status in array_message.status:
                if status.name == 'nlp_checker: optimality check':
                    return (status.level, status.message,
                            {item.key: item.value for item in status.values})
            return None

        self._diagnostics.clear()
        return own(self._diagnostics.wait_for(
            lambda message: own(message) is not None and condition(*own(message))))

    def solver_process_id(self):
        """Return the id of the solver's process once it solves."""
        _, _, values = self.diagnosis(lambda level, text, values: values['state'] == 'solving')
        return int(values['solver process'])

    def expect_commands(self, count):
        """Wait for so many commands more, heating and at their period."""
        self.commands.clear()
        commands = self.commands.wait_for_count(count)
        stamps_ns = [nanoseconds(command.header.stamp) for command in commands]
        longest_s = max(after - before for before, after in zip(stamps_ns, stamps_ns[1:])) / NS_PER_S
        assert longest_s < COMMAND_PERIOD_S + MARGIN_S
        assert all(command.battery_heating_power > 0.0 for command in commands)


@pytest.fixture
def surroundings(bench):
    return Surroundings(bench)


def is_gone(process_id):
    try:
        return psutil.Process(process_id).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def of_route(route_id):
    return lambda report: report.route_id == route_id


# What is reported

def test_reports_for_a_new_route_that_the_default_heuristic_is_the_optimum(surroundings):
    surroundings.start('planner', *SWITCH)
    surroundings.start('nlp_checker', *ONLY_ASKED)
    surroundings.send_route()
    with surroundings.feeding():
        report = surroundings.reports.wait_for(of_route('home'))
    assert report.optimal
    assert report.solver_status == 'Solve_Succeeded'
    assert report.infeasible_constraint == ''
    assert report.method == 'optimal_switch'
    assert report.plan_arrival_temperature == pytest.approx(TARGET_C, abs=1e-3)
    assert report.optimal_arrival_temperature == pytest.approx(TARGET_C, abs=1e-3)
    assert abs(report.energy_gap) < 0.05
    assert report.energy_gap == report.plan_energy - report.optimal_energy
    # 40 min with 14 kW and more.
    assert 9000.0 < report.plan_energy < 16000.0
    assert report.plan_heating and report.optimal_heating
    starts_ns = nanoseconds(report.plan_heating_start), nanoseconds(report.optimal_heating_start)
    assert abs(starts_ns[0] - starts_ns[1]) < 5 * NS_PER_S
    # It is the planner's own plan for that instant.
    plan = surroundings.plans.wait_for(lambda plan: plan.header.stamp == report.header.stamp)
    assert plan.battery_energy == report.plan_energy
    assert plan.heating_start == report.plan_heating_start


def test_the_gap_of_another_method_is_that_of_the_same_situation(surroundings):
    surroundings.start('planner', '-p', 'method:=paper')
    surroundings.start('nlp_checker', *ONLY_ASKED)
    sent = surroundings.send_route()
    with surroundings.feeding():
        report = surroundings.reports.wait_for(of_route('home'))
    vehicle = load_vehicle('reference')
    route = mission_from_message(sent, vehicle.defaults, 30.0).route.after(
        (nanoseconds(report.header.stamp) - nanoseconds(sent.header.stamp)) / NS_PER_S)
    situation = vehicle, route, State(TEMPERATURE_C, SOC), Goal(TARGET_C, RESERVE_SOC)
    planned, optimum = plan_preheating(*situation, 'paper'), solve_optimum(*situation).plan
    gap_wh = planned.energy_wh.battery_total - optimum.energy_wh.battery_total
    assert abs(gap_wh) > 1.0
    assert report.method == 'paper'
    assert report.energy_gap == pytest.approx(gap_wh, abs=1e-3)
    assert report.plan_arrival_temperature == pytest.approx(planned.arrival_temperature_c)
    assert report.optimal_arrival_temperature == pytest.approx(
        optimum.arrival_temperature_c, abs=1e-5)


def test_a_plan_in_other_steps_is_made_again_for_the_goal_of_the_planner(surroundings):
    target_c = 11.0
    surroundings.start('planner', *SWITCH, '-p', 'planning_step:=77.0',
                       '-p', f'target_battery_temperature:={target_c}')
    surroundings.start('nlp_checker', *ONLY_ASKED)
    surroundings.send_route(target_battery_temperature=nan)
    with surroundings.feeding():
        report = surroundings.reports.wait_for(of_route('home'))
    assert report.optimal
    assert report.optimal_arrival_temperature == pytest.approx(target_c, abs=1e-3)
    assert report.method == 'optimal_switch'
    assert abs(report.energy_gap) < 0.05


def test_without_a_planner_the_optimum_stands_alone(surroundings):
    surroundings.start('nlp_checker', *ONLY_ASKED)
    surroundings.send_route()
    with surroundings.feeding():
        report = surroundings.reports.wait_for(of_route('home'))
    assert report.optimal
    assert report.optimal_arrival_temperature == pytest.approx(TARGET_C, abs=1e-3)
    assert report.method == ''
    assert isnan(report.plan_energy)
    assert isnan(report.energy_gap)
    assert isnan(report.plan_arrival_temperature)
    assert not report.plan_heating
    assert report.plan_heating_start == Time()


def test_says_what_cannot_be_kept(surroundings):
    surroundings.start('planner', *SWITCH)
    surroundings.start('nlp_checker', *ONLY_ASKED)
    surroundings.send_route('short', 600)
    with surroundings.feeding():
        report = surroundings.reports.wait_for(of_route('short'))
    assert not report.optimal
    assert report.solver_status == 'Infeasible_Problem_Detected'
    assert 'target temperature' in report.infeasible_constraint
    # Neither can do more than heat all the way.
    assert report.plan_arrival_temperature == pytest.approx(
        report.optimal_arrival_temperature, abs=1e-3)


# When it checks

def test_checks_on_demand_and_not_by_itself_where_told_so(surroundings):
    surroundings.start('planner', *SWITCH)
    surroundings.start('nlp_checker', *ONLY_ASKED)
    response = surroundings.check()
    assert not response.success
    assert response.message == 'No valid route plan has arrived yet.'
    route = surroundings.send_route()
    with surroundings.feeding():
        surroundings.reports.wait_for()
        # The same again is no new route.
        surroundings._routes.publish(route)
        surroundings.plans.clear()
        surroundings.plans.wait_for_count(10)
        assert len(surroundings.reports.messages) == 1
        assert surroundings.check().success
        first, second = surroundings.reports.wait_for_count(2)
    assert nanoseconds(second.header.stamp) > nanoseconds(first.header.stamp)
    assert second.optimal


def test_refuses_a_demand_that_nothing_can_come_of(surroundings):
    surroundings.start('nlp_checker', *ONLY_ASKED)
    surroundings.send_route('ended', 30)
    surroundings.diagnosis(lambda level, text, values: values['route_id'] == 'ended')
    assert surroundings.check().message == 'No valid battery state has arrived yet.'
    surroundings._routes.publish(route_plan(surroundings.now_ns() - 60 * NS_PER_S, 'over', 30))
    surroundings.diagnosis(lambda level, text, values: values['route_id'] == 'over')
    with surroundings.feeding():
        response = surroundings.check()
        deadline_s = time.monotonic() + 5.0
        while 'battery state' in response.message and time.monotonic() < deadline_s:
            response = surroundings.check()
    assert not response.success
    assert response.message == 'The route has ended.'


def test_checks_by_itself_but_not_more_often_than_the_period(surroundings):
    period_s = 1.0
    surroundings.start('planner', *SWITCH)
    surroundings.start('nlp_checker', '-p', f'check_period:={period_s}')
    surroundings.send_route()
    with surroundings.feeding():
        reports = surroundings.reports.wait_for_count(4)
    # The first is as early as the first plan; a check is for a state of a moment before.
    stamps_s = [nanoseconds(report.header.stamp) / NS_PER_S for report in reports[1:]]
    for before_s, after_s in zip(stamps_s, stamps_s[1:]):
        assert after_s - before_s > period_s - 2 * FEEDING_PERIOD_S


def test_a_newer_route_cancels_the_check_under_way(surroundings, wait_until):
    surroundings.start('nlp_checker', *SLOW)
    surroundings.send_route('long', LONG_S)
    with surroundings.feeding():
        older = surroundings.solver_process_id()
        surroundings.send_route('near', 60)
        report = surroundings.reports.wait_for()
    assert report.route_id == 'near'
    assert is_gone(older)
    surroundings.diagnosis(lambda level, text, values: values['superseded'] == '1')


def test_a_forecast_for_the_same_route_does_not_cancel(surroundings):
    surroundings.start('nlp_checker', *ONLY_ASKED, '-p', 'planning_step:=2.0')
    surroundings.send_route('home', 1200)
    with surroundings.feeding():
        surroundings.solver_process_id()
        surroundings.send_route('home', 1200, ambient_temperature=[-9.0])
        first, second = surroundings.reports.wait_for_count(2)
    assert second.optimal_energy > first.optimal_energy + 10.0
    surroundings.diagnosis(lambda level, text, values: values['superseded'] == '0')


# What goes wrong

def test_gives_up_at_the_time_limit_and_checks_again(surroundings):
    surroundings.start('nlp_checker', *SLOW, '-p', 'time_limit:=0.7')
    surroundings.send_route('long', LONG_S)
    with surroundings.feeding():
        report = surroundings.reports.wait_for(of_route('long'))
        assert report.solver_status == 'no solution within the time limit of 0.7 s'
        assert 0.7 < report.solve_time < 0.7 + MARGIN_S
        assert not report.optimal
        assert isnan(report.optimal_energy)
        assert isnan(report.energy_gap)
        level, text, _ = surroundings.diagnosis(
            lambda level, text, values: values['failures'] == '1')
        assert level == DiagnosticStatus.WARN
        assert 'time limit' in text
        surroundings.send_route('near', 60)
        surroundings.reports.wait_for(
            lambda report: report.route_id == 'near' and not isnan(report.optimal_energy))
        surroundings.diagnosis(lambda level, text, values: level == DiagnosticStatus.OK)


def test_outlives_its_solver_and_says_so(surroundings, wait_until):
    checker = surroundings.start('nlp_checker', *SLOW)
    surroundings.send_route('long', LONG_S)
    with surroundings.feeding():
        psutil.Process(surroundings.solver_process_id()).kill()
        report = surroundings.reports.wait_for(of_route('long'))
        assert report.solver_status == 'the solver process ended with SIGKILL'
        assert not report.optimal
        level, text, _ = surroundings.diagnosis(
            lambda level, text, values: values['failures'] == '1')
        assert (level, text) == (DiagnosticStatus.WARN, 'the solver process ended with SIGKILL.')
        surroundings.send_route('near', 60)
        surroundings.reports.wait_for(of_route('near'))
    assert checker.exit_status is None


def test_bad_inputs_do_no_harm(surroundings):
    checker = surroundings.start('nlp_checker', *ONLY_ASKED)
    foreign_plans = surroundings.bench.publisher(PreheatPlan, 'preheat_plan', LATCHED)
    foreign_plans.wait_for_subscription(2)
    surroundings.send_route(speed=[20.0, 30.0])
    surroundings.diagnosis(lambda level, text, values: 'speed: has 2 values' in text)
    # A plan whose arrays do not fit, of a method that nobody knows.
    foreign_plans.publish(PreheatPlan(
        route_id='home', method='magic', time=[0.0, nan], target_battery_temperature=nan,
        heating_planned=True, battery_energy=1.0))
    surroundings.send_route()
    with surroundings.feeding():
        surroundings.send_state(temperature=nan)
        surroundings.send_state(stamp_ns=1)
        report = surroundings.reports.wait_for()
    assert report.optimal
    assert report.method == 'magic'
    assert isnan(report.plan_energy)
    assert checker.exit_status is None


def test_a_wrong_parameter_is_refused_and_a_right_one_takes_effect(surroundings):
    surroundings.start('nlp_checker', *ONLY_ASKED)

    def set_vehicle(name):
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=name)
        return surroundings.bench.call(
            SetParameters, '/nlp_checker/set_parameters', SetParameters.Request(
                parameters=[Parameter(name='vehicle', value=value)])).results[0]

    surroundings.send_route()
    with surroundings.feeding():
        before = surroundings.reports.wait_for()
        refused = set_vehicle('small_cat')
        assert not refused.successful
        assert "did you mean 'small_car'" in refused.reason
        surroundings.reports.clear()
        assert set_vehicle('small_car').successful
        after = surroundings.reports.wait_for()
    # Another battery takes another energy to be warmed.
    assert abs(after.optimal_energy - before.optimal_energy) > 100.0


def test_cannot_start_with_an_unknown_vehicle(bench):
    checker = bench.start('nlp_checker', '-p', 'vehicle:=small_cat')
    assert checker.wait(20.0) == 2
    assert "did you mean 'small_car'" in checker.output()


# Beside others

def test_planner_goes_on_while_the_checker_solves_hangs_and_dies(surroundings, wait_until):
    surroundings.start('planner', *SWITCH, *QUICK_COMMANDS)
    checker = surroundings.start('nlp_checker', *SLOW)
    # Too cold to be ever warm: it heats from the start.
    surroundings.send_route('long', LONG_S, target_battery_temperature=55.0)
    with surroundings.feeding():
        solver = surroundings.solver_process_id()
        surroundings.commands.wait_for(lambda command: command.battery_heating_power > 0.0)
        surroundings.expect_commands(30)
        assert psutil.Process(solver).nice() == 19
        assert psutil.Process(solver).cpu_times().user > 0.5
        checker.send_signal(signal.SIGSTOP)
        surroundings.expect_commands(20)
        checker.send_signal(signal.SIGKILL)
        assert checker.wait() == -signal.SIGKILL
        surroundings.expect_commands(20)
    wait_until(lambda: is_gone(solver), 'the end of the solver without its node')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_ends_cleanly_while_it_solves(surroundings, number):
    checker = surroundings.start('nlp_checker', *SLOW)
    surroundings.send_route('long', LONG_S)
    with surroundings.feeding():
        solver = surroundings.solver_process_id()
    children = psutil.Process(checker.process_id).children(recursive=True)
    assert [child.pid for child in children] == [solver]
    checker.send_signal(number)
    assert checker.wait() == 0
    assert not psutil.pid_exists(solver)
    assert 'Traceback' not in checker.output()


def test_follows_simulated_time(surroundings):
    surroundings.start('nlp_checker', *ONLY_ASKED, '-p', 'use_sim_time:=true')
    clocks = surroundings.bench.publisher(Clock, '/clock')
    clocks.wait_for_subscription()
    now_ns = 1000 * NS_PER_S
    surroundings._routes.publish(route_plan(now_ns))

    def report():
        clocks.publish(Clock(clock=time_message(now_ns)))
        surroundings.send_state(stamp_ns=now_ns - 1)
        return surroundings.reports.messages

    deadline_s = time.monotonic() + 20.0
    while not report():
        assert time.monotonic() < deadline_s
        time.sleep(FEEDING_PERIOD_S)
    assert nanoseconds(surroundings.reports.messages[0].header.stamp) == now_ns
    assert surroundings.reports.messages[0].optimal


def test_node_process_loads_no_solver():
    done = subprocess.run(
        [sys.executable, '-c', 'import sys, bev_preheat.nodes.nlp_checker_node\n'
         "print([name for name in ('casadi', 'scipy', 'matplotlib') if name in sys.modules])"],
        capture_output=True, text=True, check=True)
    assert done.stdout.strip() == '[]'
