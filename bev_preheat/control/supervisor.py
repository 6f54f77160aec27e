# SPDX-License-Identifier: Apache-2.0
"""Keeps the planner's State between its steps: for the node, the simulated drives and every replay."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.control.state import State
from bev_preheat.control.step import decide_later, fail, step, StepOutput, stop
from bev_preheat.estimation.driver_choices import NO_CHOICES

if TYPE_CHECKING:
    from bev_preheat.control.decision import Decision
    from bev_preheat.control.events import Event
    from bev_preheat.control.settings import Settings
    from bev_preheat.estimation.driver_choices import DriverChoices
    from bev_preheat.estimation.last_seen import LastSeen
    from bev_preheat.estimation.prior import Learned
    from bev_preheat.vehicle.description import Vehicle


class Supervisor:
    """The planner: its State, which each step replaces by another one."""

    def __init__(self, vehicle: Vehicle, settings: Settings, learned: Learned | None = None,
                 last_seen: LastSeen | None = None, choices: DriverChoices = NO_CHOICES) -> None:
        """Start without input; the arguments are those of `State.begun`."""
        self._state = State.begun(vehicle, settings, learned, last_seen, choices)

    def step(self, now_ns: int, *events: Event) -> StepOutput:
        """Take a `step.step` with events at an instant [ns]; return its StepOutput."""
        return self._keep(*step(self._state, now_ns, *events))

    def fail(self, now_ns: int, what: str) -> StepOutput:
        """Return the StepOutput that switches the heater off after an exception, given in words."""
        return self._keep(*fail(self._state, now_ns, what))

    def stop(self, now_ns: int) -> StepOutput:
        """Return the StepOutput that leaves the heater off when the process ends."""
        return self._keep(*stop(self._state, now_ns))

    def later_decisions(self) -> tuple[Decision, ...]:
        """Return a Decision for each later leg of the current one; see `step.decide_later`."""
        return decide_later(self._state)

    @property
    def state(self) -> State:
        """The State after the latest step."""
        return self._state

    def go_on_from(self, state: State) -> None:
        """Go on from a State, of a recording or of before a restart."""
        self._state = state

    def _keep(self, state: State, output: StepOutput) -> StepOutput:
        self._state = state
        return output
