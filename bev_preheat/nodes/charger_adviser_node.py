# SPDX-License-Identifier: Apache-2.0
"""`charger_adviser`: which of several chargers on the rest of the route costs least."""

from __future__ import annotations

from dataclasses import replace
import sys
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data, QoSProfile
from sensor_msgs.msg import BatteryState

from bev_preheat.charging.candidates import rank_chargers
from bev_preheat.charging.worth import MOST_PRICE_PER_KWH, MOST_VALUE_PER_H
from bev_preheat.control.admitted import find_obstacle
from bev_preheat.control.events import RouteUnreadable
from bev_preheat.control.inbox import Inbox
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput
from bev_preheat.nodes.charger_request import candidates_of, write_ranking
from bev_preheat.nodes.command_line import NodeProgram
from bev_preheat.nodes.convert import battery_event, time_message
from bev_preheat.nodes.news import RepetitionFilter
from bev_preheat.nodes.parameters import check, declare, Parameter
from bev_preheat.nodes.process import run_node
from bev_preheat.nodes.route_intake import RouteIntake
from bev_preheat.nodes.route_listener import RouteListener
from bev_preheat.nodes.setup_watch import DIAGNOSTICS_PERIOD_S, SetupWatch
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.srv import RankChargers

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import Any

    from rclpy.parameter import Parameter as RosParameter

    from bev_preheat.charging.candidates import CandidateWorth
    from bev_preheat.control.events import Event
    from bev_preheat_msgs.msg import RoutePlan

DEFAULTS = Settings()
PARAMETERS = (
    Parameter('vehicle', 'reference',
              "Vehicle: a name in config/vehicles or a YAML file; the planner's own.", read_only=True),
    Parameter('energy_price', DEFAULTS.energy_price_per_kwh,
              'Price of energy at chargers that name none', 'per kWh', (0.0, MOST_PRICE_PER_KWH)),
    Parameter('value_of_time', DEFAULTS.value_of_time_per_h,
              'Value of time, in the same currency', 'per h', (0.0, MOST_VALUE_PER_H)),
    Parameter('planning_step', DEFAULTS.planning_step_s,
              "Routes are planned in steps of this length; the planner's own", 's', (1.0, 300.0),
              read_only=True),
    Parameter('battery_state_timeout', DEFAULTS.battery_state_timeout_s,
              'A battery state older than this is stale', 's', (0.1, 60.0)),
    Parameter('clock_tolerance', DEFAULTS.clock_tolerance_s,
              'A battery state may be stamped this far in the future', 's', (0.0, 10.0)),
)
PROGRAM = NodeProgram(
    'charger_adviser', 'Ranks chargers on the rest of the route, each with its own best target.',
    PARAMETERS,
    subscribes=(('battery_state', 'sensor_msgs/BatteryState'),
                ('route_plan', 'bev_preheat_msgs/RoutePlan')),
    publishes=(('/diagnostics', 'diagnostic_msgs/DiagnosticArray'),),
    services=(('~/rank_chargers', 'bev_preheat_msgs/RankChargers: which charger costs least'),))
_OWN = frozenset(parameter.name for parameter in PARAMETERS)


