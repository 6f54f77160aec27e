# SPDX-License-Identifier: Apache-2.0
"""Learning of the car from battery states: estimators of its heat sources, and its sensor after a stand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from typing import NamedTuple

from bev_preheat.control.decision import Moment
from bev_preheat.control.expected_drive import driven_at, intervals_between
from bev_preheat.control.heater import SourcePowers
from bev_preheat.control.inputs import Measurement, Mission
from bev_preheat.control.knowledge import Known
from bev_preheat.estimation.before_restart import LastSeen
from bev_preheat.estimation.estimate import Estimate
from bev_preheat.estimation.estimator import Estimator
from bev_preheat.estimation.hypotheses import Heater, HeaterReport
from bev_preheat.estimation.prior import after_soak, Learned, Soak
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.tunables import (
    CONTRADICTS_BEYOND_K,
    ESTIMATORS_EVERY_S,
    ESTIMATORS_KEPT,
    LEAST_COURSE_S,
    LONGEST_GAP_S,
    LONGEST_STAND_S,
    MOST_NOTED,
    NAMED_FROM,
    NOTED_EVERY_S,
    PARKED_WITHIN_S,
    TRIED_FROM,
    TRIED_OFF_K,
    UNHEATED_S,
)
from bev_preheat.vehicle.description import HVCH, Vehicle
from bev_preheat.vehicle.variants import DriveInputs


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
        stood_s = min(mission.standing_time_s, LONGEST_STAND_S) + min(since_start_s, 0.0)
        if mission.standing_time_s == 0.0 or stood_s <= 0.0:
            return watch, None
        ambient_c = float(mission.legs[0].route.ambient_temperature_c[0])
        parked_ns, parked_c = measurement.stamp_ns - round(stood_s * NS_PER_S), None
        parked = next((seen for seen in reversed(self.history)
                       if abs(seen.stamp_ns - parked_ns) <= PARKED_WITHIN_S * NS_PER_S), None)
        if parked is not None:
            stood_s, parked_c = (measurement.stamp_ns - parked.stamp_ns) / NS_PER_S, parked.temperature_c
        standing = after_soak(vehicle, ambient_c, stood_s, parked_c)
        return watch._replace(is_done=True, report=StandReport(
            measurement.state.temperature_c, stood_s, ambient_c, standing)), standing


class SourceTrial(NamedTuple):
    """
    Switches a source off for a while, again and again, while it may well be weak: `name`, '' without a trial.

    `suspect_ns` [ns] is the instant since which one may be, `until_ns` the end of the latest turn.
    """

    name: str = ''
    suspect_ns: int | None = None
    until_ns: int = 0

    def at(self, now_ns: int, odds: Mapping[str, float], is_named: bool,
           heats_k_per_s: Mapping[str, float]) -> SourceTrial:
        """
        Return the trial at an instant [ns] with odds of a fault by source; `is_named`: the faulty one is known.

        `heats_k_per_s` is by how much each source that may be tried warms or cools the battery now [K/s].
        """
        suspects = [name for name, each in odds.items()
                    if name in heats_k_per_s and each > TRIED_FROM / (1.0 - TRIED_FROM)]
        if is_named or (now_ns >= self.until_ns and not suspects):
            return NO_TRIAL
        if self.suspect_ns is None or now_ns < self.suspect_ns:
            return SourceTrial(suspect_ns=now_ns)
        if now_ns < max(self.until_ns, self.suspect_ns + LEAST_COURSE_S * NS_PER_S):
            return self
        # After a turn the source gives no heat yet: it heats for a while before its next turn.
        lasts_s = {name: TRIED_OFF_K / heats_k_per_s[name] for name in suspects
                   if heats_k_per_s[name] > TRIED_OFF_K / UNHEATED_S}
        name = max(lasts_s, key=odds.__getitem__, default='')
        return self._replace(name=name, until_ns=now_ns + round(lasts_s.get(name, LEAST_COURSE_S) * NS_PER_S))


NO_TRIAL = SourceTrial()


def heats_k_per_s(vehicle: Vehicle, powers: SourcePowers, drive: DriveInputs | None,
                  now_ns: int) -> dict[str, float]:
    """
    Return by how much each source beside the HVCH warms or cools the battery [K/s] at an instant [ns].

    0 if one source runs alone: no other could be the faulty one, and none makes up for it.
    """
    if drive is None:
        return {}
    are_several = sum(each.history.power_w(now_ns) > 0.0 for each in powers.each) > 1
    k_per_j = are_several * vehicle.hvch.efficiency / vehicle.pack_heat_capacity_j_per_k
    return {source.name: k_per_j * each.history.power_w(now_ns) * abs(
        each.hvch_watts(float(drive.ambient_temperature_c), powers.temperature_c))
        for source, each in zip(vehicle.heat_sources, powers.each[1:])}


@dataclass(frozen=True, eq=False)
class Learning:
    """
    The Estimators of a vehicle by heat source, the HVCH first, and the watch over each trip's first battery state.

    Each Estimator judges its own source, and takes the others and the rest of the car as they are known. `trial`
    tells the sources apart. `earlier` are the Estimators of every ESTIMATORS_EVERY_S, the latest last, while only
    the state of charge can show that the vehicle stands. A value.
    """

    estimators: Mapping[str, Estimator]
    stand_watch: StandWatch
    trial: SourceTrial = NO_TRIAL
    earlier: tuple[Mapping[str, Estimator], ...] = ()

    @classmethod
    def begun(cls, vehicle: Vehicle, learned: Learned | None = None,
              last_seen: LastSeen | None = None) -> Learning:
        """Return the Learning of a vehicle file, or of the Learned of earlier drives, and of the LastSeen."""
        return cls({HVCH: Estimator.of(vehicle, learned), **{
            source.name: Estimator.of(vehicle, learned, -1 if source.cools else 1)
            for source in vehicle.heat_sources}}, StandWatch(() if last_seen is None else (last_seen,)))

    @cached_property
    def estimate(self) -> Estimate | None:
        """
        The latest Estimate, None without one; its `heater` is the HVCH's report.

        As far as a fault of another source, not yet reported, explains the readings better, the battery is as that
        source's Estimator knows it.
        """
        own = self.estimators[HVCH]
        if own.estimate is None:
            return None
        suspects = [(own.odds_of(each), each.estimate) for name, each in self.estimators.items()
                    if name != HVCH and each.estimate is not None
                    and each.estimate.heater.heater is Heater.ANSWERS]
        return own.estimate.mixed_with(suspects, 1.0 + own.fault_odds)

    @property
    def reports(self) -> dict[str, HeaterReport]:
        """The reports on all heat sources by name, as far as there are any."""
        return {name: each.estimate.heater for name, each in self.estimators.items() if each.estimate is not None}

    @property
    def shares(self) -> dict[str, float]:
        """The shares of their commands that faulty sources deliver, by name; inf: stuck on."""
        return {name: inf if report.heater is Heater.STUCK_ON else report.share
                for name, report in self.reports.items() if report.heater is not Heater.ANSWERS}

    def learned(self, known: Known, moment: Moment, powers: SourcePowers) -> Learning:
        """Return the Learning after a Known measurement, at a Moment and under SourcePowers."""
        vehicle, timetable = moment.vehicle, moment.active_timetable
        measurement, stand_watch, standing = known.measurement, self.stand_watch, None
        if known.trusts_temperature:
            # The vehicle may have stood before the trip of the route plan.
            stand_watch, standing = stand_watch.compared(moment.mission, measurement, vehicle)
        learning = replace(self._without(known.wrong_since_ns), stand_watch=stand_watch)
        if standing is not None:
            soak = standing
            learning = learning._each(lambda estimator: estimator.after_soak(soak))
        if known.is_open:
            # The next state that is clear is compared with the latest one before this.
            return learning
        if timetable is not None and timetable.mission.legs[0].terms.is_from_grid:
            # Then the battery's power does not show the heater's.
            measurement = replace(measurement, voltage_v=None, current_a=None)
        before = learning.estimators

        def after(number: int, estimator: Estimator) -> Estimator:
            if not known.is_described:
                return estimator.held(
                    measurement, vehicle, known.heat_w, known.trusts_temperature, known.trusts_soc)
            return estimator.observed(measurement, intervals_between(
                estimator.edges_ns(measurement.stamp_ns), vehicle, timetable, powers, number), vehicle, sum(
                    estimator.odds_of(other) for other in before.values() if other is not estimator))

        learning = replace(learning, estimators={
            name: after(number, each) for number, (name, each) in enumerate(before.items())})
        has_others = len(before) > 1
        # The faulty source explains what other sources were suspected of.
        if has_others and learning.shares != self.shares:
            faulty = next((each for name, each in learning.estimators.items()
                           if learning.shares.get(name) not in (None, self.shares.get(name))), None)
            learning = learning._each(lambda estimator: estimator.with_car_of(faulty))
        if has_others and known.is_described:
            is_told = bool(learning.shares)
            # Switching a source off does not show that it is stuck on, nor how long it has been weak.
            is_named = is_told or any(
                report.probability < 1.0 - NAMED_FROM for report in learning.reports.values())
            learning = replace(learning, trial=learning.trial.at(measurement.stamp_ns, {
                name: each.weak_odds for name, each in learning.estimators.items()}, is_named, heats_k_per_s(
                    vehicle, powers, driven_at(vehicle, timetable, measurement.stamp_ns), measurement.stamp_ns)))
            if is_told or sum(each.fault_odds for each in learning.estimators.values()) < 1.0:
                learning = learning._each(Estimator.compared_anew)
        estimate = learning.estimate
        if estimate is None:
            return learning
        if known.is_described:
            learning = replace(learning, earlier=()) if measurement.power_w is not None else (
                learning._kept(estimate.stamp_ns))
        return replace(learning, stand_watch=stand_watch.noted(
            LastSeen(estimate.temperature_c, estimate.soc, estimate.stamp_ns)))

    def _kept(self, stamp_ns: int) -> Learning:
        """Return the Learning that keeps its estimators of an instant [ns], if it is time."""
        kept = self.earlier
        if kept and 0 <= stamp_ns - (kept[-1][HVCH].stamp_ns or 0) < ESTIMATORS_EVERY_S * NS_PER_S:
            return self
        return replace(self, earlier=(*kept, self.estimators)[-ESTIMATORS_KEPT:])

    def _without(self, since_ns: int | None) -> Learning:
        """Return the Learning without the values learned since an instant [ns]; None: with all."""
        if since_ns is None:
            return self
        then = next((each for each in reversed(self.earlier) if (each[HVCH].stamp_ns or 0) <= since_ns),
                    self.estimators)
        return replace(self, earlier=(), estimators={
            name: each.with_learned_of(then[name]) for name, each in self.estimators.items()})

    def _each(self, change: Callable[[Estimator], Estimator]) -> Learning:
        """Return the Learning with a change of each Estimator."""
        return replace(self, estimators={name: change(each) for name, each in self.estimators.items()})

    def on_new_trip(self) -> Learning:
        """Return the Learning without the consumption of the route before: another trip begins."""
        return self._each(Estimator.of_another_route)

    def with_acquitted_heater(self, name: str) -> Learning:
        """Return the Learning of a healthy heat source: the power with which it was compared is refuted."""
        return replace(self, estimators={**self.estimators, name: self.estimators[name].of_healthy_heater()})

    def without_instants(self) -> Learning:
        """Return the Learning without instants, because the clock was restarted."""
        return self._each(Estimator.without_instants)
