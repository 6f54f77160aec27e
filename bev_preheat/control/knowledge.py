# SPDX-License-Identifier: Apache-2.0
"""
Knowledge of the regime, of the valid signals, and of the car as learned from them.

`Knowledge.seen` takes each valid battery state before it is learned from and planned with; no later stage uses a
refuted signal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.control.expected_drive import driven_at, intervals_between, planned_around
from bev_preheat.control.regime import Evidence, Regime, RegimeReport, RegimeWatch
from bev_preheat.estimation.before_restart import LastSeen
from bev_preheat.estimation.current_check import CurrentSample, CurrentScale, CurrentSign, Sign
from bev_preheat.estimation.estimator import Estimator
from bev_preheat.estimation.prior import after_soak, Soak
from bev_preheat.estimation.readings import Resolution, SOC_STEPS
from bev_preheat.estimation.signal_checks import (
    CURRENT,
    Doubts,
    electrical_check,
    FEED,
    FeedWatch,
    SOURCE,
    SourceWatch,
    STATE_OF_CHARGE,
    TEMPERATURE,
    VOLTAGE,
)
from bev_preheat.estimation.temperature_check import TemperatureCheck
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.tunables import (
    ARRIVES_AFTER_S,
    CONTRADICTS_BEYOND_K,
    LEAST_COURSE_S,
    LONGEST_GAP_S,
    MOST_NOTED,
    NEAR_END_S,
    NEAR_END_SHARE,
    NEAR_START_SHARE,
    NOTED_EVERY_S,
    PARKED_WITHIN_S,
    SIGNAL_DOUBT_SHOWN_S,
    TOLD_FROM,
    TRIED_OFF_S,
    UNPLUGGED_AFTER_S,
)
from bev_preheat.vehicle.description import HVCH

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from bev_preheat.control.heater import SourcePowers
    from bev_preheat.control.inputs import Measurement, Mission
    from bev_preheat.control.obstacle import AdmittedInputs
    from bev_preheat.control.settings import Settings
    from bev_preheat.control.timetable import Timetable
    from bev_preheat.estimation.hypotheses import HeaterReport
    from bev_preheat.estimation.prior import Learned
    from bev_preheat.estimation.signal_checks import SignalVerdict
    from bev_preheat.vehicle.description import Vehicle


class Known(NamedTuple):
    """
    A Measurement with the signals that hold; the others are None in it.

    `timetable` is that of the route, with its place at that instant; None without a route. `command_w` [W] is the
    power of the heat sources at its instant, `heat_w` their heat as HVCH power. `is_described`: the model
    describes this instant, so it may be learned from; `is_open`: that is not known yet. `trusts_temperature`,
    `trusts_soc`: these readings hold.
    """

    measurement: Measurement
    timetable: Timetable | None
    command_w: float
    heat_w: float
    is_described: bool
    is_open: bool
    trusts_temperature: bool
    trusts_soc: bool


class Knowledge(NamedTuple):
    """
    The regime and the signals of one vehicle.

    A current is known once `has_seen_current`: a field that has always been 0 is not filled. `soc_steps` are those
    of the states of charge with a current. `charged_ns` [ns] is the instant at which the vehicle was charged last,
    on the way; None: it has driven since.
    """

    feed: FeedWatch = FeedWatch()
    source: SourceWatch = SourceWatch()
    has_seen_current: bool = False
    soc_steps: Resolution = Resolution(SOC_STEPS)
    sign: CurrentSign = CurrentSign()
    scale: CurrentScale = CurrentScale()
    temperature: TemperatureCheck = TemperatureCheck()
    regimes: RegimeWatch = RegimeWatch()
    charged_ns: int | None = None
    doubts: Doubts = Doubts()

    @property
    def regime(self) -> RegimeReport:
        """The current RegimeReport."""
        return self.regimes.report

    @property
    def verdicts(self) -> tuple[SignalVerdict, ...]:
        """The SignalVerdicts that hold; () while every signal does."""
        return self.doubts.verdicts

    @property
    def obstacle(self) -> str | None:
        """The sentence on signals without which nothing is heated; None if they hold."""
        sentences = [verdict.sentence for verdict in self.doubts.needed]
        return f'Signal in doubt: {"; ".join(sentences)}.' if sentences else None

    def without_instants(self) -> Knowledge:
        """Return the Knowledge without instants, because the clock was restarted; the current's sign stays."""
        return self._replace(
            feed=self.feed.without_instants(), source=self.source.without_instants(),
            sign=self.sign.without_instants(), scale=self.scale.without_instants(),
            temperature=self.temperature.without_instants(), regimes=RegimeWatch(), charged_ns=None,
            doubts=self.doubts.without_instants())

    def seen(self, measurement: Measurement, inputs: AdmittedInputs,
             powers: SourcePowers) -> tuple[Knowledge, Known]:
        """Return the Knowledge after a valid Measurement, and the Known on the timetables of AdmittedInputs."""
        stamp_ns, settings, vehicle = measurement.stamp_ns, inputs.settings, inputs.vehicle
        timetable, active = inputs.timetable, inputs.active_timetable
        command_w = powers.drawn_w(stamp_ns)
        feed = self.feed.seen(stamp_ns / NS_PER_S)
        knowledge, doubts, seen = self._screened(measurement, vehicle, self.doubts.noted(
            FEED, feed.doubt(settings.battery_state_timeout_s), stamp_ns))
        planned = planned_around(active, stamp_ns, inputs.defaults)
        has_moved = None if timetable is None else timetable.has_moved(stamp_ns, settings)
        regimes = self.regimes.seen(Evidence(
            stamp_ns, seen.power_w, command_w, planned, measurement.supply_status, has_moved,
            0.0 if timetable is None or has_moved is None else timetable.stood_ns / NS_PER_S,
            knowledge.sign.sign is Sign.RIGHT))
        report, is_one_battery = regimes.report, SOURCE not in doubts
        kept = None if timetable is None else self._kept(timetable, report, stamp_ns, settings)
        charged_ns = self.charged_ns
        if timetable is not None:
            charged_ns = (stamp_ns if report.regime is Regime.CHARGING else
                          charged_ns if report.regime is Regime.STANDING else None)
        drive = driven_at(vehicle, kept if active is timetable else active, stamp_ns)
        heat_w = powers.heat_w(stamp_ns, powers.temperature_c if drive is None else drive.ambient_temperature_c)
        temperature = self.temperature.seen(seen, drive if is_one_battery else None, heat_w, vehicle)
        doubts = doubts.noted(TEMPERATURE, temperature.stuck.doubt, stamp_ns)
        is_described = (
            drive is not None and report.regime not in (Regime.CHARGING, Regime.STANDING)
            and not report.suspicion and not doubts.needed)
        return knowledge._replace(
            feed=feed, temperature=temperature, regimes=regimes, charged_ns=charged_ns, doubts=doubts,
        ), Known(seen, kept, command_w, heat_w, is_described, is_described and report.is_doubtful,
                 TEMPERATURE not in doubts and is_one_battery, STATE_OF_CHARGE not in doubts and is_one_battery)

    def _kept(self, timetable: Timetable, report: RegimeReport, now_ns: int, settings: Settings) -> Timetable:
        """Return a Timetable with the place at an instant [ns]; a recent position outranks the battery's power."""
        is_charged = report.regime is Regime.CHARGING
        is_at_rest = is_charged or report.regime is Regime.STANDING
        if timetable.end is not None:
            return timetable
        if timetable.has_position(now_ns, settings):
            return timetable.arrived(report.since_ns, True) if (
                is_at_rest and timetable.is_at_end_of_leg(now_ns)) else timetable
        if not is_at_rest:
            if self.charged_ns is not None and now_ns - self.charged_ns <= UNPLUGGED_AFTER_S * NS_PER_S:
                return timetable.driven_all_along()
            return timetable.driving() if report.regime is Regime.DRIVING else timetable.released()
        leg = timetable.mission.legs[timetable.mission.leg_number(now_ns)]
        left_s, whole_s = -leg.ended_for_s(now_ns), leg.route.total_duration_s
        near_s = min(max(NEAR_END_S, NEAR_END_SHARE * whole_s), (1.0 - NEAR_START_SHARE) * whole_s)
        if (is_charged and leg.charging_planned and 0.0 < left_s <= near_s
                and now_ns - report.since_ns >= ARRIVES_AFTER_S * NS_PER_S):
            return timetable.arrived(report.since_ns, False)
        return timetable.standing(report.since_ns, report.recognised_ns, now_ns, is_charged)

    def _screened(self, measurement: Measurement, vehicle: Vehicle,
                  doubts: Doubts) -> tuple[Knowledge, Doubts, Measurement]:
        """Return the Knowledge of source and current, the Doubts, and the Measurement without signals in doubt."""
        state, now_ns = measurement.state, measurement.stamp_ns
        instant_s, voltage_v, current_a = now_ns / NS_PER_S, measurement.voltage_v, measurement.current_a
        source = self.source.seen(measurement.seen)
        doubts = doubts.noted(SOURCE, source.doubt, now_ns)
        without = replace(measurement, voltage_v=None, current_a=None)
        if voltage_v is None or current_a is None or (current_a == 0.0 and not self.has_seen_current):
            return self._replace(source=source), doubts.noted(STATE_OF_CHARGE, '', now_ns).at(now_ns), without
        check, at = electrical_check(vehicle), (voltage_v, current_a, state.temperature_c, state.soc)
        charge_doubt = check.charge_doubt(*at)
        doubts = doubts.noted(STATE_OF_CHARGE, charge_doubt, now_ns)
        voltage_doubt = '' if charge_doubt else check.voltage_doubt(*at)
        shown_until_ns = now_ns + round(SIGNAL_DOUBT_SHOWN_S * NS_PER_S)
        if voltage_doubt:
            doubts = doubts.noted(VOLTAGE, voltage_doubt, now_ns, shown_until_ns)
        if voltage_doubt or SOURCE in doubts:
            return self._replace(source=source, has_seen_current=True), doubts.at(now_ns), without
        soc_steps = self.soc_steps.seen(state.soc)
        sample = CurrentSample(instant_s, voltage_v, current_a, state.soc)
        sign = self.sign.seen(sample, soc_steps.step, vehicle.battery.capacity_as)
        scale = self.scale.seen(sample, soc_steps.step, vehicle.battery.capacity_as)
        current_doubt = scale.doubt if sign.sign is not Sign.REVERSED else (
            f'current: its sign is reversed: {sign.evidence}; battery_state.current is negative while '
            'the battery is discharged; voltage and current are not used')
        if current_doubt:
            doubts = doubts.noted(CURRENT, current_doubt, now_ns, shown_until_ns)
        return self._replace(
            source=source, has_seen_current=True, soc_steps=soc_steps, sign=sign, scale=scale,
        ), doubts.at(now_ns), without if current_doubt else measurement


