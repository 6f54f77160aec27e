# SPDX-License-Identifier: Apache-2.0
"""
Regime of the vehicle, valid signals, and their say on the trip: it stands, goes on, has arrived at a charger.

`Knowledge.seen` takes each valid battery state before it is learned from and planned with; no later stage uses a
refuted signal.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

from bev_preheat.control.decision import Moment
from bev_preheat.control.expected_drive import driven_at, planned_around
from bev_preheat.control.heater import SourcePowers
from bev_preheat.control.inputs import Measurement, SupplyStatus
from bev_preheat.control.regime import Evidence, Regime, RegimeReport, RegimeWatch
from bev_preheat.control.settings import Settings
from bev_preheat.control.timetable import Timetable
from bev_preheat.estimation.current_check import CurrentSample, CurrentScale, CurrentSign, Sign
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
from bev_preheat.numerics import JOULES_PER_WH, NS_PER_S, WH_PER_KWH
from bev_preheat.tunables import (
    ARRIVES_AFTER_S,
    NEAR_END_S,
    NEAR_END_SHARE,
    NEAR_START_SHARE,
    SIGNAL_DOUBT_SHOWN_S,
    UNPLUGGED_AFTER_S,
    ZERO_AFTER_S,
)
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.plausibility import energy_between_kwh


class Known(NamedTuple):
    """
    A Measurement with the signals that hold; the others are None in it.

    `timetable` is that of the route, with its place at that instant; None without a route. `command_w` [W] is the
    power of the heat sources at its instant, `heat_w` their heat as HVCH power. `is_described`: the model
    describes this instant, so it may be learned from; `is_open`: that is not known yet. `trusts_temperature`,
    `trusts_soc`: these readings hold. `wrong_since_ns` [ns] is the instant since which the model has not described
    the vehicle, as is only seen now; None: learned values hold.
    """

    measurement: Measurement
    timetable: Timetable | None
    command_w: float
    heat_w: float
    is_described: bool
    is_open: bool
    trusts_temperature: bool
    trusts_soc: bool
    wrong_since_ns: int | None = None


class Knowledge(NamedTuple):
    """
    The regime and the signals of one vehicle.

    A current was seen last at `current_ns` [ns], None: never; a field that is 0 always, or between currents, is
    not filled. `soc_steps` are those of states of charge with a current. `charged_ns` [ns] is the instant at which
    the vehicle was charged last, on the way; None: it has driven since.
    """

    feed: FeedWatch = FeedWatch()
    source: SourceWatch = SourceWatch()
    current_ns: int | None = None
    soc_steps: Resolution = Resolution(SOC_STEPS)
    sign: CurrentSign = CurrentSign()
    scale: CurrentScale = CurrentScale()
    temperature: TemperatureCheck = TemperatureCheck()
    regimes: RegimeWatch = RegimeWatch()
    charged_ns: int | None = None
    doubts: Doubts = Doubts()

    @property
    def obstacle(self) -> str | None:
        """The sentence on signals without which nothing is heated; None if they hold."""
        sentences = [verdict.sentence for verdict in self.doubts.needed]
        return f'Signal in doubt: {"; ".join(sentences)}.' if sentences else None

    def without_instants(self) -> Knowledge:
        """Return the Knowledge without instants, because the clock was restarted; the current's sign stays."""
        return self._replace(
            feed=self.feed.without_instants(), source=self.source.without_instants(),
            current_ns=None if self.current_ns is None else 0,
            sign=self.sign.without_instants(), scale=self.scale.without_instants(),
            temperature=self.temperature.without_instants(), regimes=RegimeWatch(), charged_ns=None,
            doubts=self.doubts.without_instants())

    def seen(self, measurement: Measurement, moment: Moment,
             powers: SourcePowers) -> tuple[Knowledge, Known]:
        """Return the Knowledge after a valid Measurement, and the Known on the timetables of Moment."""
        stamp_ns, settings, vehicle = measurement.stamp_ns, moment.settings, moment.vehicle
        timetable, active = moment.timetable, moment.active_timetable
        command_w = powers.drawn_w(stamp_ns)
        knowledge, doubts, seen = self._screened(measurement, vehicle, self.doubts)
        planned = planned_around(active, stamp_ns, moment.defaults)
        has_moved = None if timetable is None else timetable.has_moved(stamp_ns, settings)
        evidence = Evidence(
            stamp_ns, seen.power_w, command_w, planned, measurement.supply_status, has_moved,
            0.0 if timetable is None or has_moved is None else timetable.stood_ns / NS_PER_S,
            knowledge.sign.sign is Sign.RIGHT,
            None if STATE_OF_CHARGE in doubts or knowledge.scale.doubt else seen.state.soc,
            _full_j(vehicle))
        regimes = self.regimes.seen(evidence)
        state = measurement.state
        feed = self.feed.seen(stamp_ns / NS_PER_S, (
            state.temperature_c, state.soc, measurement.voltage_v, measurement.current_a))
        doubts = doubts.noted(FEED, feed.doubt(
            settings.battery_state_timeout_s, regimes.has_driven(evidence)), stamp_ns)
        if timetable is not None and regimes.is_position_frozen(evidence):
            timetable = timetable.without_frozen_position()
        report, is_one_battery = regimes.report, SOURCE not in doubts
        kept = None if timetable is None else self._kept(
            timetable, report, stamp_ns, settings, regimes.course.driven_since_ns())
        charged_ns = self.charged_ns
        if timetable is not None:
            # A charge that has risen is no descent.
            is_brief = seen.power_w is not None or measurement.supply_status is SupplyStatus.CHARGING
            charged_ns = (stamp_ns if report.regime is Regime.CHARGING and is_brief else
                          charged_ns if report.regime is Regime.STANDING else None)
        drive = driven_at(vehicle, kept if active is timetable else active, stamp_ns)
        heat_w = powers.heat_w(stamp_ns, powers.temperature_c if drive is None else drive.ambient_temperature_c)
        temperature = self.temperature.seen(
            seen, drive if is_one_battery else None, command_w, heat_w, vehicle, report.is_at_rest)
        doubts = doubts.noted(TEMPERATURE, temperature.stuck.doubt, stamp_ns)
        is_described = (
            drive is not None and not report.is_at_rest and not report.suspicion and not doubts.needed)
        return knowledge._replace(
            feed=feed, temperature=temperature, regimes=regimes, charged_ns=charged_ns, doubts=doubts,
        ), Known(seen, kept, command_w, heat_w, is_described, is_described and (
            # It stands, or its position comes in long steps.
            report.is_doubtful or (has_moved is False and seen.power_w is None)),
                 TEMPERATURE not in doubts and is_one_battery, STATE_OF_CHARGE not in doubts and is_one_battery,
                 report.since_ns if has_moved is None and regimes.has_seen_late(self.regimes) else None)

    def _kept(self, timetable: Timetable, report: RegimeReport, now_ns: int, settings: Settings,
              driven_since_ns: int | None) -> Timetable:
        """
        Return a Timetable with the place at an instant [ns]; a recent position outranks the battery's power.

        A vehicle that stood has driven since `driven_since_ns` [ns]; None: that is not known.
        """
        is_charged = report.regime is Regime.CHARGING
        if timetable.end is not None:
            return timetable
        if timetable.has_position(now_ns, settings):
            return timetable.arrived(report.since_ns, True) if (
                report.is_at_rest and timetable.is_at_end_of_leg(now_ns)) else timetable
        if not report.is_at_rest:
            if self.charged_ns is not None and now_ns - self.charged_ns <= UNPLUGGED_AFTER_S * NS_PER_S:
                return timetable.driven_all_along()
            return timetable.driving() if report.regime is Regime.DRIVING else timetable.released(driven_since_ns)
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
        if voltage_v is None or current_a is None or (current_a == 0.0 and (
                self.current_ns is None or now_ns - self.current_ns < ZERO_AFTER_S * NS_PER_S)):
            return self._replace(source=source), doubts.noted(STATE_OF_CHARGE, '', now_ns).at(now_ns), without
        current_ns = self.current_ns if current_a == 0.0 else now_ns
        check, at = electrical_check(vehicle), (voltage_v, current_a, state.temperature_c, state.soc)
        charge_doubt = check.charge_doubt(*at)
        doubts = doubts.noted(STATE_OF_CHARGE, charge_doubt, now_ns)
        voltage_doubt = '' if charge_doubt else check.voltage_doubt(*at)
        shown_until_ns = now_ns + round(SIGNAL_DOUBT_SHOWN_S * NS_PER_S)
        if voltage_doubt:
            doubts = doubts.noted(VOLTAGE, voltage_doubt, now_ns, shown_until_ns)
        if voltage_doubt or SOURCE in doubts:
            return self._replace(source=source, current_ns=current_ns), doubts.at(now_ns), without
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
            source=source, current_ns=current_ns, soc_steps=soc_steps, sign=sign, scale=scale,
        ), doubts.at(now_ns), without if current_doubt else measurement


@lru_cache(maxsize=1)
def _full_j(vehicle: Vehicle) -> float:
    return energy_between_kwh(vehicle, 0.0, 1.0) * WH_PER_KWH * JOULES_PER_WH
