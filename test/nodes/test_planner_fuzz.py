# SPDX-License-Identifier: Apache-2.0
"""
A hundred thousand random and malformed messages, seeded, given to the callbacks of a real PlannerNode.

After each message an oracle checks the last command against docs/explanation/safety.md. The oracle knows
which messages are valid, because each is built as valid, or as valid except for one field. It records the
accepted inputs itself and does not query the planner.
"""

from array import array
from dataclasses import dataclass, replace
from math import inf, isfinite, nan
import random

from planner_car import PlannerCar, stamped
import pytest
from sensor_msgs.msg import BatteryState

from bev_preheat.messages.fields import nanoseconds
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import RoutePlan

SEED = 20261121
MESSAGES = 100_000
START_NS = 1_700_000_000 * NS_PER_S
# The planner's defaults, and the reference vehicle's heater.
TIMEOUT_S, TOLERANCE_S, LEASE_S, HVCH_W = 5.0, 1.0, 2.5, 7000.0
# A state holds at least this long after its arrival [s]; states of one battery differ by less [K].
HELD_S, SAME_BATTERY_K = 2.0, 4.0
# A clock that jumps back further was reset: earlier measurements are meaningless.
RESTART_S = 1.0
# On the way a route plan that begins this far ahead has begun (docs/explanation/safety.md).
AHEAD_S = 60.0
# A state that is older than the latest by no more than this is dropped.
OVERTAKEN_S = 1.0
NEVER = -10**30

BAD_STATES = [('temperature', value) for value in (nan, inf, -inf, 280.15, -60.0, 61.0, 1e30, -1e-3
                                                   - 40.0)]
BAD_STATES += [('percentage', value) for value in (nan, inf, -inf, -0.01, 1.01, 80.0, 3e38)]
BAD_VALUES = {
    'segment_duration': (0.0, -30.0, nan, inf, 1e5, 5e-324),
    'speed': (-1.0, nan, inf, 101.0, 1e300),
    'propulsion_power': (nan, inf, -inf, 3e6, -3e6),
    'ambient_temperature': (nan, inf, 263.15, -61.0),
    'cabin_heating_power': (nan, -1.0, 6e4, inf),
    'auxiliary_power': (nan, -1.0, 6e4),
}
BAD_SCALARS = [('minimum_arrival_soc', value) for value in (nan, -0.1, 1.1, 20.0)] + [
    ('target_battery_temperature', value) for value in (inf, -inf, 298.15, -90.0)] + [
    ('charger_power', value) for value in (-50e3, 150.0, inf, 5e-324)] + [
    ('charging_departure_soc', value) for value in (80.0, -0.1, inf)]
BAD_PARAMETERS = [('command_period', 0.0), ('command_lease', nan), ('planning_step', -1.0),
                  ('vehicle', 'no_such_car'), ('vehicle', '/dev/null/x.yaml'), ('method', 'magic'),
                  ('battery_state_timeout', 1e9), ('command_lease', 0.5), ('estimation', 3),
                  ('minimum_on_time', -1.0), ('command_period', 'soon')]


@dataclass(frozen=True)
class Book:
    """The state of the oracle: the last accepted inputs, and the refusals since."""

    now_ns: int = START_NS
    latest_ns: int = START_NS
    enabled: bool = True
    state_ns: int = NEVER
    state_c: float = 0.0
    arrived_ns: int = NEVER
    # Start [ns], duration of a segment [s], cabin power in each [W], route_id; (): none.
    route: tuple = ()
    # From when its trip counts [ns]: on the way from now on, if it starts within a minute.
    begins_ns: int = NEVER
    # The latest valid route has begun, and was not cancelled.
    has_begun_ns: int = -NEVER
    is_state_refused: bool = False
    is_route_refused: bool = False
    # The latest route was refused, and no valid one has arrived since.
    is_update_due: bool = False