class StandReport(NamedTuple):
    """A temperature [deg C] read after `stood_s` [s] at `ambient_c` [deg C], and the Soak."""

    reading_c: float
    stood_s: float
    ambient_c: float
    standing: Soak

    @property
    def contradiction(self) -> str:
        """The sentence on a sensor that contradicts the standing time; '' without a contradiction."""
        expected_c = self.standing.temperature_c
        allowed_k = CONTRADICTS_BEYOND_K + self.standing.left_deviation_k
        difference_k = self.reading_c - expected_c
        if abs(difference_k) <= allowed_k:
            return ''
        direction = 'warmer' if difference_k > 0.0 else 'colder'
        return (f'battery_state.temperature was {self.reading_c:.1f} degC after '
                f'{duration_text(self.stood_s)} of standing at {self.ambient_c:.1f} degC: '
                f'{abs(difference_k):.1f} K {direction} than the {expected_c:.1f} degC expected, '
                f'{allowed_k:.1f} K are allowed; check the sensor, and standing_time of route_plan')


class StandWatch(NamedTuple):
    """
    Temperatures before each trip; `report` is the StandReport of the current trip.

    `history` are LastSeens of the last days, in order, and `latest` is the latest one; `history` may begin with
    the one before a restart. `is_done`: the first battery state of the trip with `route_id` was compared.
    """

    history: tuple[LastSeen, ...] = ()
    latest: LastSeen | None = None
    route_id: str | None = None
    is_done: bool = False
    report: StandReport | None = None

    def noted(self, seen: LastSeen) -> StandWatch:
        """Return the watch after a LastSeen, later than those before: the vehicle may be parked then."""
        history, latest = self.history, self.latest
        if latest is not None and (
                seen.stamp_ns < latest.stamp_ns or seen.stamp_ns - latest.stamp_ns > LONGEST_GAP_S * NS_PER_S):
            history = (*history, latest)
        if history and seen.stamp_ns < history[-1].stamp_ns:
            # The clock was set back.
            history = ()
        if not history or seen.stamp_ns - history[-1].stamp_ns >= NOTED_EVERY_S * NS_PER_S:
            history = (*history, seen)
        return self._replace(history=history[-MOST_NOTED:], latest=seen)

    def _parked(self, parked_ns: int) -> LastSeen | None:
        """Return the latest LastSeen of about the instant [ns] at which the vehicle was parked; None: unknown."""
        return next((seen for seen in reversed(self.history)
                     if abs(seen.stamp_ns - parked_ns) <= PARKED_WITHIN_S * NS_PER_S), None)

    def compared(self, mission: Mission | None, measurement: Measurement,
                 vehicle: Vehicle) -> tuple[StandWatch, Soak | None]:
        """Return the watch after a Measurement, and the Soak before it, at most once a trip; None: no soak."""
        route_id = None if mission is None else mission.route_id
        watch = self if route_id == self.route_id else self._replace(
            route_id=route_id, is_done=False, report=None)
        if mission is None or watch.is_done:
            return watch, None
        since_start_s = (measurement.stamp_ns - mission.start_ns) / NS_PER_S
        if since_start_s > LONGEST_GAP_S:
            return watch._replace(is_done=True), None
        stood_s = mission.standing_time_s + min(since_start_s, 0.0)
        if mission.standing_time_s == 0.0 or stood_s <= 0.0:
            return watch, None
        ambient_c = float(mission.legs[0].route.ambient_temperature_c[0])
        parked = self._parked(measurement.stamp_ns - round(stood_s * NS_PER_S))
        parked_c = None
        if parked is not None:
            stood_s, parked_c = (measurement.stamp_ns - parked.stamp_ns) / NS_PER_S, parked.temperature_c
        standing = after_soak(vehicle, ambient_c, stood_s, parked_c)
        return watch._replace(is_done=True, report=StandReport(
            measurement.state.temperature_c, stood_s, ambient_c, standing)), standing


