# SPDX-License-Identifier: Apache-2.0
"""
Days of a car, drawn: it stands, drives routes, detours, loses its position, arrives, charges and drives home.

The world is a few lines of arithmetic: a car at a distance along a route of constant planned speed, and a battery
that supplies drive, consumers and heater. It shares no code with the planner's timetable, and knows when the car
has truly arrived.
"""

from hypothesis import strategies as st

from bev_preheat.control.events import BatteryStateArrived, ProgressArrived, RouteArrived
from bev_preheat.control.inputs import Leg, Measurement, Mission, Progress
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
BEGIN_S = 1_700_000_000
STEP_S = 5
SPEED_MPS, DRIVE_W, CONSUMERS_W, PARKED_W, CHARGER_W = 20.0, 15e3, 2478.0, 250.0, 60e3
AMBIENT_C, TARGET_C = -7.0, 40.0
# A fix is wrong by at most ERROR_M; a place on the route is known to PLACE_M, and may be corrected by CORRECTED_M.
ERROR_M, PLACE_M, CORRECTED_M = 30.0, 10.0, 100.0
# A battery state is too old after this time; positions, too.
SETTINGS = Settings(estimation=False, battery_state_timeout_s=12.0, minimum_on_time_s=0.0, minimum_off_time_s=0.0)

# A route plan that begins now or later, or began less than a minute ago, begins a trip.
JUST_BEGUN_NS = 60 * NS_PER_S

SHORT, LONG = st.integers(1, 12), st.integers(12, 60)  # Steps: up to 1 min, up to 5 min.
MINUTES = st.integers(3, 9)
PACES = st.sampled_from((0.5, 0.8, 1.0, 1.25))
SHARES = st.floats(0.1, 0.9)

# Pieces of a trip: ('drive', share of the rest, pace, whether it reports positions), ('stand', steps, whether it
# reports positions), ('charge', steps), ('detour', minutes), ('asleep', seconds without any message), ('again',)
# and ('replan',): the navigation sends its route again, or a new one for the rest.
PIECES = st.one_of(
    st.tuples(st.just('drive'), SHARES, PACES, st.booleans()),
    st.tuples(st.just('stand'), st.one_of(SHORT, LONG), st.booleans()),
    st.tuples(st.just('charge'), LONG), st.tuples(st.just('detour'), MINUTES),
    st.tuples(st.just('asleep'), st.integers(4, 2000)), st.tuples(st.just('again')), st.tuples(st.just('replan')))
# After arrival also: ('search', offset [m]), positions near the end; ('home', steps, whether the navigation still
# reports positions, which fall); ('clock', seconds by which it is set); ('restart',) of the planner.
AFTERWARDS = st.one_of(
    st.tuples(st.just('stand'), st.one_of(SHORT, LONG), st.booleans()),
    st.tuples(st.just('charge'), LONG), st.tuples(st.just('search'), st.floats(-90.0, 40.0)),
    st.tuples(st.just('home'), LONG, st.booleans()), st.tuples(st.just('asleep'), st.integers(4, 6000)),
    st.tuples(st.just('clock'), st.integers(-900, 900)), st.tuples(st.just('restart')),
    st.tuples(st.just('again')), st.tuples(st.just('park'), LONG))
TRIPS = st.tuples(
    st.one_of(st.none(), SHORT, LONG), MINUTES, st.lists(PIECES, max_size=3),
    # The last piece: it arrives, with positions or without, and there is charged or not.
    st.tuples(PACES, st.booleans()), st.one_of(st.none(), st.just(48), LONG), st.lists(AFTERWARDS, max_size=4),
    st.sampled_from(('home', '')))
DAYS = st.lists(TRIPS, min_size=1, max_size=2)


