# SPDX-License-Identifier: Apache-2.0
"""
The inbox: checks every input on arrival, stores the last valid one, and remembers refusals.

It is a value: each event makes another one. A refused input comes back as InvalidInput, and keeps the heater off
as docs/explanation/safety.md describes. Instants are integers, in nanoseconds of the node's clock.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from bev_preheat.control import events
from bev_preheat.control.decision import Decision, Moment, WITHOUT_ROUTE
from bev_preheat.control.inputs import check_mission, Measurement, Mission, Progress
from bev_preheat.control.settings import defaults_of, Settings
from bev_preheat.control.timetable import Timetable, TripEnd
from bev_preheat.errors import age_beyond, InvalidInput
from bev_preheat.estimation.before_restart import CancelledTrip, DriverChoices, EndedTrip, NO_CHOICES
from bev_preheat.estimation.signal_checks import (
    electrical_check,
    is_one_battery,
    PercentScale,
    SignalVerdict,
    STATE_OF_CHARGE,
)
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import check_situation
from bev_preheat.planning.status import Status
from bev_preheat.route.plausibility import unit_warnings
from bev_preheat.tunables import CLOCK_RESTART_S
from bev_preheat.vehicle.description import Vehicle


@dataclass(frozen=True)
class InputChanges:
    """
    Changes since they were taken last.

    `measurements` are the valid battery states, oldest first. `has_new_mission`: the route was
    replaced or dropped. `has_new_trip`: another trip began, or the trip was cancelled.
    `clock_restarted`: earlier stamps are void.
    """

    measurements: tuple[Measurement, ...] = ()
    has_new_mission: bool = False
    has_new_trip: bool = False
    clock_restarted: bool = False


NO_CHANGES = InputChanges()


class Inbox(NamedTuple):
    """
    The last valid inputs.

    `rivals` are the names of other nodes that command the same heater. `timetable` is that of the current route,
    None without one; `latest_mission` may have been dropped because it does not fit the parameters.
    `overtaken_states` is the number of battery states dropped because a later one had arrived before them.
    `refused_progress` is the sentence of the latest refused route progress, None after a valid one, or a route.
    `unit_warnings` are sentences on fields of the current route that look like wrong units, `scale_verdict` is
    that on a state of charge given in percent instead of 0 ... 1; None: no such doubt. `is_cancelled`: by the
    latest route plan, or before a restart. `changes` are those since they were last taken.

    `cancelled_before` was cancelled before a restart: another node cancelled it, so its publisher may still latch
    it. `route_id` is that of the latest valid route, even after it was dropped; `is_after_end`: it arrived after
    the end of its trip. `latest_ns` is the instant of the latest battery state, or of an end before a restart: a
    clock before it was set back.
    """

    vehicle: Vehicle
    settings: Settings
    choices: DriverChoices = NO_CHOICES
    rivals: str = ''
    timetable: Timetable | None = None
    measurement: Measurement | None = None
    latest_mission: Mission | None = None
    overtaken_states: int = 0
    refused_progress: str | None = None
    unit_warnings: tuple[str, ...] = ()
    scale_verdict: SignalVerdict | None = None
    is_cancelled: bool = False
    changes: InputChanges = NO_CHANGES
    refusals: events.Refusals = events.Refusals()
    percent_scale: PercentScale = PercentScale()
    cancelled_before: CancelledTrip | None = None
    route_id: str | None = None
    is_after_end: bool = False
    latest_ns: int = 0

    @classmethod
    def empty(cls, vehicle: Vehicle, settings: Settings, choices: DriverChoices = NO_CHOICES) -> Inbox:
        """Return an Inbox without input, but with the DriverChoices from before a restart."""
        return cls(vehicle, settings, choices, cancelled_before=choices.cancelled_trip,
                   latest_ns=0 if choices.ended_trip is None else choices.ended_trip.ended_ns)

    @property
    def is_enabled(self) -> bool:
        """Whether the driver allows preheating."""
        return self.choices.switched_off_ns is None

    @property
    def mission(self) -> Mission | None:
        """The current Mission with its delay (see timetable.Timetable); None without a route."""
        return None if self.timetable is None else self.timetable.mission

    @property
    def refused_route(self) -> str | None:
        """The sentence of the latest route plan's refusal; None after a valid one."""
        return self.refusals.route

    @property
    def without_route(self) -> Decision:
        """The Decision as long as there is no route."""
        before, wanted = ('', 'new route plan') if self.cancelled_before is None else (
            ' before the planner restarted', 'route plan with another stamp')
        return WITHOUT_ROUTE if not self.is_cancelled else Decision(
            Status.NO_CHARGING_PLANNED,
            f'The trip was cancelled{before}: no heating until a {wanted} arrives.')

    def moment(self, now_ns: int, preparation: Timetable | None = None, measurement: Measurement | None = None,
               doubt: str | None = None) -> Moment:
        """
        Return the Moment of an instant [ns], as far as the inputs tell it.

        `preparation` is the Timetable of a preparation goal; None without one. `measurement` is the latest one
        with the signals that hold, `doubt` the sentence on those that do not.
        """
        return Moment(
            now_ns, self.vehicle, self.settings, self.is_enabled, self.rivals, self.refusals.obstacle,
            self.without_route, self.timetable, preparation or self.timetable, measurement, doubt)

    def with_timetable(self, timetable: Timetable | None) -> Inbox:
        """Return the Inbox with a later value of the route's Timetable; it remembers the end of the trip."""
        if timetable is self.timetable:
            return self
        before = self.timetable
        if timetable is None or timetable.end is None or (before is not None and before.end is not None):
            return self._replace(timetable=timetable)
        planned, end = timetable.planned, timetable.end
        assert end.at_ns is not None
        return self._replace(timetable=timetable, choices=replace(self.choices, ended_trip=EndedTrip(
            planned.route_id, planned.stamp_ns, end.at_ns, end.is_observed)))

    def with_other_goal(self) -> Inbox:
        """Return the Inbox after a preparation goal began or ended: another trip, as far as heating counts."""
        return self._replace(changes=replace(self.changes, has_new_mission=True, has_new_trip=True))

    def taken(self, event: events.Event, now_ns: int) -> tuple[Inbox, InvalidInput | None]:
        """Return the Inbox with an event of an instant [ns], and the InvalidInput if it is refused."""
        match event:
            case events.BatteryStateArrived(measurement, hint):
                return self._with_battery(measurement, hint, now_ns)
            case events.BatteryStateUnreadable(error, percentage):
                return self._with_refused_battery(error, percentage, now_ns), error
            case events.RouteArrived(mission):
                return self._with_mission(mission, now_ns)
            case events.RouteUnreadable(error, refused):
                return self._with_refused_route(error, refused), error
            case events.TripCancelled():
                return self._cancelled(now_ns), None
            case events.ProgressArrived(progress, hint):
                return self._with_progress(progress, hint, now_ns)
            case events.ProgressUnreadable(error):
                return self._with_refused_progress(error), error
            case events.PreheatingSwitched(is_enabled):
                return self._with_choices(switched_off_ns=None if is_enabled else now_ns), None
            case events.DeparturesSkipped(until_ns):
                return self._with_choices(skipped_until_ns=until_ns), None
            case events.RivalsChanged(names):
                return self._replace(rivals=names), None
            case events.Reconfigured():
                return self._reconfigured(event)
        return self, None

    def _with_choices(self, **choices: Any) -> Inbox:
        return self._replace(choices=replace(self.choices, **choices))

    def _reconfigured(self, event: events.Reconfigured) -> tuple[Inbox, InvalidInput | None]:
        inbox = self._replace(vehicle=event.vehicle, settings=event.settings)
        if isinstance(event.mission, InvalidInput):
            return inbox._without_misfit(event.mission, self.latest_mission), event.mission
        return (inbox, None) if event.mission is None else inbox._with_revised(event.mission)

    # Battery states

    def _with_battery(self, measurement: Measurement, hint: str, now_ns: int) -> tuple[Inbox, InvalidInput | None]:
        """Store a Measurement, or refuse it and keep the previous one; `hint` is added to a refusal."""
        inbox = self
        if now_ns < self.latest_ns - CLOCK_RESTART_S * NS_PER_S:
            inbox = self._with_restarted_clock(now_ns)
        inbox = inbox._replace(latest_ns=now_ns)
        try:
            if now_ns == 0:
                raise InvalidInput('use_sim_time is set and no /clock has arrived: time stands at 0')
            check_situation(self.vehicle, state=measurement.state)
            if inbox._is_overtaken(measurement, now_ns):
                return inbox._replace(overtaken_states=inbox.overtaken_states + 1), None
            inbox._check_stamp(measurement, now_ns)
            inbox = inbox._with_scale(measurement, now_ns)
            if inbox.scale_verdict is not None:
                raise InvalidInput(inbox.scale_verdict.sentence)
        except InvalidInput as error:
            hinted = _with_hint(error, hint)
            return inbox._with_refused_battery(hinted, measurement.state.soc, now_ns), hinted
        arrived = replace(measurement, arrived_ns=now_ns)
        return inbox._replace(
            measurement=arrived, refusals=inbox.refusals.after_battery(),
            changes=replace(inbox.changes, measurements=(*inbox.changes.measurements, arrived))), None

    def _with_restarted_clock(self, now_ns: int) -> Inbox:
        """Return the Inbox without the instants of a clock that was set back."""
        inbox, timetable = self._replace(measurement=None), self.timetable
        if timetable is not None:
            timetable = timetable.without_instants()
            inbox = inbox._replace(timetable=timetable)
            if inbox.is_after_end:
                # It arrived before this clock did, and may begin a trip by it.
                inbox = inbox._beginning_or_going_on(timetable.planned, now_ns)
        return inbox._replace(changes=replace(inbox.changes, measurements=(), clock_restarted=True))

    def _is_overtaken(self, measurement: Measurement, now_ns: int) -> bool:
        """
        Return whether a later state arrived a moment before this one, or stamps jitter.

        Stamps that jitter by less than `battery_state_timeout` are no doubt if both states are of one battery: the
        later stamp counts and expires as usual.
        """
        latest, timeout_s = self.measurement, self.settings.battery_state_timeout_s
        if latest is None or now_ns < measurement.stamp_ns:
            return False
        late_s = (latest.stamp_ns - measurement.stamp_ns) / NS_PER_S
        return 0.0 < late_s <= min(CLOCK_RESTART_S, timeout_s) or (
            0.0 < late_s and now_ns - measurement.stamp_ns <= timeout_s * NS_PER_S
            and is_one_battery(latest.seen, measurement.seen))

    def _with_refused_battery(self, error: InvalidInput, percentage: float, now_ns: int) -> Inbox:
        """Return the Inbox after a refused battery state, whose message had a percentage, NaN: unknown."""
        return self._replace(
            percent_scale=self.percent_scale.refused(now_ns / NS_PER_S, percentage),
            refusals=self.refusals.of_battery(error))

    def _check_stamp(self, measurement: Measurement, now_ns: int) -> None:
        age_s = (now_ns - measurement.stamp_ns) / NS_PER_S
        timeout_s = self.settings.battery_state_timeout_s
        ahead_s = self.settings.clock_tolerance_s
        if not -ahead_s <= age_s <= timeout_s:
            is_same = self.measurement is not None and self.measurement.stamp_ns == measurement.stamp_ns
            raise InvalidInput(f'header.stamp: the state is {age_beyond(age_s, ahead_s, timeout_s)}' + (
                '; the state before had the same stamp: if stamps are coarse, battery_state_timeout must be at '
                'least their step' if is_same else ''))
        if self.measurement is not None and measurement.stamp_ns < self.measurement.stamp_ns:
            late_s = (self.measurement.stamp_ns - measurement.stamp_ns) / NS_PER_S
            raise InvalidInput(f'header.stamp: the state is {late_s:.3f} s older than the previous one; '
                               'stamps must not go back')

    def _with_scale(self, measurement: Measurement, now_ns: int) -> Inbox:
        """Return the Inbox with the scale of a percentage, and the verdict on a percentage beyond 0 ... 1."""
        percent_scale, doubt = self.percent_scale.seen(
            now_ns / NS_PER_S, measurement.state.soc, lambda: self._voltage_vouches_for(measurement))
        verdict = None
        if doubt:
            since_ns = now_ns if self.scale_verdict is None else self.scale_verdict.since_ns
            verdict = SignalVerdict(STATE_OF_CHARGE, doubt, since_ns)
        return self._replace(percent_scale=percent_scale, scale_verdict=verdict)

    def _voltage_vouches_for(self, measurement: Measurement) -> bool:
        """Return whether the voltage fits the state of charge better than a hundredth of the reading."""
        state, voltage_v, current_a = measurement.state, measurement.voltage_v, measurement.current_a
        return voltage_v is not None and current_a is not None and electrical_check(self.vehicle).is_nearer(
            voltage_v, current_a, state.temperature_c, state.soc, state.soc / 100.0)

    # Route progress: optional, so a refusal does not affect the heater

    def _with_progress(self, progress: Progress, hint: str, now_ns: int) -> tuple[Inbox, InvalidInput | None]:
        """Take a route progress in, or refuse it; it is ignored without a route."""
        if self.timetable is None:
            return self, None
        try:
            timetable = self.timetable.at_progress(progress, now_ns, self.settings)
        except InvalidInput as error:
            hinted = _with_hint(error, hint)
            return self._replace(timetable=self.timetable.after_refused(progress))._with_refused_progress(
                hinted), hinted
        return self._replace(timetable=timetable, refused_progress=None), None

    def _with_refused_progress(self, error: InvalidInput) -> Inbox:
        """Return the Inbox after a route progress was refused: the previous one holds until it is too old."""
        return self._replace(refused_progress=f'{events.ROUTE_PROGRESS} refused: {error}')

    # Routes

    def _with_mission(self, mission: Mission, now_ns: int) -> tuple[Inbox, InvalidInput | None]:
        """Replace the route by a Mission of an instant [ns], or refuse it; a trip that has ended stays ended."""
        try:
            self._check_mission(mission)
        except InvalidInput as error:
            return self._with_refused_route(error, events.RefusedRoute.of_mission(mission)), error
        before = self.cancelled_before
        if before is not None and before.is_of(mission.route_id, mission.stamp_ns):
            return self._dropped(), None
        outdated = '' if self.timetable is None else self.timetable.outdated(mission, now_ns)
        if outdated:
            refusal = InvalidInput(outdated)
            return self._replace(refusals=self.refusals.of_outdated_route(refusal)), refusal
        inbox = self._replace(cancelled_before=None)._with_choices(cancelled_trip=None)
        inbox = inbox._beginning_or_going_on(mission, now_ns)
        return inbox._replace(refusals=inbox.refusals.after_route()), None

    def _beginning_or_going_on(self, mission: Mission, now_ns: int) -> Inbox:
        """Follow a valid Mission: another trip, or an update of the current trip or of an ended one."""
        timetable, ended = self.timetable, self.choices.ended_trip
        is_update = mission.route_id == self.route_id
        is_after_end = ended is not None and ended.includes(
            mission.route_id, mission.stamp_ns, mission.places.length_m, now_ns)
        inbox = self._replace(route_id=mission.route_id, is_after_end=is_after_end)
        if ended is not None and is_after_end:
            return inbox._following(Timetable.of(mission).ended(TripEnd(
                ended.ended_ns if ended.ended_ns <= now_ns else None, ended.is_observed)), not is_update)
        # A route without a route_id is never an update, unless it is the same message again.
        continues = is_update and timetable is not None and timetable.end is None and (
            mission.route_id != '' or mission.has_instants_of(timetable.planned))
        following = (timetable.updated(mission, now_ns) if timetable is not None and continues
                     else Timetable.of(mission, now_ns))
        if timetable is not None and timetable.end is None and timetable.mission.start_ns <= now_ns:
            following = following.on_the_way(now_ns)
        return inbox._with_choices(ended_trip=None)._following(
            following, not is_update or (ended is not None and ended.is_observed))

    def _with_revised(self, mission: Mission) -> tuple[Inbox, InvalidInput | None]:
        """Replace the current route by the same one under other parameters; drop it if it does not fit them."""
        try:
            self._check_mission(mission)
        except InvalidInput as error:
            return self._without_misfit(error, mission), error
        timetable, ended = self.timetable, self.choices.ended_trip
        if timetable is not None:
            inbox = self._following(timetable.revised(mission))._replace(refused_progress=self.refused_progress)
        else:
            # It was dropped, and with it its place.
            timetable = Timetable.of(mission)
            inbox = self._following(timetable if ended is None else timetable.ended(
                TripEnd(ended.ended_ns, ended.is_observed)))
        return inbox._replace(refusals=inbox.refusals.after_fit()), None

    def _without_misfit(self, error: InvalidInput, latest_mission: Mission | None) -> Inbox:
        """Drop the current route, which does not fit the parameters, but remember it as the latest."""
        return self._following(None)._replace(
            latest_mission=latest_mission, refusals=self.refusals.of_misfit(error))

    def _cancelled(self, now_ns: int) -> Inbox:
        """Drop the route at an instant [ns]: no heating until a new one arrives."""
        mission = self.latest_mission
        inbox = self if mission is None else self._with_choices(cancelled_trip=CancelledTrip(
            mission.route_id, mission.stamp_ns, now_ns))
        return inbox._dropped()

    def _dropped(self) -> Inbox:
        inbox = self._following(None, is_new_trip=True)
        return inbox._replace(is_cancelled=True, refusals=inbox.refusals.after_route())

    def _with_refused_route(self, error: InvalidInput, refused: events.RefusedRoute) -> Inbox:
        """Return the Inbox after a route was refused: 0 W, for a time that depends on its RefusedRoute."""
        refusals, may_continue = self.refusals.of_route(error, refused, self.mission, self.latest_ns)
        return (self if may_continue else self._following(None))._replace(refusals=refusals)

    def _check_mission(self, mission: Mission) -> None:
        check_mission(self.vehicle, mission, defaults_of(self.vehicle, self.settings).target_battery_temperature_c)

    def _following(self, timetable: Timetable | None, is_new_trip: bool = False) -> Inbox:
        mission = None if timetable is None else timetable.planned
        return self._replace(
            timetable=timetable, latest_mission=mission, refused_progress=None, is_cancelled=False,
            unit_warnings=() if mission is None else tuple(unit_warnings(
                (leg.route for leg in mission.legs), self.vehicle)),
            changes=replace(self.changes, has_new_mission=True,
                            has_new_trip=self.changes.has_new_trip or is_new_trip))


def _with_hint(error: InvalidInput, hint: str) -> InvalidInput:
    return InvalidInput([*error.problems, hint]) if hint else error
