# SPDX-License-Identifier: Apache-2.0
"""`route_publisher`: publishes a route file as `route_plan`, and the vehicle's place on it as `route_progress`."""

from __future__ import annotations

import math

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import NavSatFix
from std_msgs.msg import Float64

from bev_preheat.control.inputs import Progress
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.diagnostics import entry, OK, WARN
from bev_preheat.messages.fields import LAST_TIME_S
from bev_preheat.messages.fix import fix_from_message
from bev_preheat.messages.route_offer import (
    in_words,
    KMH_PER_MPS,
    load_offer,
    NO_AMBIENT_C,
    RouteOffer,
    WITH_AUXILIARIES,
)
from bev_preheat.messages.route_progress import progress_message
from bev_preheat.nodes.node import guarded, ProgramNode, Values, without_figures
from bev_preheat.nodes.parameters import GOAL_PARAMETERS, Parameter, StartParameter
from bev_preheat.nodes.process import NodeProgram
from bev_preheat.nodes.setup_watch import RESTART_S
from bev_preheat.nodes.topics import LATCHED
from bev_preheat.numerics import NS_PER_S
from bev_preheat.route.line import Cause, Match
from bev_preheat.route.matching import Matcher, USUAL_FROZEN_AFTER_S
from bev_preheat.route.odometer import OdometerPlace
from bev_preheat.route.sources.track import SPEED_RANGE_KMH
from bev_preheat_msgs.msg import RoutePlan, RouteProgress

# A change of these publishes the route again.
ROUTE_PARAMETERS = (
    Parameter('route', 'reference', 'Route: a name in config/routes, or a route file of any format.'),
    StartParameter('vehicle', 'reference', "Vehicle: a name in config/vehicles or a YAML file; the planner's "
                   'own.'),
    Parameter('route_id', '', "Identifies the route in route_plan. Empty: the file's name without suffix."),
    Parameter('departure_time', 0.0, 'Start of the route, since the epoch. 0: when the node starts or the route '
              'is replaced, and again when the vehicle leaves the start', 's',
              (0.0, float(LAST_TIME_S))),
    Parameter('ambient_temperature', NO_AMBIENT_C, 'Ambient temperature for a file that has none; below -60: not '
              'given', 'degC', (NO_AMBIENT_C, 60.0)),
    Parameter('consumption', 'unknown', 'Whether a consumption in the file includes heating and auxiliaries',
              choices=tuple(WITH_AUXILIARIES)),
    *GOAL_PARAMETERS,
    Parameter('free_speed', 0.0, 'Speed on free road, for a line on the map without times', 'm/s',
              (round(SPEED_RANGE_KMH[0] / KMH_PER_MPS, 4), round(SPEED_RANGE_KMH[1] / KMH_PER_MPS, 4)),
              unset_means='not given'),
    Parameter('stop_duration', 0.0, 'Duration of the charging stops at waypoints of navigation',
              's', (1.0, 86400.0), unset_means='waypoints are passed'),
    Parameter('vehicle_id', '', 'The vehicle in a file with several, such as the battery output of SUMO.'),
    Parameter('standing_time', 0.0, 'Standing time of the vehicle before the start; 0: not known', 's',
              (0.0, 1e7)),
)
PARAMETERS = (
    *ROUTE_PARAMETERS,
    StartParameter('odometer_at_start', 0.0, 'Reading of the odometer at the start of the route', 'm', (0.0, 1e10),
                   unset_means='the first reading, if the route starts now'),
    Parameter('position_timeout', 5.0, 'A position older than this is not used',
              's', (0.5, 60.0)),
    Parameter('clock_tolerance', 1.0, 'A position may be stamped this far in the future', 's', (0.0, 10.0)),
    StartParameter('frozen_after', USUAL_FROZEN_AFTER_S, 'A standing position that stays the same to the last '
                   'digit is used for this time', 's', (0.0, 86400.0)),
)
OF_ROUTE = frozenset(parameter.name for parameter in ROUTE_PARAMETERS)
PROGRAM = NodeProgram(
    'route_publisher', 'Publishes a route file as route_plan, and the place of the vehicle on it as '
    'route_progress.', PARAMETERS,
    subscribes=(('fix', 'sensor_msgs/NavSatFix: the position'),
                ('odometer', 'std_msgs/Float64: the odometer [m]')),
    publishes=(('route_plan', 'bev_preheat_msgs/RoutePlan'),
               ('route_progress', 'bev_preheat_msgs/RouteProgress'),
               ('/diagnostics', 'diagnostic_msgs/DiagnosticArray')))
