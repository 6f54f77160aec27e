# SPDX-License-Identifier: Apache-2.0
"""`nlp_checker` in this process: its reports, with a real solver process, ten times as fast as real time."""

from array import array
from itertools import count
from math import isnan, nan

from builtin_interfaces.msg import Time
import planner_car
from planner_car import LATCHED, PlannerCar, route_at, values_of
import psutil
import pytest
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from bev_preheat.messages.fields import nanoseconds, time_message
from bev_preheat.messages.route_plan import mission_from_message
from bev_preheat.nonlinear_program.solve import solve_optimum
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState as State
from bev_preheat.planning.situation import Goal
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import OptimalityReport, PreheatPlan, RoutePlan

FEEDING_PERIOD_S = 0.5
# Exact in the float32 of the message.
TEMPERATURE_C, SOC, TARGET_C = 2.25, 0.8125, 15.0
RESERVE_SOC = 0.15
# In the processes states come in real time; on a busy computer with long pauses.
PATIENT = ('-p', 'battery_state_timeout:=60.0')
# A solver with the lowest priority gets no processor time for minutes on a busy computer.
SHARING = (*PATIENT, '-p', 'solver_niceness:=0', '-p', 'time_limit:=300.0')
# No check by itself.
ONLY_ASKED = (*SHARING, '-p', 'check_period:=0.0')
REPORT_PATIENCE_S = 2400.0
REAL_S_PER_S = 0.1
NUMBERS = count()
# Maximum number of checks requested until the planner's plan arrives in time.
MOST_CHECKS = 5


def state_at(stamp_ns, **fields):
    return planner_car.state_at(stamp_ns, **{'temperature': TEMPERATURE_C, 'percentage': SOC, **fields})