class World:
    """A car and its planner; `violations` are sentences, `heated_on_the_way_s` [s] is before the end was known."""

    def __init__(self):
        self.planner = Supervisor(VEHICLE, SETTINGS)
        self.now_s, self.offset_s = BEGIN_S, 0
        self.temperature_c, self.soc, self.command_w = 0.0, 0.8, 0.0
        self.route, self.here_m, self.fixed_m = None, 0.0, None
        self.trips, self.violations, self.heated_on_the_way_s = 0, [], 0
        # The trip is known to be over; the status has said so; its route was sent more than once.
        self.is_over = self.said_arrived = self.was_sent_again = False

    @property
    def clock_ns(self):
        return (self.now_s + self.offset_s) * NS_PER_S

    @property
    def decision(self):
        return self.planner.state.decision

    def tell(self, *events):
        output = self.planner.step(self.clock_ns, *events)
        assert not output.failure, output.failure
        if output.command is not None:
            self.command_w = output.command.battery_heating_power_w

    def restart(self):
        choices = self.planner.state.inbox.choices.after_restart(self.clock_ns)
        self.planner = Supervisor(VEHICLE, SETTINGS, choices=choices)

    # Inputs

    def send_route(self, route_id, metres):
        """Begin a route of so many metres [m] at the place of now."""
        self.route = (route_id, self.clock_ns, max(metres, 1.0))
        self.here_m, self.fixed_m = 0.0, None
        self.said_arrived = False
        self.send_again()
        self.was_sent_again = False

    def send_again(self):
        route_id, stamp_ns, length_m = self.route
        self.was_sent_again = True
        self.see_start()
        whole, rest_s = divmod(length_m / SPEED_MPS, 60.0)
        self.tell(RouteArrived(Mission(route_id, (Leg(make_route({
            'duration_s': [60.0] * int(whole) + ([rest_s] if rest_s > 0.01 else []), 'speed_mps': [SPEED_MPS],
            'propulsion_power_w': [DRIVE_W], 'ambient_temperature_c': [AMBIENT_C]}, VEHICLE.defaults),
            stamp_ns, True, TARGET_C),))))

    def see_start(self):
        """
        See whether the trip of a route that was sent again has just begun.

        Then the clock was set back: a simulation that was started again, another trip ("How a trip ends" in
        docs/reference/topics.md).
        """
        if self.route[1] >= self.clock_ns - JUST_BEGUN_NS:
            self.is_over, self.said_arrived, self.fixed_m = False, False, None

    def send_position(self, distance_m):
        route_id, stamp_ns, length_m = self.route
        distance_m = min(max(distance_m, 0.0), length_m)
        self.tell(ProgressArrived(Progress(distance_m, self.clock_ns, route_id, stamp_ns)))
        return distance_m

    def step(self, propulsion_w, consumers_w, charger_w=0.0):
        """Let a step pass, with a battery state at its end."""
        self.now_s += STEP_S
        power_w = propulsion_w + consumers_w + self.command_w - charger_w
        power_w -= self.command_w if charger_w else 0.0
        self.soc = min(max(self.soc - power_w * STEP_S / 425.0 / VEHICLE.battery.capacity_as, 0.2), 0.9)
        heat_w = 0.87 * self.command_w + 0.08 * propulsion_w - 48.0 * (self.temperature_c - AMBIENT_C)
        self.temperature_c += heat_w * STEP_S / 377376.0
        # It never gets warm enough: the target is out of reach, so that each step of a trip wants heat. A reading
        # that stood still would be doubted.
        if self.temperature_c > 5.0:
            self.temperature_c -= 0.5
        resistance_ohm = 4.3125 / (self.temperature_c + 45.0)
        volts = 365.0 + 75.0 * self.soc + 15.0 * self.soc**3 - resistance_ohm * power_w / 425.0
        self.tell(BatteryStateArrived(Measurement(
            BatteryState(self.temperature_c, self.soc), self.clock_ns, volts, power_w / volts)))
        self.check()

    # The properties

    def check(self):
        mission, sentence = self.planner.state.mission, self.decision.explanation
        if self.command_w > 0.0:
            if self.is_over:
                self.violations.append(f'{self.command_w:.0f} W after the end of trip {self.trips}: {sentence}')
            elif self.said_arrived:
                self.violations.append(f'{self.command_w:.0f} W after ARRIVED: {sentence}')
            else:
                self.heated_on_the_way_s += STEP_S
        self.said_arrived = self.said_arrived or self.decision.status is Status.ARRIVED
        if self.fixed_m is not None and not self.is_over:
            delay_ns = 0 if mission is None else mission.delay_ns
            planned_m = (self.clock_ns - self.route[1] - delay_ns) / NS_PER_S * SPEED_MPS
            if planned_m < self.fixed_m - CORRECTED_M - PLACE_M - 1.0:
                self.violations.append(f'the place went back from {self.fixed_m:.0f} m to {planned_m:.0f} m: '
                                       f'{sentence}')

    # Pieces of a day

    def drive(self, share, pace, has_position):
        left_m = share * (self.route[2] - self.here_m)
        steps = max(1, round(left_m / (pace * SPEED_MPS * STEP_S)))
        for number in range(steps):
            self.here_m += left_m / steps
            self.step(pace * DRIVE_W * (1.1 if number % 2 else 0.9), CONSUMERS_W)
            if has_position:
                self.report()

    def report(self, error_m=0.0):
        told_m = self.send_position(self.here_m + error_m)
        self.fixed_m = max(self.fixed_m or 0.0, told_m)

    def do(self, kind, *how):
        if kind == 'drive':
            self.drive(*how)
        elif kind == 'stand':
            steps, has_position = how
            for number in range(steps):
                self.step(0.0, CONSUMERS_W)
                if has_position and self.route:
                    self.report(ERROR_M * (-1.0, 0.0, 0.7)[number % 3])
        elif kind == 'charge':
            for _ in range(*how):
                self.step(0.0, 0.0, CHARGER_W)
        elif kind == 'park':
            for _ in range(*how):
                self.step(0.0, PARKED_W)
        elif kind == 'asleep':
            self.now_s += how[0]
            self.command_w = 0.0
        elif kind == 'detour':
            self.send_route(f'{self.route[0]} detour' if self.route[0] else '', 60.0 * how[0] * SPEED_MPS)
        elif kind == 'again':
            self.send_again()
        elif kind == 'replan':
            self.send_route(self.route[0], self.route[2] - self.here_m)
        elif kind == 'search':
            for number in range(6):
                self.step(3e3, CONSUMERS_W)
                self.send_position(self.route[2] + how[0] * (number % 2))
        elif kind == 'home':
            steps, has_position = how
            for number in range(steps):
                self.step(DRIVE_W * (1.1 if number % 2 else 0.9), CONSUMERS_W)
                if has_position:
                    self.send_position(self.route[2] - number * STEP_S * SPEED_MPS)
        elif kind == 'clock':
            self.offset_s += how[0]
            self.command_w = 0.0
            if self.was_sent_again:
                self.see_start()
        elif kind == 'restart':
            self.restart()
            self.command_w = 0.0
            # The route is latched.
            self.send_again()

    def trip(self, before, minutes, pieces, last, charged, afterwards, route_id):
        """Stand, drive a route in pieces to its end, charge there, and go on as drawn."""
        if before:
            self.do('stand', before, False)
        self.trips += 1
        self.is_over = False
        self.send_route(f'{route_id} {self.trips}' if route_id else '', 60.0 * minutes * SPEED_MPS)
        for piece in pieces:
            self.do(*piece)
        pace, has_position = last
        heated_s = self.heated_on_the_way_s
        self.drive(1.0, pace, has_position)
        if not pieces and self.heated_on_the_way_s == heated_s:
            self.violations.append(f'trip {self.trips} was not heated: {self.decision.explanation}')
        if has_position:
            # The end is known with the next battery state.
            self.step(0.0, CONSUMERS_W)
            self.is_over = True
        if charged is not None:
            self.do('charge', charged)
        # Without a position two minutes of charging near the end show it, and the end of the planned time.
        self.is_over = self.is_over or self.decision.status is Status.ARRIVED
        for piece in afterwards if self.is_over else ():
            self.do(*piece)


def violations_of(day):
    world = World()
    for trip in day:
        world.trip(*trip)
    return world.violations