# In real time, because simulated time may stand.
CLOCK_PERIOD_S = 0.1
# A place this close to the start is the start [m]; a route plan that is younger on departure is good enough [s].
START_M, YOUNG_S = 50.0, 10.0
# The odometer gives the place this long after the last one by a fix, and this often [s].
RECKON_AFTER_S, RECKON_PERIOD_S = 1.5, 0.9
# The place is known, or no longer needed.
GOOD = (Cause.MATCHED, Cause.RECKONED, Cause.ARRIVED)
# An instant further back than this is no trip that begins now [s].
BEGUN_BEFORE_S = 60.0


class RoutePublisherNode(ProgramNode):
    """Publishes one route at a time, and matches fixes and odometer to it; an uncertain place is not published."""

    def __init__(self) -> None:
        super().__init__(PROGRAM)
        self._use(load_offer(self.values))
        self._next_offer: RouteOffer | None = None
        self._start_ns, self._latest_ns = 0, 0
        self._refusal, self._refused = '', 0
        self._seen_cause = self._logged_cause = ''
        self._places: Matcher | OdometerPlace | None = None
        # The latest instant at which the vehicle was at the start [ns]; None: it has departed, or is not awaited.
        self._at_start_ns: int | None = None
        self._awaits_departure = False
        self._published_ns = 0

        self._route_publisher = self.create_publisher(RoutePlan, 'route_plan', LATCHED)
        self._progress_publisher = self.create_publisher(RouteProgress, 'route_progress', 1)
        self.create_subscription(NavSatFix, 'fix', self._on_fix, qos_profile_sensor_data)
        self.create_subscription(Float64, 'odometer', self._on_odometer, qos_profile_sensor_data)
        self.follow_parameters()
        self.steady_timer(CLOCK_PERIOD_S, self._look)
        self.watch(('fix', 'odometer'), ('route_plan', 'route_progress'),
                   single=('route_plan', 'route_progress'))
        self._look()

    # Time and route

    def _use(self, offer: RouteOffer) -> None:
        self._offer, self.hardware = offer, offer.vehicle_name

    @guarded
    def _look(self) -> int:
        """Return the node's time [ns]; 0 before it begins. Start or restart the trip if the clock did."""
        now_ns = self.now_ns()
        if now_ns and (self._start_ns == 0 or now_ns < self._latest_ns - RESTART_S * NS_PER_S):
            if self._start_ns:
                self.get_logger().warning(f'The clock fell back by {(self._latest_ns - now_ns) / NS_PER_S:.1f} s: '
                                          'the route is published again.')
            self._begin(now_ns, self.values['departure_time'])
        self._latest_ns = now_ns
        return now_ns

    def _begin(self, now_ns: int, departure_time_s: float) -> None:
        """Publish the route, and search for the vehicle on it."""
        offer = self._offer
        start_ns = round(departure_time_s * NS_PER_S) or now_ns
        begins_now = now_ns - start_ns < BEGUN_BEFORE_S * NS_PER_S
        self.get_logger().info(in_words(offer))
        for remark in offer.remarks:
            self.get_logger().info(remark)
        for warning in offer.warnings:
            self.get_logger().warning(warning)
        self._places = None
        at_start_m = self.values['odometer_at_start']
        if offer.line is not None:
            self._places = Matcher(offer.line, begins_now, self.values['frozen_after'])
        elif offer.length_m > 0.0 and (begins_now or at_start_m > 0.0):
            self._places = OdometerPlace(offer.length_m, at_start_m if at_start_m > 0.0 else None)
        self._awaits_departure, self._at_start_ns = departure_time_s == 0.0, None
        self._refusal = self._seen_cause = self._logged_cause = ''
        self._publish_route(start_ns)

    def _publish_route(self, start_ns: int) -> None:
        self._start_ns = start_ns
        self._route_publisher.publish(self._offer.route_plan(start_ns))

    # Positions

    @guarded
    def _on_fix(self, message: NavSatFix) -> None:
        now_ns, places = self._look(), self._places
        if not now_ns or not isinstance(places, Matcher):
            return
        try:
            fix = fix_from_message(
                message, now_ns, self.values['position_timeout'], self.values['clock_tolerance'])
        except InvalidInput as error:
            hint = self.setup.clock_hint(message.header.stamp, now_ns)
            self._refuse(f'fix refused: {error}' + (f'; {hint}' if hint else ''))
            return
        try:
            match = places.take(fix)
        except Exception as error:
            # No place for this fix; the next one may be matched.
            self._refuse(f'fix not matched: {type(error).__name__}: {error}')
            return
        if match.cause is Cause.OVERTAKEN:
            self._refuse(f'fix refused: {match.sentence}')
            return
        self._refusal = ''
        self._tell(match)

    @guarded
    def _on_odometer(self, message: Float64) -> None:
        now_ns, places = self._look(), self._places
        if not now_ns or places is None:
            return
        if not math.isfinite(message.data):
            self._refuse(f'odometer refused: {message.data:g} m is not allowed; it must be finite')
            return
        if isinstance(places, OdometerPlace):
            self._refusal = ''
            match = places.take(now_ns, message.data)
            if now_ns - self._published_ns >= RECKON_PERIOD_S * NS_PER_S:
                self._tell(match)
            return
        places.odometer.read(now_ns, message.data)
        if now_ns - self._published_ns >= max(RECKON_AFTER_S, RECKON_PERIOD_S) * NS_PER_S:
            reckoned = places.reckon(now_ns)
            if reckoned is not None:
                self._tell(reckoned)

    def _tell(self, match: Match) -> None:
        """Publish the place of a Match, if it has one."""
        if match.distance_m is None:
            return
        distance_m = self._offer.on_route_m(match.distance_m)
        if self._awaits_departure:
            self._await_departure(distance_m, match.stamp_ns)
        self._published_ns = self._latest_ns
        self._progress_publisher.publish(progress_message(Progress(
            distance_m, match.stamp_ns, self._offer.mission.route_id, self._start_ns)))

    def _await_departure(self, distance_m: float, stamp_ns: int) -> None:
        """Publish the route again once the vehicle has left its start later than its stamp says."""
        if distance_m <= START_M:
            self._at_start_ns = stamp_ns
            return
        self._awaits_departure = False
        # A vehicle that is first seen on the way has departed before.
        if self._at_start_ns is not None and self._at_start_ns - self._start_ns > YOUNG_S * NS_PER_S:
            self.get_logger().info('The vehicle has left the start: the route is published again.')
            self._publish_route(self._at_start_ns)

    def _refuse(self, sentence: str) -> None:
        self._refusal, self._refused = sentence, self._refused + 1
        self.tell(sentence)

    # Diagnostics

    def entries(self) -> list[DiagnosticStatus]:
        """Return the entry on the position, WARN unless the place is known or no longer needed; log its cause."""
        now_ns = self._look()
        match = self._current_match(now_ns)
        is_good = match.cause in GOOD
        # Only a cause that lasts is worth a line.
        cause = f'{match.cause.name} {without_figures(match.sentence) if match.cause is Cause.SILENT else ""}'
        if cause == self._seen_cause != self._logged_cause:
            self._logged_cause = cause
            # One call for each severity: rclpy raises if a line of code logs with a second one.
            if is_good:
                self.get_logger().info(f'{match.cause.value}: {match.sentence}.')
            else:
                self.get_logger().warning(f'{match.cause.value}: {match.sentence}.')
        self._seen_cause = cause
        values = {'cause': match.cause.name}
        if match.distance_m is not None and match.deviation_m is not None:
            values |= {'distance on the line [m]': f'{match.distance_m:.0f}',
                       'its standard deviation [m]': f'{match.deviation_m:.1f}'}
        values |= {'route_id': self._offer.mission.route_id,
                   'length of the route [m]': f'{self._offer.length_m:.0f}',
                   'route starts [s since the epoch]': f'{self._start_ns / NS_PER_S:.3f}',
                   'refused messages': str(self._refused)}
        if match.stamp_ns:
            values['age [s]'] = f'{(now_ns - match.stamp_ns) / NS_PER_S:.1f}'
        return [entry('position', OK if is_good and not self._refusal else WARN,
                      '; '.join(filter(None, [f'{match.cause.value}: {match.sentence}', self._refusal])), values)]

    def _current_match(self, now_ns: int) -> Match:
        places = self._places
        if places is None:
            return Match(Cause.UNCERTAIN, 'The route has neither coordinates nor a known reading of the odometer '
                         'at its start (odometer_at_start)', 0)
        match = places.match
        silent_s = (now_ns - match.stamp_ns) / NS_PER_S
        if match.stamp_ns and silent_s > self.values['position_timeout']:
            return Match(Cause.SILENT, f'No position for {silent_s:.0f} s', match.stamp_ns)
        return match

    # Parameters

    def check_values(self, changed: Values) -> None:
        """Load the route of new values."""
        self._next_offer = load_offer({**self.values, **changed}) if OF_ROUTE.intersection(changed) else None

    def take_values(self, changed: Values) -> None:
        """Publish the route of new values."""
        if self._next_offer is None:
            return
        self._use(self._next_offer)
        self._next_offer = None
        now_ns = self._look()
        if not now_ns:
            return
        if 'route' in changed or 'departure_time' in changed:
            self._begin(now_ns, changed.get('departure_time', 0.0))
        else:
            # The same road with another goal: the place stays.
            self._publish_route(self._start_ns)
