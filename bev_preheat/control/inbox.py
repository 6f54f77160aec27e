# SPDX-License-Identifier: Apache-2.0
"""
The inbox: checks every input on arrival, stores the last valid one, and remembers refusals.

A refused input raises InvalidInput, and keeps the heater off as docs/explanation/safety.md describes. Instants are
integers, in nanoseconds of the node's clock.
"""

from dataclasses import dataclass, replace
import math

from bev_preheat.control.admitted import AdmittedInputs
from bev_preheat.control.events import (
    BatteryStateArrived,
    BatteryStateUnreadable,
    DeparturesSkipped,
    Event,
    PreheatingSwitched,
    ProgressArrived,
    ProgressUnreadable,
    Reconfigured,
    RivalsChanged,
    RouteArrived,
    RouteUnreadable,
    TripCancelled,
)
from bev_preheat.control.inputs import check_mission, goal_of_leg, Leg, Measurement, Mission, Progress
from bev_preheat.control.margins import CLOCK_RESTART_S, MOST_OVERTAKEN_S
from bev_preheat.control.refusals import PROGRESS, Refusals, RefusedRoute
from bev_preheat.control.settings import defaults_of, Settings
from bev_preheat.control.timetable import Timetable, TripEnd
from bev_preheat.errors import age_beyond, InvalidInput
from bev_preheat.estimation.driver_choices import CancelledTrip, DriverChoices, EndedTrip, NO_CHOICES
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.situation import check_situation, Goal
from bev_preheat.route.plausibility import unit_warnings
from bev_preheat.signals.electrical import ElectricalCheck, PercentScale
from bev_preheat.signals.source import is_one_battery, SeenState
from bev_preheat.signals.verdict import SignalVerdict, STATE_OF_CHARGE
from bev_preheat.vehicle.description import Vehicle


@dataclass(frozen=True)
class InputChanges:
    """
    Changes since the last `Inbox.take_changes`.

    `measurements` are the valid battery states, oldest first. `has_new_mission`: the route was
    replaced or dropped. `has_new_trip`: another trip began, or the trip was cancelled.
    `clock_restarted`: earlier stamps are void.
    """

    measurements: tuple[Measurement, ...] = ()
    has_new_mission: bool = False
    has_new_trip: bool = False
    clock_restarted: bool = False


NO_CHANGES = InputChanges()