def route_plan(stamp_ns, route_id='home', duration_s=2400, **fields):
    """Return a RoutePlan whose target is within reach after 40 min."""
    return route_at(stamp_ns, **{
        'route_id': route_id, 'segment_duration': array('d', [30.0] * (duration_s // 30)),
        'propulsion_power': [14e3], 'propulsion_power_rms': [17e3], 'ambient_temperature': [-4.0],
        'cabin_heating_power': [1600.0], 'target_battery_temperature': TARGET_C,
        'minimum_arrival_soc': RESERVE_SOC, **fields})


class Surroundings(PlannerCar):
    """A car with a checker, with or without a planner; battery states come in a block of `feeding`."""

    def __init__(self, bench, namespace=''):
        super().__init__(bench, namespace)
        self.namespace, self.started = namespace, []
        self.reports = bench.record(OptimalityReport, f'{namespace}/optimality_report', LATCHED)

    def run(self, name, *arguments):
        self.started.append(self.bench.start(name, '-r', f'__ns:={self.namespace or "/"}', *arguments))
        return self.started[-1]

    def state(self, age_s=0.0, **fields):
        return state_at(self.now_ns, **fields)

    def feeding(self, make_state=None, period_s=FEEDING_PERIOD_S):
        return super().feeding(make_state, period_s)

    def send_route(self, *arguments, age_s=0, **fields):
        """Publish a route that started some time ago, and return it."""
        message = route_plan(self.now_ns - age_s * NS_PER_S, *arguments, **fields)
        self.give(message)
        return message

    def report(self, condition=lambda report: True):
        """Return the first report for which condition(report), already received or later."""
        return self.reports.wait_for(condition, timeout_s=REPORT_PATIENCE_S)

    def report_on_plan(self, route_id):
        """Return a report on the planner's own plan; until that is in time, the checker plans without caution."""
        for _ in range(MOST_CHECKS):
            report = self.report(of_route(route_id))
            if not isnan(report.caution_energy):
                return report
            self.reports.clear()
            assert self.check().success
        raise AssertionError(f'{route_id}: no report on the plan in {MOST_CHECKS} checks')

    def check(self):
        return self.bench.call(Trigger, f'{self.namespace}/nlp_checker/check', Trigger.Request())

    def diagnosis(self, condition=lambda values: True):
        """Return the figures of the checker's next diagnostics for which condition(figures)."""
        self.diagnostics.clear()
        return values_of(self.entry('optimality check', lambda entry: condition(values_of(entry)), 'nlp_checker'))

    def count(self, name):
        return int(self.diagnosis()[name])


@pytest.fixture(scope='module')
def graph(module_rehearsal):
    """Return the Rehearsal of all tests in this process."""
    module_rehearsal.real_s_per_s = REAL_S_PER_S
    return module_rehearsal


@pytest.fixture
def own(graph):
    """Start without nodes, in this process; those of the test end with it."""
    # Another namespace each time: an earlier route is latched.
    surroundings = Surroundings(graph, f'/own_{next(NUMBERS)}')
    yield surroundings
    for process in surroundings.started:
        process.kill()


@pytest.fixture(scope='module')
def both(graph):
    surroundings = Surroundings(graph)
    surroundings.run('planner', *PATIENT)
    surroundings.run('nlp_checker', *ONLY_ASKED)
    return surroundings


@pytest.fixture(scope='module')
def alone(graph):
    """A checker without a planner, which tests share; it must keep running."""
    surroundings = Surroundings(graph, '/alone')
    checker = surroundings.run('nlp_checker', *ONLY_ASKED)
    yield surroundings
    assert checker.exit_status is None


def of_route(route_id):
    return lambda report: report.route_id == route_id


# Reports

def test_refuses_a_demand_that_nothing_can_come_of(own):
    own.run('nlp_checker', *ONLY_ASKED)
    response = own.check()
    assert not response.success
    assert response.message == 'No valid route plan has arrived yet.'
    own.send_route('over', 30, age_s=60)
    own.bench.wait_until(lambda: own.check().message == 'No valid battery state has arrived yet.',
                         'a refusal for want of a battery state')
    with own.feeding():
        own.bench.wait_until(lambda: own.check().message == 'The route has ended.',
                             'a refusal because the route has ended')
    assert not own.check().success


def test_reports_for_a_new_route_that_its_plan_is_the_optimum(both):
    both.send_route('home')
    with both.feeding():
        report = both.report_on_plan('home')
    assert report.optimal
    assert report.solver_status == 'Solve_Succeeded'
    assert report.infeasible_constraint == ''
    assert report.method == 'value_function'
    assert report.plan_arrival_temperature == pytest.approx(TARGET_C, abs=1e-3)
    assert report.optimal_arrival_temperature == pytest.approx(TARGET_C, abs=1e-3)
    assert abs(report.energy_gap) < 0.05
    assert report.energy_gap == report.plan_energy - report.optimal_energy
    # 40 min with 14 kW and more.
    assert 9000.0 < report.plan_energy < 16000.0
    assert report.plan_heating and report.optimal_heating
    starts_ns = nanoseconds(report.plan_heating_start), nanoseconds(report.optimal_heating_start)
    assert abs(starts_ns[0] - starts_ns[1]) < 5 * NS_PER_S
    # The planner's own plan for that instant starts earlier, and reports the cost of the lead.
    # A state may be planned from twice: on its arrival, and on the route's.
    plan = both.plans.wait_for(
        lambda plan: plan.header.stamp == report.header.stamp
        and plan.battery_energy - report.plan_energy == pytest.approx(report.caution_energy))
    assert nanoseconds(plan.heating_start) < starts_ns[0] - 10 * NS_PER_S
    assert 0.0 < report.caution_energy < 0.01 * report.plan_energy


def test_the_gap_of_another_method_is_that_of_the_same_situation(own):
    # Without estimation, plans start from the measured values of any of the states.
    own.run('planner', *PATIENT, '-p', 'method:=paper', '-p', 'estimation:=false')
    own.run('nlp_checker', *ONLY_ASKED)
    sent = own.send_route('by paper')
    # Route first, battery later, as when a car wakes up: the solver's process runs before the first check.
    ready = own.diagnosis(lambda values: values['state'] == 'idle')['solver process']
    with own.feeding():
        report = own.report(of_route('by paper'))
        assert own.diagnosis(lambda values: int(values['reports']) >= 1)['solver process'] == ready
    vehicle = load_vehicle('reference')
    leg, = mission_from_message(sent, vehicle.defaults, 30.0).legs
    route = leg.route_ahead(nanoseconds(report.header.stamp))
    situation = vehicle, route, State(TEMPERATURE_C, SOC), Goal(TARGET_C, RESERVE_SOC)
    planned, optimum = plan_preheating(*situation, 'paper'), solve_optimum(*situation).plan
    gap_wh = planned.energy_wh.battery_total - optimum.energy_wh.battery_total
    assert abs(gap_wh) > 1.0
    assert report.method == 'paper'
    assert report.energy_gap == pytest.approx(gap_wh, abs=1e-3)
    assert report.plan_arrival_temperature == pytest.approx(planned.arrival_temperature_c)
    assert report.optimal_arrival_temperature == pytest.approx(
        optimum.arrival_temperature_c, abs=1e-5)


def test_without_a_planner_the_optimum_stands_alone(alone):
    alone.send_route('near', 60, target_battery_temperature=2.5)
    with alone.feeding():
        report = alone.report(of_route('near'))
    assert report.optimal
    assert report.optimal_arrival_temperature == pytest.approx(2.5, abs=1e-3)
    assert report.method == ''
    assert isnan(report.plan_energy)
    assert isnan(report.energy_gap)
    assert isnan(report.plan_arrival_temperature)
    assert not report.plan_heating
    assert report.plan_heating_start == Time()


# When it checks

def test_checks_on_demand_and_not_by_itself_where_told_so(both):
    route = both.send_route('asked')
    with both.feeding():
        first = both.report(of_route('asked'))
        # A repeated route is not a new route.
        both.give(route)
        both.plans.clear()
        both.plans.wait_for_count(10)
        assert [report.route_id for report in both.reports.messages].count('asked') == 1
        assert both.check().success
        second = both.report(
            lambda report: report.route_id == 'asked' and report.header != first.header)
    assert nanoseconds(second.header.stamp) > nanoseconds(first.header.stamp)
    assert second.optimal


def test_a_cancelled_trip_leaves_nothing_to_check(alone):
    alone.send_route('called off')
    alone.bench.wait_until(lambda: alone.check().message != 'The trip was cancelled.', 'a route')
    alone.give(RoutePlan())
    with alone.feeding():
        alone.bench.wait_until(lambda: alone.check().message == 'The trip was cancelled.', 'the cancellation')
        assert not alone.check().success
        alone.send_route('called on again')
        alone.report(of_route('called on again'))


@pytest.mark.deep
def test_checks_by_itself_but_not_more_often_than_the_period_in_simulated_time(own):
    own.run('nlp_checker', *SHARING, '-p', 'use_sim_time:=true', '-p', 'check_period:=10.0')
    clocks = own.bench.publisher(Clock, '/clock')
    clocks.wait_for_subscription()
    start_ns = now_ns = 1000 * NS_PER_S
    own.give(route_plan(start_ns, 'simulated'))

    def state():
        clocks.publish(Clock(clock=time_message(now_ns)))
        return state_at(now_ns - 1)

    with own.feeding(state):
        first = own.report()
        now_ns = start_ns + round(9.9 * NS_PER_S)
        # A check that begins now is not for the earlier report.
        for _ in range(3):
            own.diagnosis(lambda values: values['state'] == 'idle')
        now_ns = start_ns + round(10.1 * NS_PER_S)
        second = own.report(lambda report: report.header != first.header)
    # The route starts an instant after the battery's state.
    assert nanoseconds(first.header.stamp) == start_ns
    assert nanoseconds(second.header.stamp) == now_ns - 1
    assert first.optimal and second.optimal


def test_a_forecast_for_the_same_route_does_not_cancel(both):
    superseded = both.count('superseded')
    with both.feeding():
        both.send_route('before', 60)
        both.report(of_route('before'))
        # It hangs before it gets to check the route.
        solver = psutil.Process(both.count('solver process'))
        solver.suspend()
        try:
            both.send_route('forecast')
            both.diagnosis(lambda values: (values['state'], values['checked route_id']) == ('solving', 'forecast'))
            both.send_route('forecast', target_battery_temperature=12.0)
            # A check could begin with each of these plans.
            both.plans.wait_for(lambda plan: plan.target_battery_temperature == 12.0)
            both.plans.clear()
            both.plans.wait_for_count(5)
        finally:
            solver.resume()
        first = both.report(of_route('forecast'))
        second = both.report(
            lambda report: report.route_id == 'forecast' and report.header != first.header)
    assert first.optimal_arrival_temperature == pytest.approx(TARGET_C, abs=1e-3)
    assert second.optimal_arrival_temperature == pytest.approx(12.0, abs=1e-3)
    assert both.count('superseded') == superseded


def test_compares_what_the_planner_says_where_its_situation_is_known(alone):
    plans = alone.bench.publisher(PreheatPlan, '/alone/preheat_plan', LATCHED)
    plans.wait_for_subscription(2)
    stamp_ns = alone.bench.now_ns
    route = route_plan(stamp_ns, 'told', 90, target_battery_temperature=2.6)
    plan = PreheatPlan(
        route_id='told', method='oracle', time=[0.0, 30.0, 60.0, 90.0],
        battery_temperature=[TEMPERATURE_C] * 4, soc=[SOC] * 4,
        target_battery_temperature=2.6, battery_energy=12345.0,
        predicted_arrival_temperature=3.75, heating_planned=True,
        heating_start=time_message(stamp_ns + 7))
    plan.header.stamp = time_message(stamp_ns)
    alone.give(state_at(stamp_ns))
    alone.give(route)
    plans.publish(plan)
    report = alone.report(of_route('told'))
    assert nanoseconds(report.header.stamp) == stamp_ns
    assert report.method == 'oracle'
    assert report.plan_energy == 12345.0
    assert report.energy_gap == 12345.0 - report.optimal_energy
    assert report.plan_arrival_temperature == 3.75
    assert nanoseconds(report.plan_heating_start) == stamp_ns + 7
    assert report.optimal_arrival_temperature == pytest.approx(2.6, abs=1e-3)


# Faults


def test_bad_inputs_do_no_harm(alone):
    foreign_plans = alone.bench.publisher(PreheatPlan, '/alone/preheat_plan', LATCHED)
    foreign_plans.wait_for_subscription(2)
    alone.send_route('bent', speed=[20.0, 30.0])
    alone.entry('optimality check', lambda entry: 'speed: has 2 values' in entry.message, 'nlp_checker')
    # A plan whose arrays do not fit, by an unknown method.
    foreign_plans.publish(PreheatPlan(
        route_id='straight', method='magic', time=[0.0, nan], target_battery_temperature=nan,
        heating_planned=True, battery_energy=1.0))
    alone.send_route('straight', 60)
    with alone.feeding():
        alone.send_state(temperature=nan)
        alone.give(state_at(1))
        report = alone.report(of_route('straight'))
    assert not isnan(report.optimal_energy)
    assert report.method == 'magic'
    assert isnan(report.plan_energy)
