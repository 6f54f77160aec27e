# SPDX-License-Identifier: Apache-2.0
"""Footprint of a single build of an export."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, TYPE_CHECKING

from bev_preheat.ecu.vectors import METHODS
from bev_preheat_studies.footprint.emulated import EmulatedCortexM7
from bev_preheat_studies.footprint.object_bytes import Bytes, needed_for, read_object, total
from bev_preheat_studies.footprint.painted import PaintedStack

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.vehicle.heat_path import HeatPath
    from bev_preheat_studies.footprint.builds import Build
    from bev_preheat_studies.footprint.situations import FootprintCase, Planned

# The functions that a caller of each of METHODS links.
FUNCTIONS = dict(zip(METHODS, ('bev_ecu_plan_switch', 'bev_ecu_plan_by_values')))
VEHICLE = 'bev_ecu_vehicle'


@dataclass(frozen=True)
class Plans:
    """
    The plans of a method for all FootprintCases, in order.

    `linked` are the bytes of the object files that the method needs, including the vehicle's.
    """

    linked: Bytes
    planned: list[Planned]

    @property
    def stack_bytes(self) -> int:
        """The most stack that any of the plans used."""
        return max(each.stack_bytes for each in self.planned)


@dataclass(frozen=True)
class Measured:
    """
    A Build of a vehicle with a HeatPath: its Plans by method, and the number of plans that differ from Python's.

    `memory_bytes` maps a number of steps to the caller's memory: optimal_switch without and with a heat path,
    value_function. It is the same for all processors; empty if not requested.
    """

    build: Build
    path: HeatPath
    situations: Sequence[FootprintCase]
    plans: dict[str, Plans]
    vehicle: Bytes
    everything: Bytes
    differ: int
    memory_bytes: dict[int, tuple[int, int, int]]

    def as_dictionary(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        def told(plans: Plans) -> dict[str, Any]:
            return {'linked': asdict(plans.linked), 'stack_bytes': plans.stack_bytes, 'plans': [
                {'steps': situation.steps, 'route': situation.route, 'status': each.status,
                 'stack_bytes': each.stack_bytes, 'instructions': each.instructions}
                for situation, each in zip(self.situations, plans.planned)]}

        return {
            'target': self.build.target.name, 'level': self.build.level, 'heat_path': asdict(self.path),
            'differ': self.differ, 'vehicle': asdict(self.vehicle), 'both_methods': asdict(self.everything),
            'methods': {method: told(plans) for method, plans in self.plans.items()}}


def measure(build: Build, path: HeatPath, situations: Sequence[FootprintCase],
            memory_steps: Sequence[int] = ()) -> Measured:
    """
    Return the footprint of a Build for FootprintCases; raises InvalidInput if it cannot be compiled.

    `memory_steps` are the numbers of steps for which memory is reported, if the build runs on this computer.
    """
    build.make_library()
    files = [read_object(file) for file in sorted(build.objects.rglob('*.o'))]
    numbers, memory_bytes = range(len(METHODS)), {}
    if build.target.is_this_computer:
        program = PaintedStack(build)
        memory_bytes = {steps: program.memory_bytes(steps) for steps in memory_steps}
        planned = [program.plan([(method, each) for each in situations]) for method in numbers]
    else:
        emulated = EmulatedCortexM7(build)
        planned = [[emulated.plan(method, each) for each in situations] for method in numbers]
    return Measured(
        build, path, situations,
        {method: Plans(total(needed_for([FUNCTIONS[method], VEHICLE], files)), its)
         for method, its in zip(METHODS, planned)},
        total(needed_for([VEHICLE], files)), total(needed_for([*FUNCTIONS.values(), VEHICLE], files)),
        sum(not situation.agrees(method, each) for method in numbers
            for situation, each in zip(situations, planned[method])), memory_bytes)