class Inbox:
    """Keeps the last valid inputs; `vehicle`, `settings` and `rivals` may be set."""

    def __init__(self, vehicle: Vehicle, settings: Settings, choices: DriverChoices = NO_CHOICES) -> None:
        """Start without input, but with the DriverChoices from before a restart."""
        self.vehicle, self.settings, self.choices = vehicle, settings, choices
        # Cancelled before a restart: another node cancelled it, so its publisher may still latch it.
        self._cancelled_before = choices.cancelled_trip
        self.rivals = ''  # Names of other nodes that command the same heater.
        # Of the current route; None without one.
        self.timetable: Timetable | None = None
        # The sentence of the latest refused route progress; None after a valid one, or a route.
        self.refused_progress: str | None = None
        # The latest mission, including one dropped because it does not fit the parameters.
        self.latest_mission: Mission | None = None
        self.measurement: Measurement | None = None
        # Number of battery states dropped because a later one had arrived before them.
        self.overtaken_states = 0
        # Sentences on fields of the current route that look like wrong units.
        self.unit_warnings: tuple[str, ...] = ()
        self.is_cancelled = False  # By the latest route plan, or before a restart.
        # Of the latest valid route, even after it was dropped.
        self._route_id: str | None = None
        # Whether the latest route plan arrived after the end of its trip.
        self._is_after_end = False
        self._refusals = Refusals()
        self._percent_scale = PercentScale()
        # On a state of charge given in percent instead of 0 ... 1; None: no such doubt.
        self.scale_verdict: SignalVerdict | None = None
        # Of the latest battery state, or of an end before a restart: a clock before this instant was set back.
        self._latest_ns = 0 if choices.ended_trip is None else choices.ended_trip.ended_ns
        self._changes = NO_CHANGES

    @property
    def is_enabled(self) -> bool:
        """Whether the driver allows preheating."""
        return self.choices.switched_off_ns is None

    def switch(self, is_enabled: bool, now_ns: int) -> None:
        """Note that the driver allows preheating, or does not, at an instant [ns]."""
        self.choices = replace(self.choices, switched_off_ns=None if is_enabled else now_ns)

    @property
    def mission(self) -> Mission | None:
        """The current Mission with its delay (see timetable.Timetable); None without a route."""
        return None if self.timetable is None else self.timetable.mission

    def keep(self, timetable: Timetable | None) -> None:
        """Follow the route by a later value of its Timetable (None without one); remember the end of the trip."""
        before, self.timetable = self.timetable, timetable
        if timetable is None or timetable.end is None or (before is not None and before.end is not None):
            return
        planned, end = timetable.planned, timetable.end
        assert end.at_ns is not None
        self.choices = replace(self.choices, ended_trip=EndedTrip(
            planned.route_id, planned.stamp_ns, end.at_ns, end.is_observed))

    def note_other_goal(self) -> None:
        """Note that a preparation goal began or ended: heating so far does not count for the next trip."""
        self._changes = replace(self._changes, has_new_mission=True, has_new_trip=True)

    @property
    def refusal(self) -> str | None:
        """The sentence of the latest refusal that holds the heater off; None if none does."""
        return self._refusals.obstacle

    @property
    def refused_route(self) -> str | None:
        """The sentence of the latest route plan's refusal; None after a valid one."""
        return self._refusals.route

    def goal_of(self, leg: Leg) -> Goal:
        """Return the Goal of a leg; settings and vehicle complete it."""
        return goal_of_leg(leg, self.vehicle, self.settings)

    def admitted(self, preparation: Timetable | None = None, measurement: Measurement | None = None,
                 doubt: str | None = None) -> AdmittedInputs:
        """
        Return the AdmittedInputs of now.

        `preparation` is the Timetable of a preparation goal; None without one. `measurement` is the latest one
        with the signals that hold, `doubt` the sentence on those that do not.
        """
        return AdmittedInputs(
            self.vehicle, self.settings, self.is_enabled, self.rivals, self.refusal, self.is_cancelled,
            self.is_cancelled_before_restart, self.timetable, preparation or self.timetable,
            measurement, doubt)

    def take_changes(self) -> InputChanges:
        """Return the InputChanges since the last call."""
        changes, self._changes = self._changes, NO_CHANGES
        return changes

    def admit(self, event: Event, now_ns: int) -> None:
        """Take an event in at an instant [ns]; raise InvalidInput if it is refused."""
        match event:
            case BatteryStateArrived(measurement, hint):
                self._admit_battery(measurement, hint, now_ns)
            case BatteryStateUnreadable(error, percentage):
                self.refuse_battery(error, percentage, now_ns)
                raise error
            case RouteArrived(mission):
                self.accept_mission(mission, now_ns)
            case RouteUnreadable(error, refused):
                self.refuse_route(error, refused)
                raise error
            case TripCancelled():
                self.cancel(now_ns)
            case ProgressArrived(progress, hint):
                self._admit_progress(progress, hint, now_ns)
            case ProgressUnreadable(error):
                self.refuse_progress(error)
                raise error
            case PreheatingSwitched(is_enabled):
                self.switch(is_enabled, now_ns)
            case DeparturesSkipped(until_ns):
                self.choices = replace(self.choices, skipped_until_ns=until_ns)
            case RivalsChanged(names):
                self.rivals = names
            case Reconfigured():
                self._reconfigure(event)

    def _admit_battery(self, measurement: Measurement, hint: str, now_ns: int) -> None:
        try:
            self.accept_battery(measurement, now_ns)
        except InvalidInput as error:
            if not hint:
                raise
            hinted = InvalidInput([*error.problems, hint])
            self.refuse_battery(hinted, measurement.state.soc, now_ns)
            raise hinted from error

    def _admit_progress(self, progress: Progress, hint: str, now_ns: int) -> None:
        try:
            self.accept_progress(progress, now_ns)
        except InvalidInput as error:
            hinted = InvalidInput([*error.problems, *([hint] if hint else [])])
            self.refuse_progress(hinted)
            raise hinted from error

    def _reconfigure(self, event: Reconfigured) -> None:
        self.vehicle, self.settings = event.vehicle, event.settings
        if isinstance(event.mission, InvalidInput):
            self.drop_misfit(event.mission)
            raise event.mission
        if event.mission is not None:
            self.revise_mission(event.mission)

    # Battery states

    def accept_battery(self, measurement: Measurement, now_ns: int) -> None:
        """Store a Measurement, or refuse it and keep the previous one."""
        if now_ns < self._latest_ns - CLOCK_RESTART_S * NS_PER_S:
            self.measurement = None
            if self.timetable is not None:
                self.timetable = self.timetable.without_instants()
                if self._is_after_end:
                    # It arrived before this clock did, and may begin a trip by it.
                    self._begin_or_continue(self.timetable.planned, now_ns)
            self._changes = replace(self._changes, measurements=(), clock_restarted=True)
        self._latest_ns = now_ns
        try:
            self._check_content(measurement, now_ns)
            if self._is_overtaken(measurement, now_ns):
                self.overtaken_states += 1
                return
            self._check_stamp(measurement, now_ns)
            self._check_scale(measurement, now_ns)
        except InvalidInput as error:
            self.refuse_battery(error, measurement.state.soc, now_ns)
            raise
        measurement = self.measurement = replace(measurement, arrived_ns=now_ns)
        changes = self._changes
        self._changes = InputChanges((*changes.measurements, measurement), changes.has_new_mission,
                                     changes.has_new_trip, changes.clock_restarted)
        self._refusals.lift_by_battery()

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
        return 0.0 < late_s <= min(MOST_OVERTAKEN_S, timeout_s) or (
            0.0 < late_s and now_ns - measurement.stamp_ns <= timeout_s * NS_PER_S
            and is_one_battery(_seen(latest), _seen(measurement)))

    def refuse_battery(self, error: InvalidInput, percentage: float = math.nan, now_ns: int = 0) -> None:
        """
        Note that a battery state was refused: 0 W until a valid one arrives.

        `percentage` is that of the message, NaN: unknown, at `now_ns` [ns].
        """
        self._percent_scale.note_refused(now_ns / NS_PER_S, percentage)
        self._refusals.note_battery(error)

    def _check_content(self, measurement: Measurement, now_ns: int) -> None:
        if now_ns == 0:
            raise InvalidInput('use_sim_time is set and no /clock has arrived: time stands at 0')
        check_situation(self.vehicle, state=measurement.state)

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

    def _check_scale(self, measurement: Measurement, now_ns: int) -> None:
        scale_doubt = self._percent_scale.doubt(
            now_ns / NS_PER_S, measurement.state.soc, lambda: self._voltage_vouches_for(measurement))
        if scale_doubt:
            since_ns = now_ns if self.scale_verdict is None else self.scale_verdict.since_ns
            self.scale_verdict = SignalVerdict(STATE_OF_CHARGE, scale_doubt, since_ns)
            raise InvalidInput(scale_doubt)
        self.scale_verdict = None

    def _voltage_vouches_for(self, measurement: Measurement) -> bool:
        """Return whether the voltage fits the state of charge better than a hundredth of the reading."""
        state, voltage_v, current_a = measurement.state, measurement.voltage_v, measurement.current_a
        return voltage_v is not None and current_a is not None and ElectricalCheck(self.vehicle).is_nearer(
            voltage_v, current_a, state.temperature_c, state.soc, state.soc / 100.0)

    # Route progress: optional, so a refusal does not affect the heater

    def accept_progress(self, progress: Progress, now_ns: int) -> None:
        """Take a route progress in, or refuse it; it is ignored without a route."""
        if self.timetable is not None:
            self.timetable = self.timetable.at_progress(progress, now_ns, self.settings)
            self.refused_progress = None

    def refuse_progress(self, error: InvalidInput) -> None:
        """Note that a route progress was refused: the previous one holds until it is too old."""
        self.refused_progress = f'{PROGRESS} refused: {error}'

    # Routes

    def accept_mission(self, mission: Mission, now_ns: int = 0) -> None:
        """
        Replace the route by a Mission received at an instant [ns], or refuse it as `refuse_route` does.

        A route plan of a trip that has ended leaves it ended (see `estimation.driver_choices.EndedTrip`).
        """
        try:
            self._check_mission(mission)
        except InvalidInput as error:
            self.refuse_route(error, RefusedRoute.of_mission(mission))
            raise
        before = self._cancelled_before
        if before is not None and before.is_of(mission.route_id, mission.stamp_ns):
            self._drop_cancelled()
            return
        self._cancelled_before = None
        self.choices = replace(self.choices, cancelled_trip=None)
        self._begin_or_continue(mission, now_ns)
        self._refusals.lift_by_route()

    def _begin_or_continue(self, mission: Mission, now_ns: int) -> None:
        """Follow a valid Mission: another trip, or an update of the current trip or of an ended one."""
        timetable, ended = self.timetable, self.choices.ended_trip
        is_update = mission.route_id == self._route_id
        self._route_id = mission.route_id
        self._is_after_end = ended is not None and ended.includes(
            mission.route_id, mission.stamp_ns, mission.places.length_m, now_ns)
        if ended is not None and self._is_after_end:
            self._follow(Timetable.of(mission).ended(TripEnd(
                ended.ended_ns if ended.ended_ns <= now_ns else None, ended.is_observed)), not is_update)
            return
        self.choices = replace(self.choices, ended_trip=None)
        # A route without a route_id is never an update, unless it is the same message again.
        continues = is_update and timetable is not None and timetable.end is None and (
            mission.route_id != '' or mission.has_instants_of(timetable.planned))
        self._follow(timetable.updated(mission, now_ns) if timetable is not None and continues
                     else Timetable.of(mission), not is_update or (ended is not None and ended.is_observed))

    def revise_mission(self, mission: Mission) -> None:
        """
        Replace the current route by the same one under other parameters.

        If it does not fit them, it is dropped until it is revised again or a valid one arrives.
        """
        try:
            self._check_mission(mission)
        except InvalidInput as error:
            self.drop_misfit(error)
            self.latest_mission = mission
            raise
        timetable, refused_progress, ended = self.timetable, self.refused_progress, self.choices.ended_trip
        if timetable is not None:
            self._follow(timetable.revised(mission))
            self.refused_progress = refused_progress
        else:
            # It was dropped, and with it its place.
            timetable = Timetable.of(mission)
            self._follow(timetable if ended is None else timetable.ended(
                TripEnd(ended.ended_ns, ended.is_observed)))
        self._refusals.lift_misfit()

    def drop_misfit(self, error: InvalidInput) -> None:
        """Drop the current route, which does not fit the parameters, but remember it as the latest."""
        latest_mission = self.latest_mission
        self._follow(None)
        self.latest_mission = latest_mission
        self._refusals.note_misfit(error)

    def cancel(self, now_ns: int) -> None:
        """Drop the route at an instant [ns]: no heating until a new one arrives."""
        mission = self.latest_mission
        if mission is not None:
            self.choices = replace(self.choices, cancelled_trip=CancelledTrip(
                mission.route_id, mission.stamp_ns, now_ns))
        self._drop_cancelled()

    @property
    def is_cancelled_before_restart(self) -> bool:
        """Whether the latest route plan was cancelled before a restart."""
        return self.is_cancelled and self._cancelled_before is not None

    def _drop_cancelled(self) -> None:
        self._follow(None, is_new_trip=True)
        self.is_cancelled = True
        self._refusals.lift_by_route()

    def refuse_route(self, error: InvalidInput, refused: RefusedRoute = RefusedRoute()) -> None:
        """Note that a route was refused: 0 W, for a time that depends on its RefusedRoute."""
        if not self._refusals.note_route(error, refused, self.mission, self._latest_ns):
            self._follow(None)

    def _check_mission(self, mission: Mission) -> None:
        check_mission(self.vehicle, mission, defaults_of(self.vehicle, self.settings).target_battery_temperature_c)

    def _follow(self, timetable: Timetable | None, is_new_trip: bool = False) -> None:
        self.latest_mission = mission = None if timetable is None else timetable.planned
        self.unit_warnings = () if mission is None else tuple(unit_warnings(
            (leg.route for leg in mission.legs), self.vehicle))
        self.timetable = timetable
        self.refused_progress = None
        self.is_cancelled = False
        self._changes = replace(
            self._changes, has_new_mission=True,
            has_new_trip=self._changes.has_new_trip or is_new_trip)


def _seen(measurement: Measurement) -> SeenState:
    """Return a Measurement as signals.source compares it."""
    state = measurement.state
    return SeenState(measurement.stamp_ns / NS_PER_S, state.temperature_c, state.soc, measurement.voltage_v,
                     measurement.serial_number or measurement.location)