class ChargerAdviserNode(Node):
    """
    Compares chargers on request, from the planner's inputs.

    A separate process, because one charger takes some tenths of a second, which would delay heater commands.
    """

    def __init__(self) -> None:
        """Declare the parameters and start; raises InvalidInput if one is not allowed."""
        super().__init__('charger_adviser')
        self._news = RepetitionFilter()
        self._values = declare(self, PARAMETERS)
        vehicle = load_vehicle(self._values['vehicle'])
        # Refuses the same inputs as the planner.
        self._inbox = Inbox.empty(vehicle, self._settings())
        self._routes = RouteIntake()
        state_qos = QoSProfile(depth=1, reliability=qos_profile_sensor_data.reliability)
        self.create_subscription(BatteryState, 'battery_state', self._on_battery_state, state_qos)
        RouteListener(self, self._on_route_plan, self._on_refused_route)
        self.create_service(RankChargers, '~/rank_chargers', self._on_rank_chargers)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.create_timer(DIAGNOSTICS_PERIOD_S, self._on_diagnostics,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._setup = SetupWatch(self, ('battery_state', 'route_plan'), ())
        self.get_logger().info(f'Comparing chargers for vehicle {vehicle.name}.')

    def _on_battery_state(self, message: BatteryState) -> None:
        self._deliver('battery_state', lambda: battery_event(
            message, self._setup.clock_hint(message.header.stamp, self._now_ns())))

    def _on_route_plan(self, message: RoutePlan) -> None:
        self._deliver('route_plan', lambda: self._routes.read(message, self._inbox))

    def _on_refused_route(self, error: InvalidInput) -> None:
        self._deliver('route_plan', lambda: RouteUnreadable(error))

    def _deliver(self, source: str, make_event: Callable[[], Event]) -> None:
        """Deliver an event of a topic to the inbox; log each refusal once."""
        try:
            self._inbox, refusal = self._inbox.taken(make_event(), self._now_ns())
            if refusal is not None:
                raise refusal
        except Exception as error:
            sentence = f'{source} refused: {error}'
            if self._news.has(sentence):
                self.get_logger().warning(sentence)

    def _on_diagnostics(self) -> None:
        message = DiagnosticArray(status=[self._setup.entry(self._inbox.vehicle.name)])
        message.header.stamp = time_message(self._now_ns())
        self._diagnostics_publisher.publish(message)

    def _on_rank_chargers(self, request: RankChargers.Request,
                          response: RankChargers.Response) -> RankChargers.Response:
        try:
            write_ranking(response, self._ranked(request))
        except InvalidInput as error:
            response.success, response.message = False, '; '.join(error.problems)
        except Exception as error:
            response.success = False
            response.message = f'cannot be compared: {type(error).__name__}: {error}'
            self.get_logger().error(response.message)
        return response

    def _ranked(self, request: RankChargers.Request) -> Sequence[CandidateWorth]:
        now_ns, inputs = self._now_ns(), self._inbox.admitted(measurement=self._inbox.measurement)
        obstacle = find_obstacle(inputs, now_ns)
        if obstacle is not None:
            raise InvalidInput(obstacle.explanation)
        mission, measurement = inputs.mission, inputs.measurement
        assert mission is not None and measurement is not None
        leg = mission.legs[-1]
        if now_ns < leg.start_ns and len(mission.legs) > 1:
            raise InvalidInput('the route has stops ahead; chargers are compared on a drive without any')
        ahead = leg.route_ahead(max(now_ns, leg.start_ns))
        if ahead is None:
            raise InvalidInput(f'the route ended {leg.ended_for_s(now_ns):.0f} s ago')
        driven_m = sum(other.route.distance_m for other in mission.legs) - ahead.distance_m
        goal = replace(inputs.goal_of(leg), charging_planned=True)
        return rank_chargers(
            inputs.vehicle, ahead, measurement.state, goal,
            candidates_of(request, ahead, driven_m, self._values['energy_price']), request.end_soc,
            self._values['value_of_time'])

    def _check_parameters(self, parameters: Sequence[RosParameter]) -> SetParametersResult:
        try:
            check(PARAMETERS, _own_values(parameters))
        except InvalidInput as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, parameters: Sequence[RosParameter]) -> None:
        self._values = {**self._values, **_own_values(parameters)}
        self._inbox = self._inbox._replace(settings=self._settings())

    def _settings(self) -> Settings:
        values = self._values
        return Settings(battery_state_timeout_s=values['battery_state_timeout'],
                        clock_tolerance_s=values['clock_tolerance'],
                        planning_step_s=values['planning_step'], estimation=False)

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds


def _own_values(parameters: Sequence[RosParameter]) -> dict[str, Any]:
    return {parameter.name: parameter.value for parameter in parameters if parameter.name in _OWN}


def main() -> None:
    """Run the adviser until a signal ends it."""
    sys.exit(run_node(ChargerAdviserNode, PROGRAM))


if __name__ == '__main__':
    main()
