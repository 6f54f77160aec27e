# SPDX-License-Identifier: Apache-2.0
"""Drives of simulated cars under a Supervisor, with each command and the decision shown with it."""

from dataclasses import replace
import math
from typing import NamedTuple

from bev_preheat.control.decision import Command, Decision
from bev_preheat.control.events import HeaterStatusArrived, SourceStatusArrived
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.simulation.supervised_drive import moments, START_NS, Wire
from bev_preheat.vehicle.description import HVCH


def with_source(vehicle, name, **properties):
    """Return a vehicle, of whose heat sources one has other properties."""
    return replace(vehicle, heat_sources=tuple(
        replace(source, **properties) if source.name == name else source for source in vehicle.heat_sources))


class Seen(NamedTuple):
    """A command at an instant [s], and the Decision that is shown with it; planner and car drive on."""

    at_s: float
    command: Command
    decision: Decision
    planner: Supervisor
    car: ImperfectCar


class Told(Wire):
    """
    Heaters whose controllers answer with each reading.

    `told_by_heater` makes the HeaterStatus from a controller's answer, the actual power [W] and the instant [ns];
    None: no answer.
    """

    def __init__(self, planner, told_by_heater):
        super().__init__(planner)
        self.told_by_heater = told_by_heater

    def answers(self, heater, now_ns):
        for name in heater.names if self.told_by_heater else ():
            status = self.told_by_heater(heater.answer(START_NS, name), heater.measured_w(name), now_ns)
            if status is not None:
                yield HeaterStatusArrived(status) if name == HVCH else SourceStatusArrived(status, name)


def drive(vehicle, phase, start, until_s=math.inf, told_by_heater=None, planned_for=None, sensors=Sensors(),
          faults=(), seed=0, **settings):
    """
    Yield a Seen for each command of a drive to its end, or until an instant [s].

    The planner takes the vehicle for `planned_for`; None: for itself.
    """
    car = ImperfectCar(vehicle, phase, start, Imperfections(sensors=sensors, heater_faults=tuple(faults)), seed)
    planner = Supervisor(planned_for or vehicle, Settings(**settings))
    for moment in moments(car, planner, lambda: car.plant.is_standing or car.time_s >= until_s,
                          Told(planner, told_by_heater)):
        assert not moment.output.failure
        if moment.output.command is not None:
            yield Seen(moment.time_s, moment.output.command, planner.state.decision, planner, car)