class SourceTrial(NamedTuple):
    """
    Switches sources off by turns while all heat and the faulty one is unknown: `name`, '' without a trial.

    `suspect_ns` [ns] is the instant since which a fault is certain that no source is named for, `since_ns` that of
    the latest beginning; None: none.
    """

    name: str = ''
    since_ns: int | None = None
    suspect_ns: int | None = None

    def at(self, now_ns: int, odds: Mapping[str, float], is_told: bool) -> SourceTrial:
        """Return the trial at an instant [ns] with odds of a fault by source; `is_told`: one is named."""
        if is_told or sum(odds.values()) < TOLD_FROM / (1.0 - TOLD_FROM):
            is_on = self.name and not is_told and self._lasts(self.since_ns, now_ns, TRIED_OFF_S)
            return self if is_on else SourceTrial()
        if self.suspect_ns is None or now_ns < self.suspect_ns:
            return SourceTrial(suspect_ns=now_ns)
        if self._lasts(self.suspect_ns, now_ns, LEAST_COURSE_S) or self._lasts(self.since_ns, now_ns, TRIED_OFF_S):
            return self
        others = [name for name in odds if name not in (HVCH, self.name)] or [self.name]
        return self._replace(name=max(others, key=odds.__getitem__), since_ns=now_ns)

    @staticmethod
    def _lasts(since_ns: int | None, now_ns: int, for_s: float) -> bool:
        return since_ns is not None and 0 <= now_ns - since_ns < for_s * NS_PER_S


