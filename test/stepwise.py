# SPDX-License-Identifier: Apache-2.0
"""A Supervisor that receives one input at a time, and records its output."""

from bev_preheat.control.events import (
    BatteryStateArrived,
    PreheatingSwitched,
    Reconfigured,
    RefusedRoute,
    RouteArrived,
    RouteUnreadable,
    TripCancelled,
)
from bev_preheat.control.supervisor import StepOutput, Supervisor


class Stepwise(Supervisor):
    """Turns single inputs into steps, by default at the previous step's instant, and raises refusals."""

    def __init__(self, vehicle, settings, learned=None, **before_restart):
        super().__init__(vehicle, settings, learned, **before_restart)
        self.output, self._now_ns = StepOutput(), 0

    def run(self, now_ns, *events):
        self.step_through(now_ns, *events)
        assert not self.output.failure, self.output.failure
        for refusal in self.output.refusals:
            raise refusal.error

    def step_through(self, now_ns, *events):
        self._now_ns, self.output = now_ns, self.step(now_ns, *events)
        if self.output.decision is not None:
            # As the node does, after the command.
            self.later_decisions()

    def accept_battery(self, measurement, now_ns):
        self.run(now_ns, BatteryStateArrived(measurement))

    def accept_mission(self, mission):
        self.run(self._now_ns, RouteArrived(mission))

    def refuse_route(self, error, refused=RefusedRoute()):
        self.step_through(self._now_ns, RouteUnreadable(error, refused))

    def cancel(self):
        self.run(self._now_ns, TripCancelled())

    @property
    def enabled(self):
        return self.state.is_enabled

    @enabled.setter
    def enabled(self, is_enabled):
        self.run(self._now_ns, PreheatingSwitched(is_enabled))

    @property
    def settings(self):
        return self.state.settings

    @settings.setter
    def settings(self, settings):
        self.run(self._now_ns, Reconfigured(self.vehicle, settings))

    @property
    def vehicle(self):
        return self.state.vehicle

    @vehicle.setter
    def vehicle(self, vehicle):
        self.run(self._now_ns, Reconfigured(vehicle, self.settings))

    def replan(self, now_ns):
        if now_ns != self._now_ns:
            # Every event causes a plan, even if it changes nothing.
            self.run(now_ns, PreheatingSwitched(self.state.is_enabled))
        return self.state.decision

    def refresh(self, now_ns):
        self.run(now_ns)

    def command(self, now_ns):
        """Return the Command that is given as time passes."""
        self.run(now_ns)
        return self.state.latest_command
