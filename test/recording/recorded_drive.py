# SPDX-License-Identifier: Apache-2.0
"""Flight recordings of simulated drives, made without DDS but with the messages and the writer of the node."""

from dataclasses import replace
import math

from bev_preheat.control.settings import settings_of
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.nodes.recorded_scenario import MessageWire
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.simulation.imperfect_car import Imperfections
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.scenario import load_scenario
from bev_preheat.simulation.scenario_drive import drive_observed
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.vehicle import load_vehicle

# So short that each of many tests can replay it, and warm enough to be heated, and no longer, before the end.
LENGTH_S, TARGET_C = 300, 12.5
# For deep tests.
LONG_S, LONG_TARGET_C = 900, 20.0
AFTERWARDS_S = 5.0


def no_warning(sentence):
    raise AssertionError(sentence)


class Outputs(MessageWire):
    """Records, and keeps (instant [ns], StepOutput) of each step."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.outputs = []

    def stepped(self, now_ns, events, output):
        super().stepped(now_ns, events, output)
        self.outputs.append((now_ns, output))


def record_drive(folder, target_c=TARGET_C, length_s=LENGTH_S, planner=None, vehicle='reference', resolution_k=0.5,
                 most_c=math.inf, **imperfections):
    """Drive a part of the reference route, record it, and return the outputs of the steps."""
    scenario = load_scenario('nominal')
    scenario = replace(
        scenario, vehicle=load_vehicle(vehicle), seed=3,
        phases=(DrivePhase(scenario.first.route.before(length_s), Goal(
            target_c, maximum_arrival_temperature_c=most_c)),),
        state=BatteryState(10.0, 0.8), planner=planner or {},
        imperfections=Imperfections(sensors=Sensors(temperature_resolution_k=resolution_k), **imperfections))
    supervisor = Supervisor(scenario.vehicle, settings_of(scenario.planner))
    wire = Outputs(supervisor, scenario, str(folder), no_warning)
    drive_observed(scenario.car(), supervisor, target_c, AFTERWARDS_S, wire=lambda _: wire)
    wire.close()
    return wire.outputs