NO_TRIAL = SourceTrial()


@dataclass(frozen=True, eq=False)
class Learning:
    """
    The Estimator of a vehicle, and the watch over the first battery state of each trip; a value.

    `others` are name and Estimator of the other heat sources that heat; each takes the rest of the car as it is
    known, and judges its own source. `trial` tells them apart.
    """

    estimator: Estimator
    stand_watch: StandWatch
    others: tuple[tuple[str, Estimator], ...] = ()
    trial: SourceTrial = NO_TRIAL

    @classmethod
    def begun(cls, vehicle: Vehicle, learned: Learned | None = None,
              last_seen: LastSeen | None = None) -> Learning:
        """Return the Learning of a vehicle file, or of the Learned of earlier drives, and of the LastSeen."""
        return cls(Estimator.of(vehicle, learned), StandWatch(() if last_seen is None else (last_seen,)), tuple(
            (source.name, Estimator.of(vehicle, learned)) for source in vehicle.heat_sources if not source.cools))

    @property
    def reports(self) -> dict[str, HeaterReport]:
        """The reports on all heat sources by name, as far as there are any."""
        return {name: each.estimate.heater for name, each in ((HVCH, self.estimator), *self.others)
                if each.estimate is not None}

    @property
    def shares(self) -> dict[str, float]:
        """The shares of their commands that the sources deliver, by name; 1 is left out."""
        return {name: report.share for name, report in self.reports.items() if report.share < 1.0}

    def learned(self, vehicle: Vehicle, known: Known, timetable: Timetable | None, powers: SourcePowers,
                trip: Mission | None) -> Learning:
        """
        Return the Learning after a Known measurement, on a Timetable's mission and under SourcePowers.

        `trip` is the Mission of the route plan, before which the vehicle may have stood.
        """
        measurement, stand_watch, standing = known.measurement, self.stand_watch, None
        if known.trusts_temperature:
            stand_watch, standing = stand_watch.compared(trip, measurement, vehicle)
        learning = replace(self, stand_watch=stand_watch)
        if standing is not None:
            soak = standing
            learning = learning._each(lambda estimator: estimator.after_soak(soak))
        if known.is_open:
            # The next state that is clear is compared with the latest one before this.
            return learning
        if timetable is not None and timetable.mission.legs[0].terms.is_from_grid:
            # Then the battery's power does not show the heater's.
            measurement = replace(measurement, voltage_v=None, current_a=None)
        odds = learning._odds()
        numbers = {HVCH: 0, **{source.name: number for number, source in enumerate(vehicle.heat_sources, 1)}}

        def after(estimator: Estimator, name: str) -> Estimator:
            if not known.is_described:
                return estimator.held(
                    measurement, vehicle, known.heat_w, known.trusts_temperature, known.trusts_soc)
            return estimator.observed(measurement, intervals_between(
                estimator.edges_ns(measurement.stamp_ns), vehicle, timetable, powers, numbers[name]), vehicle, sum(
                    value for other, value in odds.items() if other != name))

        learning = replace(learning, estimator=after(learning.estimator, HVCH), others=tuple(
            (name, after(estimator, name)) for name, estimator in learning.others))
        # The faulty source explains what other sources were suspected of.
        if learning.others and learning.shares != self.shares:
            learning = replace(learning, estimator=learning.estimator.without_suspicion(), others=tuple(
                (name, estimator.without_suspicion()) for name, estimator in learning.others))
        if learning.others and known.is_described:
            learning = replace(learning, trial=learning.trial.at(
                measurement.stamp_ns, learning._odds(), is_told=bool(learning.shares)))
        estimate = learning.estimator.estimate
        if estimate is None:
            return learning
        return replace(learning, stand_watch=stand_watch.noted(
            LastSeen(estimate.temperature_c, estimate.soc, estimate.stamp_ns)))

    def _odds(self) -> dict[str, float]:
        """Return the odds of a fault of each source by name; {} with the HVCH alone."""
        return {name: estimator.fault_odds for name, estimator in (
            (HVCH, self.estimator), *self.others)} if self.others else {}

    def _each(self, change: Callable[[Estimator], Estimator]) -> Learning:
        """Return the Learning with a change of each Estimator."""
        return replace(self, estimator=change(self.estimator), others=tuple(
            (name, change(estimator)) for name, estimator in self.others))

    def on_new_trip(self) -> Learning:
        """Return the Learning without the consumption of the route before: another trip begins."""
        return self._each(Estimator.of_another_route)

    def with_acquitted_heater(self, name: str = HVCH) -> Learning:
        """Return the Learning of a healthy heat source: the power with which it was compared is refuted."""
        return replace(self, estimator=self.estimator.of_healthy_heater() if name == HVCH else self.estimator,
                       others=tuple((each, estimator.of_healthy_heater() if each == name else estimator)
                                    for each, estimator in self.others))

    def without_instants(self) -> Learning:
        """Return the Learning without instants, because the clock was restarted."""
        return self._each(Estimator.without_instants)
