# SPDX-License-Identifier: Apache-2.0
"""`charger_adviser`: which of several chargers on the rest of the route costs least."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bev_preheat.charging.chargers import CandidateWorth, rank_chargers
from bev_preheat.charging.target_worth import MOST_PRICE_PER_KWH, MOST_VALUE_PER_H
from bev_preheat.control.decision import find_obstacle
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.rank_chargers import candidates_of, write_ranking
from bev_preheat.nodes.inbox_node import DEFAULTS, InboxNode, INPUT_PARAMETERS, VEHICLE
from bev_preheat.nodes.node import Values
from bev_preheat.nodes.parameters import Parameter
from bev_preheat.nodes.process import NodeProgram
from bev_preheat_msgs.srv import RankChargers

STEP, *AGES = INPUT_PARAMETERS
PARAMETERS = (
    replace(VEHICLE, read_only=True),
    Parameter('energy_price', DEFAULTS.energy_price_per_kwh,
              'Price of energy at chargers that name none', 'per kWh', (0.0, MOST_PRICE_PER_KWH)),
    Parameter('value_of_time', DEFAULTS.value_of_time_per_h,
              'Value of time, in the same currency', 'per h', (0.0, MOST_VALUE_PER_H)),
    replace(STEP, read_only=True), *AGES,
)
PROGRAM = NodeProgram(
    'charger_adviser', 'Ranks chargers on the rest of the route, each with its own best target.',
    PARAMETERS,
    subscribes=(('battery_state', 'sensor_msgs/BatteryState'),
                ('route_plan', 'bev_preheat_msgs/RoutePlan')),
    publishes=(('/diagnostics', 'diagnostic_msgs/DiagnosticArray'),),
    services=(('~/rank_chargers', 'bev_preheat_msgs/RankChargers: which charger costs least'),))


class ChargerAdviserNode(InboxNode):
    """Compares chargers on request: takes tenths of a second each, which would delay the planner's commands."""

    def __init__(self) -> None:
        super().__init__(PROGRAM)
        self.create_service(RankChargers, '~/rank_chargers', self._on_rank_chargers)
        self.follow_parameters()
        self.watch(('battery_state', 'route_plan'), ())
        self.get_logger().info(f'Comparing chargers for vehicle {self.hardware}.')

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
        moment = self.inbox.moment(self.now_ns(), measurement=self.inbox.measurement)
        obstacle = find_obstacle(moment)
        if obstacle is not None:
            raise InvalidInput(obstacle.explanation)
        now_ns, mission, measurement = moment.now_ns, moment.mission, moment.measurement
        assert mission is not None and measurement is not None
        leg = mission.legs[-1]
        if now_ns < leg.start_ns and len(mission.legs) > 1:
            raise InvalidInput('the route has stops ahead; chargers are compared on a drive without any')
        ahead = leg.route_ahead(max(now_ns, leg.start_ns))
        if ahead is None:
            raise InvalidInput(f'the route ended {leg.ended_for_s(now_ns):.0f} s ago')
        driven_m = sum(other.route.distance_m for other in mission.legs) - ahead.distance_m
        goal = replace(moment.goal_of(leg), charging_planned=True)
        return rank_chargers(
            moment.vehicle, ahead, measurement.state, goal,
            candidates_of(request, ahead, driven_m, self.values['energy_price']), request.end_soc,
            self.values['value_of_time'])

    def take_values(self, changed: Values) -> None:
        """Judge inputs by the new limits."""
        self.inbox = self.inbox._replace(settings=self.settings())