class Fuzz:
    """The node, its surroundings, and the oracle."""

    def __init__(self, planner, seed):
        self.random = random.Random(seed)
        self._planner = planner
        self.book = Book()
        self.commands = planner.commands
        self.temperature_c = -7.0
        self.heated = self.heated_after_refused_update = 0

    @property
    def book(self):
        """The state of the oracle; its time is the planner's."""
        return self._book

    @book.setter
    def book(self, book):
        self._book = book
        self._planner.at(book.now_ns)

    # Inputs

    def give_state(self):
        good = self.random.random() < 0.25
        fields = {'temperature': self.temperature_c, 'percentage': 0.8,
                  'voltage': self.random.choice((400.0, nan, 0.0, -5.0, inf)),
                  'current': self.random.choice((-50.0, nan, 0.0, 1e9, 30.0))}
        age_s, kind = self.random.uniform(-0.9, 3.0), self.random.random()
        if good:
            self.temperature_c += self.random.choice((0.0, 0.01, -0.01, 0.02))
            self.temperature_c = min(max(self.temperature_c, -20.0), 20.0)
            if self.random.random() < 0.02:
                self.temperature_c = self.random.uniform(-20.0, 20.0)
            fields['temperature'] = self.temperature_c
        elif kind < 0.7:
            fields.update([self.random.choice(BAD_STATES)])
        else:
            age_s = self.random.choice((TIMEOUT_S + 0.1, 1e4, -TOLERANCE_S - 0.1, -1e5, None))
        message = BatteryState(**fields)
        stamp_ns = 0
        if age_s is not None:
            stamp_ns = max(self.book.now_ns - round(age_s * NS_PER_S), 0)
            stamped(message, stamp_ns)
            if not good and self.random.random() < 0.1:
                message.header.stamp.nanosec = self.random.choice((10**9, 4 * 10**9))
        self._planner.give(message)
        self._note_state(stamp_ns, good)

    def give_calm(self):
        """Give valid states until heat no longer waits after doubt, or nearly."""
        for _ in range(self.random.randint(5, 60)):
            self.book = replace(self.book, now_ns=self.book.now_ns + NS_PER_S)
            self._planner.send_state(temperature=self.temperature_c)
            self._note_state(self.book.now_ns, True)
            self.check()

    def _note_state(self, stamp_ns, good):
        self._note_clock()
        book = self.book
        late_ns = book.state_ns - stamp_ns
        is_same = abs(self.temperature_c - book.state_c) <= SAME_BATTERY_K
        may_be_overtaken = late_ns <= OVERTAKEN_S * NS_PER_S or is_same
        if good and 0 < late_ns and may_be_overtaken and stamp_ns <= book.now_ns:
            # A later one has overtaken it: dropped silently.
            return
        if good and late_ns <= 0:
            # Whether the refused route ended the previous one shows in the planner's current route.
            self.book = replace(book, state_ns=stamp_ns, state_c=self.temperature_c, arrived_ns=book.now_ns,
                                is_state_refused=False,
                                is_route_refused=False)
        else:
            self.book = replace(book, is_state_refused=True)

    def give_route(self):
        good = self.random.random() < 0.75
        count = self.random.choice((1, 3, 12, 20, 40))
        cabin_w = [self.random.uniform(0.0, 6500.0) for _ in range(count)]
        duration_s = self.random.choice((5.0, 30.0, 60.0))
        columns = {
            'segment_duration': [duration_s] * count,
            'speed': [self.random.uniform(0.0, 40.0)],
            'propulsion_power': [self.random.uniform(-40e3, 60e3) for _ in range(count)],
            'ambient_temperature': [self.random.uniform(-30.0, 20.0)],
            'cabin_heating_power': cabin_w,
            'auxiliary_power': [300.0] if self.random.random() < 0.5 else []}
        scalars = {'minimum_arrival_soc': self.random.choice((0.0, 0.1, 0.9)),
                   'target_battery_temperature': self.random.choice((25.0, nan, 10.0, 40.0)),
                   'charging_planned': self.random.random() < 0.9,
                   'charger_power': self.random.choice((0.0, nan, 0.0, 1000.0, 50e3, 150e3)),
                   'charging_departure_soc': self.random.choice((0.0, nan, 0.01, 0.7, 1.0))}
        start_ns = self.book.now_ns - round(self.random.uniform(-20.0, 100.0) * NS_PER_S)
        if not good:
            if self.book.route and self.random.random() < 0.8:
                start_ns = self.book.route[0] + round(self.random.uniform(0.0, 2.0) * NS_PER_S)
            self._spoil(columns, scalars)
        route_id = self.random.choice(('', *['home'] * 17, 'work', 'x' * 300))
        if good:
            route_id = route_id[:6]
        message = RoutePlan(route_id=route_id, **scalars, **{
            name: array('d', values) for name, values in columns.items()})
        if good or self.random.random() < 0.9:
            start_ns = max(start_ns, 1)
            stamped(message, start_ns)
        self._planner.give(message)
        now_ns, is_under_way = self.book.now_ns, self.book.has_begun_ns <= self.book.now_ns
        if good and self._is_over(start_ns + duration_s * count * NS_PER_S, route_id):
            # Over when it arrived: it changes nothing.
            return
        if good:
            # A trip may be under way: it has begun, and a vehicle that stands is late.
            begins_ns = now_ns if is_under_way and 0 < start_ns - now_ns <= AHEAD_S * NS_PER_S else start_ns
            self.book = replace(self.book, is_route_refused=False, is_update_due=False, begins_ns=begins_ns,
                                has_begun_ns=begins_ns, route=(start_ns, duration_s, tuple(cabin_w), route_id))
        else:
            self.book = replace(
                self.book, is_route_refused=True, is_update_due=True,
                route=self.book.route if self._is_update(message) else ())

    def _is_over(self, end_ns, route_id):
        """Return whether a route that ends at an instant [ns] is over already, during a trip that is not."""
        if not self.book.route:
            return False
        _, duration_s, cabin_w, own_id = self.book.route
        # An update that has just ended is the arrival.
        over_ns = end_ns + (AHEAD_S * NS_PER_S if route_id == own_id else 0)
        own_end_ns = self.book.begins_ns + duration_s * len(cabin_w) * NS_PER_S
        return over_ns <= self.book.now_ns < own_end_ns

    def _is_update(self, message):
        """Return whether the previous trip may continue after a refused route (docs/explanation/safety.md)."""
        if not self.book.route or not message.charging_planned or not message.route_id:
            return False
        _, duration_s, cabin_w, route_id = self.book.route
        durations_s = list(message.segment_duration)
        if message.route_id != route_id or not all(0.0 < one < 1e5 for one in durations_s):
            return False
        # In valid routes, nearly all arrays have the same length, or length 1.
        end_ns = nanoseconds(message.header.stamp) + sum(durations_s) * NS_PER_S
        return end_ns >= self.book.begins_ns + duration_s * len(cabin_w) * NS_PER_S - 1e6

    def give_cancellation(self):
        self._planner.give(RoutePlan(
            route_id=self.random.choice(('', 'home')), minimum_arrival_soc=nan))
        self.book = replace(self.book, is_route_refused=False, route=(), has_begun_ns=-NEVER)

    def _spoil(self, columns, scalars):
        kind = self.random.random()
        if kind < 0.5:
            name = self.random.choice(list(BAD_VALUES))
            values = list(columns[name]) or [0.0]
            values[self.random.randrange(len(values))] = self.random.choice(BAD_VALUES[name])
            columns[name] = values
        elif kind < 0.65:
            scalars.update([self.random.choice(BAD_SCALARS)])
            scalars['charging_planned'] = True
        elif kind < 0.8:
            # Without powers, the road load of the vehicle gives them.
            columns[self.random.choice(('segment_duration', 'speed', 'ambient_temperature'))] = []
        elif kind < 0.995:
            columns['speed'] = [10.0] * (len(columns['segment_duration']) + 1)
            columns['propulsion_power'] = [10.0] * (len(columns['segment_duration']) + 2)
        else:
            columns['segment_duration'] = [30.0] * 250_000

    def give_time(self):
        """Let time pass, or jump, and let the timer fire."""
        kind = self.random.random()
        step_s = (self.random.uniform(0.0, 1.2) if kind < 0.9 else
                  self.random.uniform(0.0, 200.0) if kind < 0.97 else
                  self.random.uniform(-30.0, 0.0))
        self.book = replace(self.book, now_ns=self.book.now_ns + round(step_s * NS_PER_S))
        self._note_clock()
        self._planner.repeat()

    def give_no_clock(self):
        """Let the clock read 0, as simulated time does before it has begun."""
        book = self.book
        self.book = replace(book, now_ns=0)
        self._planner.give(BatteryState(temperature=-7.0, percentage=0.8))
        assert self.commands.latest.battery_heating_power == 0.0
        # The clock fell back.
        self.book = replace(book, latest_ns=book.now_ns, state_ns=NEVER, is_state_refused=True)

    def give_enable(self):
        on = self.random.random() < 0.8
        self._planner.enable(on)
        self.book = replace(self.book, enabled=on)

    def give_parameters(self):
        name, value = self.random.choice(BAD_PARAMETERS)
        result = self._planner.set(**{name: value})
        assert not result.successful and result.reason, (name, value)

    def _note_clock(self):
        book = self.book
        if book.now_ns < book.latest_ns - RESTART_S * NS_PER_S:
            book = replace(book, state_ns=NEVER)
        self.book = replace(book, latest_ns=book.now_ns)

    # Invariants

    def check(self):
        book, command = self.book, self.commands.latest
        power_w, until_ns = command.battery_heating_power, nanoseconds(command.valid_until)
        assert command.reason != Status.INTERNAL_ERROR, self._planner.process.output()[-1000:]
        assert isfinite(power_w) and power_w >= 0.0
        if power_w == 0.0:
            return
        self.heated += 1
        self.heated_after_refused_update += book.is_update_due
        assert book.enabled and book.route, book
        assert not (book.is_state_refused or book.is_route_refused), book
        age_s = (book.now_ns - book.state_ns) / NS_PER_S
        expires_ns = max(book.state_ns + round(TIMEOUT_S * NS_PER_S), book.arrived_ns + round(HELD_S * NS_PER_S))
        assert -TOLERANCE_S <= age_s and book.now_ns < expires_ns, age_s
        start_ns, duration_s, cabin_w, _ = book.route
        on_the_way_s = (book.now_ns - start_ns) / NS_PER_S
        begun_s = (book.now_ns - book.begins_ns) / NS_PER_S
        assert begun_s >= 0.0 and on_the_way_s < duration_s * len(cabin_w)
        # Planned in steps of 30 s or of the route's own, longer steps: a step has the mean.
        step_s = max(30.0, duration_s)
        least_w = min(cabin_w[int(max(on_the_way_s - step_s, 0.0) // duration_s):
                              int((begun_s + step_s) // duration_s) + 1])
        assert power_w <= HVCH_W - least_w + 1e-6
        assert until_ns <= book.now_ns + round(LEASE_S * NS_PER_S)
        assert until_ns <= expires_ns


@pytest.fixture
def fuzz(rehearsal):
    planner = PlannerCar(rehearsal, commands_alone=True)
    planner.at(START_NS)
    planner.start()
    return Fuzz(planner, SEED)


@pytest.mark.costly
@pytest.mark.timeout(900)
@pytest.mark.parametrize('messages', [1000, pytest.param(MESSAGES, marks=pytest.mark.deep)])
def test_no_message_ends_the_process_or_leaves_heat_on(fuzz, messages):
    kinds = ((fuzz.give_state, 70), (fuzz.give_calm, 2), (fuzz.give_time, 17), (fuzz.give_route, 11),
             (fuzz.give_cancellation, 0.3), (fuzz.give_enable, 1), (fuzz.give_parameters, 0.5),
             (fuzz.give_no_clock, 0.2))
    gives, weights = zip(*kinds)
    # The default examples are the first of the deep test's.
    for give in fuzz.random.choices(gives, weights, k=MESSAGES)[:messages]:
        fuzz.commands.clear()
        give()
        fuzz.check()
        # Every input except a refused parameter is answered by a command.
        assert fuzz.commands.messages or give == fuzz.give_parameters
    # The oracle was exercised: the heater was often on in between.
    assert fuzz.heated > messages // 50
    # A few times in 10 000 messages; test/control/test_refused_routes.py has it daily.
    assert messages < MESSAGES or fuzz.heated_after_refused_update > messages // 5000
