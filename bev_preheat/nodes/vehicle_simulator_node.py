# SPDX-License-Identifier: Apache-2.0
"""`vehicle_simulator`: drives a route in simulated time and heats as `hvch_command` allows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
import math
import time

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.publisher import Publisher
from rclpy.task import Task
from sensor_msgs.msg import BatteryState as BatteryStateMessage

from bev_preheat.errors import InvalidInput
from bev_preheat.messages.battery_state import reading_message
from bev_preheat.messages.fields import time_message
from bev_preheat.messages.heater import heater_command, status_message
from bev_preheat.messages.route_plan import route_plan_message
from bev_preheat.messages.route_progress import progress_message
from bev_preheat.nodes.heater_execution import CommandSenders
from bev_preheat.nodes.node import guarded, ProgramNode, Values
from bev_preheat.nodes.process import LAST_WORDS_TIME, print_error
from bev_preheat.nodes.setup_watch import DIAGNOSTICS_PERIOD_S, endpoint_name
from bev_preheat.nodes.simulated_drive import departure, PROGRAM, trip_diagnostics
from bev_preheat.nodes.simulated_time import GRAPH_PERIOD_S, Lockstep, NoAnswer, NodeTime, OwnTime
from bev_preheat.nodes.topics import LATCHED
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.simulation.heater import HeaterSide
from bev_preheat.simulation.sensors import Reading
from bev_preheat.simulation.vehicle_plant import VehiclePlant
from bev_preheat.vehicle.description import HVCH
from bev_preheat.vehicle.heater_controller import Refusal
from bev_preheat_msgs.msg import (
    HeatSourceCommand,
    HeatSourceStatus,
    HvchCommand,
    HvchStatus,
    RoutePlan,
    RouteProgress,
)

# Time for listeners to receive the arrival before exit_on_arrival ends the process.
LINGER_SIMULATED_S = 5.0
LINGER_REAL_S = 1.0
# Real-time period of repeated battery states while the clock is held.
HOLD_PERIOD_S = 0.2
# Simulated time may be slower than requested by this share before a warning.
TOLERATED_LOSS = 0.2
# A restarted planner sends several commands at one instant, and each must be seen in lockstep.
COMMANDS_KEPT = 20
# Instants may differ from multiples of a tick by this [s].
ROUNDING = 1e-9
# Command reasons of a planner that still misses inputs.
NOT_READY = (HvchCommand.NO_ROUTE, HvchCommand.NO_BATTERY_STATE)


class VehicleSimulatorNode(ProgramNode):
    """
    An `ImperfectCar` behind topics, and the publisher of `/clock` unless another node is.

    Simulated time advances in ticks. A command applies from the tick before its arrival. `exit_status` is that of
    the process, once `finished` is done.
    """

    def __init__(self) -> None:
        super().__init__(PROGRAM)
        values, self.exit_status, self._senders = self.values, 0, CommandSenders()
        self._car, route_name, warnings = departure(values)
        self.hardware = self._plant.vehicle.name
        self._heater = HeaterSide(self._car)
        for warning in warnings:
            self.get_logger().warning(warning)
        self._owns_clock = values['publish_clock']
        if not self._owns_clock and self._car.imperfections.clock_jumps:
            raise InvalidInput(f'scenario {values["scenario"]} makes the clock jump; that is not '
                               'possible with publish_clock:=false')
        self._time = OwnTime(
            self, round(values['start_time'] * NS_PER_S), values['speed_up'], partial(self._end, 2)
        ) if self._owns_clock else NodeTime(self, values)
        self._pace = self._time.pace
        self._waits_for_planner = values['wait_for_planner']
        self._listeners_awaited = values['wait_for_listeners']
        if values['lockstep'] and values['speed_up'] != 1.0:
            raise InvalidInput(f'speed_up: {values["speed_up"]} is not allowed with lockstep; it must be 1.0')
        self._lockstep = Lockstep(
            self, values['lockstep_limit'], ('battery_state', 'route_plan')) if values['lockstep'] else None
        self._is_held = self._waits_for_planner or self._listeners_awaited > 0 or values['lockstep']
        self._stood_since_s: tuple[float, float] | None = None
        # Simulated time of the latest command in lockstep.
        self._answered_s = -math.inf

        self._state_publisher = self.create_publisher(BatteryStateMessage, 'battery_state', 1)
        self._route_publisher = self.create_publisher(RoutePlan, 'route_plan', LATCHED)
        self._progress_publisher = self.create_publisher(RouteProgress, 'route_progress', 1)
        self._commands = self.create_subscription(HvchCommand, 'hvch_command', self._on_command, COMMANDS_KEPT)
        # By name; empty if no status is published.
        self._status_publishers: dict[str, Publisher] = {}
        if values['heater_status']:
            self._status_publishers[HVCH] = self.create_publisher(HvchStatus, 'hvch_status', 1)
        # The heat sources beside the HVCH, with senders of their own numbers.
        if others := self._heater.names[1:]:
            self._source_senders = CommandSenders()
            self.create_subscription(HeatSourceCommand, 'heat_source_command', self._on_source_command,
                                     COMMANDS_KEPT * len(others))
            if values['heater_status']:
                self._status_publishers.update(dict.fromkeys(others, self.create_publisher(
                    HeatSourceStatus, 'heat_source_status', len(others))))
        self.follow_parameters()

        self._has_told_route = False
        self._drive: Task | None = None
        self._tick_timer = self.steady_timer(GRAPH_PERIOD_S if self._lockstep else self._pace.real_tick_s,
                                             self._on_look if self._lockstep else self._on_tick)
        self._hold_timer = self.steady_timer(HOLD_PERIOD_S, self._on_hold)
        self.steady_timer(DIAGNOSTICS_PERIOD_S, self._tell_lost_time)
        self.watch(('hvch_command',), ('battery_state', 'route_plan', 'route_progress'))
        self.get_logger().info(
            f'Vehicle {self._plant.vehicle.name}, route {route_name!r}{self._car.in_words}: '
            f'{duration_text(self._plant.duration_s)}, '
            f'{self._plant.route.distance_m / 1000:.1f} km, '
            f'{"in lockstep" if self._lockstep else f"at {self._pace.speed_up:g} times real time"}.'
            f'{" The clock waits." if self._is_held else ""}')

    # Time

    @property
    def _plant(self) -> VehiclePlant:
        return self._car.plant

    @guarded
    def _on_tick(self) -> None:
        car = self._car
        if not self._time.has_started:
            return
        if not self._has_told_route:
            self._has_told_route = True
            self._route_publisher.publish(
                route_plan_message(self._car.mission(self._time.start_ns)))
        if self._is_held:
            self._time.publish(self._stamp())
            return
        # Not of the node's clock: with use_sim_time that may be the one published here.
        real_s = time.monotonic()
        try:
            elapsed_s = self._time.elapsed_s()
        except InvalidInput as error:
            self._end(2, error)
            return
        if self._owns_clock and car.asleep_until_s is not None:
            # All computers sleep: skip these hours.
            elapsed_s = self._pace.elapsed_s = max(elapsed_s, car.asleep_until_s)
        car.advance_under(self._heater.lease(self._time.start_ns), elapsed_s)
        # The clock first: readers of a battery state need it for the age.
        self._time.publish(self._stamp())
        readings = car.readings()
        if car.is_over and self._stood_since_s is None:
            readings = [car.read()]
        # Only the latest one: others of the same tick would be overwritten in the queue.
        for _ in self._publish_due(readings[-1:]):
            pass
        self._stand(real_s)
        if self.values['exit_on_arrival'] and self._has_lingered(LINGER_REAL_S, real_s):
            self._finish(0)

    def _publish_due(self, readings: Iterable[Reading]) -> Iterator[None]:
        """Publish each message that is due, and Readings; yield after each."""
        car = self._car
        news, progress = car.route_news(self._time.start_ns), car.progress(self._time.start_ns)
        if news is not None:
            self._route_publisher.publish(route_plan_message(news))
            yield
        if progress is not None:
            self._progress_publisher.publish(progress_message(progress))
            yield
        for reading in readings:
            if self._status_publishers:
                self._publish_status()
                yield
            self._publish_state(reading)
            yield

    @guarded
    def _on_look(self) -> None:
        """Begin to drive in lockstep; end it at the time limit."""
        assert self._lockstep is not None
        if self._drive is None:
            assert self.executor is not None
            self._drive = self.executor.create_task(self._drive_in_lockstep, self._lockstep)
        try:
            self._lockstep.look()
        except NoAnswer as error:
            self._give_up(error)

    async def _drive_in_lockstep(self, lockstep: Lockstep) -> None:
        try:
            await self._begin_in_lockstep(lockstep)
            while not self.finished.done() and self._time.has_started:
                await self._go_on_in_lockstep(lockstep)
        except InvalidInput as error:
            self._end(2, error)
        except NoAnswer as error:
            self._give_up(error)
        except Exception as error:
            self.fail('lockstep', error)

    def _give_up(self, error: NoAnswer) -> None:
        self.get_logger().error(f'{error}. The drive ends after {duration_text(self._plant.time_s)}.')
        self._finish(1)

    async def _begin_in_lockstep(self, lockstep: Lockstep) -> None:
        """Start the clock of a planner that is connected, and give it the route."""
        names = await lockstep.meet(self._listeners_awaited, lambda: self._time.has_started and bool(
            self._commands.get_publisher_count()))
        self._is_held, self._has_told_route = False, True
        self._tell_start(names)
        self._time.publish(self._stamp())
        await lockstep.planner()
        # Listeners need the route for the instants of all other messages.
        await lockstep.listeners(is_due=True)
        self._route_publisher.publish(route_plan_message(self._car.mission(self._time.start_ns)))
        await lockstep.planner()
        await lockstep.listeners(is_due=True)

    async def _go_on_in_lockstep(self, lockstep: Lockstep) -> None:
        """Publish all that is due at an instant, and drive on to the next one."""
        car = self._car
        tick_s, tick = lockstep.tick_s, math.floor(car.time_s / lockstep.tick_s + ROUNDING)
        self._time.publish(self._stamp())
        await lockstep.clock(is_command_due=car.time_s - tick_s * tick <= ROUNDING)
        readings = car.readings()
        messages = self._publish_due(readings)
        next(messages, None)
        # Without a message too, for the timers: their turn comes after that of the clock.
        await lockstep.planner()
        for _ in messages:
            await lockstep.planner()
        if readings and self._answered_s != car.time_s:
            raise NoAnswer('No hvch_command with the stamp of /clock answers the battery state: a message was '
                           'lost')
        self._stand(0.0)
        has_lingered = self._has_lingered()
        await lockstep.listeners(has_lingered)
        if has_lingered and self.values['exit_on_arrival']:
            self._finish(0)
            return
        to_s = car.asleep_until_s or min(tick_s * (tick + 1), car.next_event_s)
        if has_lingered:
            # The drive has ended, but the clock of other nodes must not stop: go on in real time.
            await lockstep.pause(to_s - car.time_s)
        car.advance_under(self._heater.lease(self._time.start_ns), to_s)

    @guarded
    def _on_hold(self) -> None:
        if self._is_held and not self._lockstep:
            # A planner on simulated time cannot use it before the first /clock.
            if self._has_told_route:
                self._publish_status()
                self._publish_state(self._car.read())
            self._start_if_ready()
        else:
            self._hold_timer.cancel()

    def _start_if_ready(self) -> None:
        if self._waits_for_planner:
            return
        publisher = self._state_publisher
        # During discovery, the count of matched subscriptions may include duplicates.
        listeners = {bytes(endpoint.endpoint_gid): endpoint_name(endpoint)
                     for endpoint in self.get_subscriptions_info_by_topic(publisher.topic_name)}
        if min(publisher.get_subscription_count(), len(listeners)) >= self._listeners_awaited:
            self._is_held = False
            self._tell_start(sorted(listeners.values()))

    def _tell_start(self, listeners: Sequence[str]) -> None:
        self.get_logger().info(
            f'Planner and listeners are ready ({", ".join(listeners) or "none"} listening); the clock starts.')

    def _stand(self, real_s: float) -> None:
        """Publish and log the end of the drive, once it has ended."""
        plant = self._plant
        if not self._car.is_over or self._stood_since_s is not None:
            return
        self._stood_since_s = (real_s, plant.time_s)
        self.publish_diagnostics()
        energy = plant.energy_wh
        figures = (
            f'battery {plant.temperature_c:.2f} degC, state of charge {plant.soc:.4f}; energies: '
            f'Joule heat {energy.joule:.1f}, drivetrain heat {energy.drivetrain_heat:.1f}, all heat '
            f'sources {energy.hvch_heat:.1f} of {energy.hvch_electric:.1f} electrical, leakage '
            f'{energy.leakage:.1f}, battery in total {energy.battery_total:.1f} Wh')
        if plant.has_arrived:
            self.get_logger().info(f'Arrived after {duration_text(plant.duration_s)}: {figures}.')
        else:
            self.get_logger().error(
                f'The battery is empty after {duration_text(plant.end_s)}: the vehicle '
                f'stands. {figures}.')
        if plant.undeliverable_power_w > 0.0:
            self.get_logger().warning(
                f'The battery was short by up to {plant.undeliverable_power_w / 1000:.1f} kW, '
                f'{plant.undeliverable_energy_wh:.1f} Wh in all.')

    def _has_lingered(self, for_s: float = 0.0, real_s: float = 0.0) -> bool:
        """Whether the drive has been over for LINGER_SIMULATED_S, and at `real_s` for `for_s` [s of real time]."""
        if self._stood_since_s is None:
            return False
        stood_real_s, stood_simulated_s = self._stood_since_s
        return self._plant.time_s - stood_simulated_s >= LINGER_SIMULATED_S and real_s - stood_real_s >= for_s

    # Topics

    @guarded
    def _on_command(self, message: HvchCommand, info: Mapping[str, int]) -> None:
        if self._lockstep and message.header.stamp == self._stamp():
            self._answered_s = self._car.time_s
            self._lockstep.hear()
        if self._car.is_over or self._time.start_ns == 0 or (self._lockstep and self._is_held):
            return
        if self._is_held:
            # A planner may be restarted meanwhile.
            self._heater.restart()
        verdict = self._heater.take(heater_command(
            message, self._senders.sender(info.get('publication_sequence_number'))), self._time.start_ns)
        if verdict.refusal is not Refusal.NOT_REFUSED:
            self.tell(f'hvch_command ignored: {verdict.sentence}')
            return
        if self._is_held and (message.battery_heating_power > 0.0
                              or message.reason not in NOT_READY):
            self._waits_for_planner = False
            self._start_if_ready()

    @guarded
    def _on_source_command(self, message: HeatSourceCommand, info: Mapping[str, int]) -> None:
        sender = self._source_senders.sender(info.get('publication_sequence_number'))
        if self._car.is_over or self._is_held or message.name not in self._heater.names[1:]:
            return
        verdict = self._heater.take(heater_command(message, sender), self._time.start_ns, message.name)
        if verdict.refusal is not Refusal.NOT_REFUSED:
            self.tell(f'heat_source_command of {message.name} ignored: {verdict.sentence}')

    def _publish_status(self) -> None:
        """Publish the answers of the heat sources."""
        if self._time.start_ns:
            for name, publisher in self._status_publishers.items():
                publisher.publish(status_message(self._heater.answer(self._time.start_ns, name), self.now_ns(),
                                                 self._heater.measured_w(name), name))

    def _publish_state(self, reading: Reading) -> None:
        stamp_ns = self._time.start_ns + round(self._car.stamp_s(reading.instant_s) * NS_PER_S)
        self._state_publisher.publish(
            reading_message(reading, self._plant.vehicle.battery.capacity_ah, stamp_ns))

    @guarded
    def _tell_lost_time(self) -> None:
        lost_s, self._pace.lost_s = self._pace.lost_s, 0.0
        share = lost_s / (DIAGNOSTICS_PERIOD_S * self._pace.speed_up)
        if share > TOLERATED_LOSS:
            self.get_logger().warning(
                f'Simulated time runs {100 * share:.0f} % slower than speed_up '
                f'{self._pace.speed_up:g}: this computer is too busy.', throttle_duration_sec=10.0)

    def entries(self) -> list[DiagnosticStatus]:
        """Return the entry on the drive."""
        return [trip_diagnostics(self._car)]

    def now_ns(self) -> int:
        """Return the instant of the drive [ns]; 0 before it begins."""
        return self._time.start_ns and self._time.start_ns + round(self._car.clock_s * NS_PER_S)

    def _stamp(self) -> Time:
        return time_message(self.now_ns())

    def check_values(self, changed: Values) -> None:
        """Refuse another speed where the drive does not set it."""
        if changed.get('speed_up', 1.0) != 1.0:
            if self._lockstep:
                raise InvalidInput('speed_up: lockstep is as fast as it can')
            if not self._owns_clock:
                raise InvalidInput('speed_up: the owner of /clock sets it (publish_clock is false)')

    def take_values(self, changed: Values) -> None:
        """Go on at another speed, or with another period."""
        if 'speed_up' in changed and not self._lockstep:
            self._pace.speed_up = changed['speed_up']
            self._tick_timer.timer_period_ns = round(self._pace.real_tick_s * 1e9)
            self._tick_timer.reset()
        if 'battery_state_period' in changed:
            self._car.readings_of.set_period(changed['battery_state_period'], self._plant.time_s)

    def _end(self, exit_status: int, error: Exception | str) -> None:
        """End the process after an error that the user has to fix."""
        print_error(error, PROGRAM)
        self._finish(exit_status)

    def fail(self, where: str, error: Exception) -> None:
        """End the simulation after an unexpected exception."""
        self.get_logger().error(f'{where}: {type(error).__name__}: {error}; the simulation ends')
        self._finish(1)

    def _finish(self, exit_status: int) -> None:
        if not self.finished.done():
            self.exit_status = exit_status
            self.finished.set_result(None)

    def last_words(self) -> None:
        """Wait up to 1 s until the listeners have received the last diagnostics."""
        self._diagnostics_publisher.wait_for_all_acked(LAST_WORDS_TIME)
