# SPDX-License-Identifier: Apache-2.0
"""
A simulated car under the planner's own step, without ROS.

The planner gets the same inputs at the same instants as the node: each battery state, route plan
and position at the instant of its arrival, and the timers in between. Unlike in the node, planning
takes no time. While the car's computers sleep the planner takes no step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
import math
from time import process_time
from typing import TYPE_CHECKING

from bev_preheat.control.events import (
    BatteryStateArrived,
    BatteryStateUnreadable,
    ProgressArrived,
    RouteArrived,
)
from bev_preheat.control.inputs import Measurement, Mission, Progress
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.simulation.heater import HeaterSide
from bev_preheat.vehicle.heater_controller import HeaterCommand

if TYPE_CHECKING:
    from bev_preheat.control.events import Event
    from bev_preheat.control.supervisor import StepOutput, Supervisor
    from bev_preheat.simulation.imperfect_car import ImperfectCar
    from bev_preheat.simulation.sensors import Reading


class Wire:
    """Carries inputs to a planner as they are; others carry them as messages, and record each step."""

    def __init__(self, supervisor: Supervisor) -> None:
        self._planning_step_s = supervisor.state.settings.planning_step_s

    def route(self, mission: Mission) -> Event:
        """Return the event of a Mission."""
        return RouteArrived(mission.in_planning_steps(self._planning_step_s))

    def progress(self, progress: Progress) -> Event:
        """Return the event of a Progress."""
        return ProgressArrived(progress)

    def battery(self, reading: Reading, stamp_ns: int) -> Event:
        """Return the event of a Reading with a stamp [ns]."""
        if math.isnan(reading.temperature_c):
            return BatteryStateUnreadable(InvalidInput('temperature: nan is not a known value'), reading.soc)
        if reading.soc > 1.0:
            return BatteryStateUnreadable(InvalidInput(
                f'percentage: {reading.soc:g} is not allowed; it must be 0 ... 1'), reading.soc)
        return BatteryStateArrived(Measurement(
            BatteryState(reading.temperature_c, reading.soc), stamp_ns, reading.voltage_v, reading.current_a,
            supply_status=reading.supply_status, location=reading.location))

    def answers(self, heater: HeaterSide, now_ns: int) -> Iterable[Event]:
        """Return the heater's controllers' answers to a reading at an instant [ns]; here they are silent."""
        return ()

    def stepped(self, now_ns: int, events: Sequence[Event], output: StepOutput) -> None:
        """Hear of a step at an instant [ns]; `events` are of this Wire, or empty."""


# Start of the drive on the planner's clock: 2026-01-12 06:00 UTC.
START_NS = 1_768_197_600 * NS_PER_S


@dataclass(frozen=True)
class Moment:
    """
    One event, or one tick of a timer, and the StepOutput for it.

    `time_s` is the time since the start [s], `clock_s` the clock's reading; `reading` is the
    battery's Reading that arrived, None for any other event. `is_last` marks the last
    Moment of an instant. `cpu_s` is the processor time of the step [s].
    """

    time_s: float
    clock_s: float
    reading: Reading | None
    output: StepOutput
    is_last: bool
    cpu_s: float


def moments(car: ImperfectCar, supervisor: Supervisor, until: Callable[[], bool],
            wire: Wire | None = None) -> Iterator[Moment]:
    """
    Drive a car from its start under a Supervisor; yield the Moments until `until()`.

    Between two Moments the car drives under the latest command until that expires.
    """
    drive = _Drive(car, supervisor, wire or Wire(supervisor))
    yield drive.step(drive.wire.route(car.mission(START_NS)), is_last=False)
    while not until():
        yield from drive.due_now()
        drive.go_on()


class _Drive:
    def __init__(self, car: ImperfectCar, supervisor: Supervisor, wire: Wire) -> None:
        self._car, self._supervisor, self.wire = car, supervisor, wire
        self._heater = HeaterSide(car)
        self._ticks = 0
        self._settings = supervisor.state.settings
        self._stale_s = self._settings.battery_state_timeout_s

    @property
    def _tick_s(self) -> float:
        # Multiples of the period, because sums would drift from the readings' instants.
        return self._ticks * self._settings.command_period_s

    def due_now(self) -> Iterator[Moment]:
        """Yield the Moments of this instant: arrivals first, then the timers."""
        car, now_s = self._car, self._car.time_s
        events: list[tuple[Reading | None, Event]] = []
        mission, progress = car.route_news(START_NS), car.progress(START_NS)
        if mission is not None:
            events.append((None, self.wire.route(mission)))
        if progress is not None:
            events.append((None, self.wire.progress(progress)))
        readings = car.readings()
        if readings:
            events += [(None, event) for event in self.wire.answers(
                self._heater, START_NS + round(car.clock_s * NS_PER_S))]
        events += [(reading, self.wire.battery(
            reading, START_NS + round(car.stamp_s(reading.instant_s) * NS_PER_S))) for reading in readings]
        ticks = self._tick_s <= now_s
        if ticks:
            self._ticks += 1
        if self._stale_s <= now_s:
            self._stale_s += self._settings.battery_state_timeout_s
            ticks = True
        for number, (reading, event) in enumerate(events, start=1):
            yield self.step(event, reading=reading, is_last=number == len(events) and not ticks)
        if ticks:
            yield self.step()

    def go_on(self) -> None:
        """Drive on to the next instant with an event; sleeping computers have no events."""
        wakes_s, settings = self._car.asleep_until_s, self._settings
        self._car.advance_under(self._heater.lease(START_NS), min(
            self._tick_s, self._stale_s, self._car.next_event_s) if wakes_s is None else wakes_s)
        if wakes_s is not None:
            self._ticks = math.ceil(wakes_s / settings.command_period_s)
            self._stale_s = wakes_s + settings.battery_state_timeout_s

    def step(self, *events: Event, reading: Reading | None = None, is_last: bool = True) -> Moment:
        """Return the Moment of a step, with its command in effect."""
        time_s, clock_s = self._car.time_s, self._car.clock_s
        now_ns = START_NS + round(clock_s * NS_PER_S)
        started = process_time()
        output = self._supervisor.step(now_ns, *events)
        cpu_s = process_time() - started
        self.wire.stepped(now_ns, events, output)
        if output.command is not None:
            for name in self._heater.names:
                self._heater.take(HeaterCommand(
                    output.command.power_w(name), now_ns, output.command.valid_until_ns), START_NS, name)
        if reading is not None and not output.refusals:
            self._stale_s = time_s + self._settings.battery_state_timeout_s
        return Moment(time_s, clock_s, reading, output, is_last, cpu_s)
