# SPDX-License-Identifier: Apache-2.0
"""
The regime of the vehicle and the signals that hold: no later stage uses a refuted signal.

`Knowledge.see` takes each valid battery state before it is learned from and planned with.
"""

from __future__ import annotations

from dataclasses import replace
import math
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.control.expected_drive import driven_at, planned_around
from bev_preheat.control.regime import Evidence, Regime, RegimeReport, RegimeWatch
from bev_preheat.estimation.readings import Resolution, TEMPERATURE_STEPS_K
from bev_preheat.numerics.arithmetic import SATURATING_FLOATS
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.numerics.folded_normal import mean_magnitude
from bev_preheat.signals.current_scale import CurrentScale
from bev_preheat.signals.current_sign import CurrentSign, Sign
from bev_preheat.signals.electrical import ElectricalCheck
from bev_preheat.signals.source import FeedWatch, SourceWatch
from bev_preheat.signals.stuck_temperature import StuckTemperature
from bev_preheat.signals.verdict import (
    CURRENT,
    FEED,
    NEEDED,
    SignalVerdict,
    SOURCE,
    STATE_OF_CHARGE,
    TEMPERATURE,
    VOLTAGE,
)
from bev_preheat.vehicle.uncertain_car import make_drive_rates

if TYPE_CHECKING:
    from bev_preheat.control.admitted import AdmittedInputs
    from bev_preheat.control.command_history import CommandHistory
    from bev_preheat.control.inputs import Measurement
    from bev_preheat.control.settings import Settings
    from bev_preheat.control.timetable import Timetable
    from bev_preheat.vehicle.description import Vehicle
    from bev_preheat.vehicle.uncertain_car import DriveInputs

# Time for which a doubt about voltage or current is shown after its last reading [s].
SHOWN_FOR_S = 30.0
# The temperature is compared with the model this often [s].
COMPARED_EVERY_S = 5.0
# Time over which the heater's power is averaged from the battery's [s].
SEEN_OVER_S = 60.0
# Unplugging and driving off takes longer than this [s]: power that ended sooner was that of a descent.
UNPLUGGED_AFTER_S = 20.0
# A car that is charged for ARRIVES_AFTER_S [s] near the end of a leg to a charger has arrived there. Near: within
# NEAR_END_S [s] or NEAR_END_SHARE of the leg, but not within NEAR_START_SHARE of its start: it may be
# charged there until departure.
ARRIVES_AFTER_S = 120.0
NEAR_END_S, NEAR_END_SHARE, NEAR_START_SHARE = 900.0, 0.25, 0.25


class Known(NamedTuple):
    """
    A Measurement with the signals that hold; the others are None in it.

    `timetable` is that of the route, with its place at that instant; None without a route. `command_w` [W] is the
    command to the heater at its instant. `is_described`: the model describes this instant, so it may be learned
    from; `is_open`: that is not known yet. `trusts_temperature`, `trusts_soc`: these readings hold.
    """

    measurement: Measurement
    timetable: Timetable | None
    command_w: float
    is_described: bool
    is_open: bool
    trusts_temperature: bool
    trusts_soc: bool


class Knowledge:
    """Keeps the RegimeReport `regime` and the SignalVerdicts `verdicts` of one vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        """Know nothing yet of a Vehicle."""
        self._vehicle = vehicle
        self._regime = RegimeWatch()
        self._sign = CurrentSign(vehicle.battery.capacity_as)
        self._scale = CurrentScale(vehicle.battery.capacity_as)
        self._electrical = ElectricalCheck(vehicle)
        self._source = SourceWatch()
        self._stuck = StuckTemperature()
        self._feed = FeedWatch()
        self._steps = Resolution(TEMPERATURE_STEPS_K)
        self._rates = make_drive_rates(vehicle, SATURATING_FLOATS, lambda mean, variance: float(
            mean_magnitude(mean, variance)))
        self._verdicts: dict[str, SignalVerdict] = {}
        self._shown_until_ns: dict[str, int] = {}
        self._has_seen_current = False
        # Power beyond that of drive and consumers, and command, each over about SEEN_OVER_S [W].
        self._seen_w = self._commanded_w = 0.0
        self._stamp_ns: int | None = None
        self._compared_ns = 0
        # When the vehicle was charged last, on the way [ns]; None: it has driven since.
        self._charged_ns: int | None = None

    @property
    def vehicle(self) -> Vehicle:
        """The Vehicle, as its file describes it."""
        return self._vehicle

    @property
    def regime(self) -> RegimeReport:
        """The current RegimeReport."""
        return self._regime.report

    @property
    def verdicts(self) -> tuple[SignalVerdict, ...]:
        """The SignalVerdicts that hold; () while every signal does."""
        return tuple(self._verdicts.values())

    @property
    def obstacle(self) -> str | None:
        """The sentence on signals without which nothing is heated; None if they hold."""
        if not self._verdicts:
            return None
        sentences = [verdict.sentence for verdict in self._verdicts.values() if verdict.signal in NEEDED]
        return f'Signal in doubt: {"; ".join(sentences)}.' if sentences else None

    def note_expired_state(self) -> None:
        """Note that the latest battery state is too old, and no other has arrived."""
        self._feed.note_expired()

    def without_instants(self) -> Knowledge:
        """Forget all instants, because the clock was restarted; the sign of the current is still known."""
        for watch in (self._regime, self._sign, self._scale, self._source, self._stuck, self._feed):
            watch.lose_time()
        self._stamp_ns = self._charged_ns = None
        self._shown_until_ns.clear()
        return self

    def see(self, measurement: Measurement, inputs: AdmittedInputs, commands: CommandHistory) -> Known:
        """
        Take a valid Measurement in, on the timetables of the AdmittedInputs, and return it as Known.

        Where the vehicle stands or is charged on a leg of the route, its place stays there.
        """
        stamp_ns, settings = measurement.stamp_ns, inputs.settings
        timetable, active = inputs.timetable, inputs.active_timetable
        command_w = commands.power_w(stamp_ns)
        self._note(FEED, self._feed.see(stamp_ns / NS_PER_S, settings.battery_state_timeout_s), stamp_ns)
        seen = self._screened(measurement)
        planned = planned_around(active, stamp_ns, inputs.defaults)
        has_moved = None if timetable is None else timetable.has_moved(stamp_ns, settings)
        report = self._regime.see(Evidence(
            stamp_ns, seen.power_w, command_w, planned, measurement.supply_status, has_moved,
            0.0 if timetable is None or has_moved is None else timetable.stood_ns / NS_PER_S,
            self._sign.sign is Sign.RIGHT))
        kept = None if timetable is None else self._kept(timetable, report, stamp_ns, settings)
        drive = driven_at(self._vehicle, kept if active is timetable else active, stamp_ns)
        self._check_temperature(seen, drive, command_w)
        self._stamp_ns = stamp_ns
        is_described = (
            drive is not None and report.regime not in (Regime.CHARGING, Regime.STANDING)
            and not report.suspicion and self._verdicts.keys().isdisjoint(NEEDED))
        is_one_battery = SOURCE not in self._verdicts
        return Known(seen, kept, command_w, is_described, is_described and report.is_doubtful,
                     TEMPERATURE not in self._verdicts and is_one_battery,
                     STATE_OF_CHARGE not in self._verdicts and is_one_battery)

    def _kept(self, timetable: Timetable, report: RegimeReport, now_ns: int, settings: Settings) -> Timetable:
        """Return a Timetable with the place at an instant [ns]; a recent position outranks the battery's power."""
        was_charged_ns = self._charged_ns
        is_charged = report.regime is Regime.CHARGING
        is_at_rest = is_charged or report.regime is Regime.STANDING
        self._charged_ns = now_ns if is_charged else was_charged_ns if is_at_rest else None
        if timetable.end is not None:
            return timetable
        if timetable.has_position(now_ns, settings):
            return timetable.arrived(report.since_ns, True) if (
                is_at_rest and timetable.is_at_end_of_leg(now_ns)) else timetable
        if not is_at_rest:
            if was_charged_ns is not None and now_ns - was_charged_ns <= UNPLUGGED_AFTER_S * NS_PER_S:
                return timetable.driven_all_along()
            return timetable.driving() if report.regime is Regime.DRIVING else timetable.released()
        leg = timetable.mission.legs[timetable.mission.leg_number(now_ns)]
        left_s, whole_s = -leg.ended_for_s(now_ns), leg.route.total_duration_s
        near_s = min(max(NEAR_END_S, NEAR_END_SHARE * whole_s), (1.0 - NEAR_START_SHARE) * whole_s)
        if (is_charged and leg.charging_planned and 0.0 < left_s <= near_s
                and now_ns - report.since_ns >= ARRIVES_AFTER_S * NS_PER_S):
            return timetable.arrived(report.since_ns, False)
        return timetable.standing(report.since_ns, report.recognised_ns, now_ns, is_charged)

    # Signals

    def _screened(self, measurement: Measurement) -> Measurement:
        """Return a Measurement without the voltage and current that do not hold; note the doubts."""
        state, now_ns = measurement.state, measurement.stamp_ns
        instant_s, voltage_v, current_a = now_ns / NS_PER_S, measurement.voltage_v, measurement.current_a
        self._note(SOURCE, self._source.see(
            instant_s, state.temperature_c, state.soc, voltage_v,
            measurement.serial_number or measurement.location), now_ns)
        if voltage_v is None or current_a is None or not self._has_current(current_a):
            self._note(STATE_OF_CHARGE, '', now_ns)
            self._clear_shown(now_ns)
            return replace(measurement, voltage_v=None, current_a=None)
        at = voltage_v, current_a, state.temperature_c, state.soc
        doubt = self._electrical.charge_doubt(*at)
        self._note(STATE_OF_CHARGE, doubt, now_ns)
        voltage_doubt = '' if doubt else self._electrical.voltage_doubt(*at)
        self._show(VOLTAGE, voltage_doubt, now_ns)
        if voltage_doubt or SOURCE in self._verdicts:
            self._clear_shown(now_ns)
            return replace(measurement, voltage_v=None, current_a=None)
        sign = self._sign.see(instant_s, voltage_v, current_a, state.soc)
        scale_doubt = self._scale.see(instant_s, current_a, state.soc)
        current_doubt = scale_doubt if sign is not Sign.REVERSED else (
            f'current: its sign is reversed: {self._sign.evidence}; battery_state.current is negative while '
            'the battery is discharged; voltage and current are not used')
        self._show(CURRENT, current_doubt, now_ns)
        self._clear_shown(now_ns)
        return replace(measurement, voltage_v=None, current_a=None) if current_doubt else measurement

    def _has_current(self, current_a: float) -> bool:
        """Whether a current [A] is known: a field that has always been 0 is not filled."""
        self._has_seen_current = self._has_seen_current or current_a != 0.0
        return self._has_seen_current

    def _check_temperature(self, seen: Measurement, drive: DriveInputs | None, command_w: float) -> None:
        state, now_ns = seen.state, seen.stamp_ns
        self._steps.see(state.temperature_c)
        if drive is None or SOURCE in self._verdicts:
            self._stuck.lose_time()
            self._note(TEMPERATURE, '', now_ns)
            return
        power_w = seen.power_w
        heater_w = self._seen_heater_w(power_w, now_ns, drive, command_w)
        if 0 <= now_ns - self._compared_ns < COMPARED_EVERY_S * NS_PER_S:
            return
        self._compared_ns = now_ns
        rate_k_per_s, _, _ = self._rates(state.temperature_c, state.soc, (1.0,) * 5, replace(
            drive, heater_power_w=heater_w, terminal_power_w=power_w,
            power_variance_w2=0.0 if power_w is not None else drive.power_variance_w2))
        self._note(TEMPERATURE, self._stuck.see(
            now_ns / NS_PER_S, state.temperature_c, self._steps.step, rate_k_per_s,
            drive.ambient_temperature_c), now_ns)

    def _seen_heater_w(self, power_w: float | None, now_ns: int, drive: DriveInputs, command_w: float) -> float:
        """Return the power [W] that the heater takes as far as the battery's power shows it; 0 without that."""
        if power_w is None:
            return 0.0
        elapsed_s = 0.0 if self._stamp_ns is None else (now_ns - self._stamp_ns) / NS_PER_S
        share = 1.0 if elapsed_s <= 0.0 else 1.0 - math.exp(-elapsed_s / SEEN_OVER_S)
        others_w = drive.propulsion_power_w + drive.cabin_heating_power_w + drive.auxiliary_power_w
        self._seen_w += share * (power_w - others_w - self._seen_w)
        self._commanded_w += share * (command_w - self._commanded_w)
        return min(max(self._seen_w, 0.0), self._commanded_w)

    def _note(self, signal: str, sentence: str, now_ns: int) -> None:
        """Note the doubt about a signal; '' ends it."""
        if not sentence:
            self._verdicts.pop(signal, None)
            return
        before = self._verdicts.get(signal)
        self._verdicts[signal] = SignalVerdict(signal, sentence, now_ns if before is None else before.since_ns)

    def _show(self, signal: str, sentence: str, now_ns: int) -> None:
        """Note the doubt about a signal, which is shown for a while after its last reading."""
        if sentence:
            self._shown_until_ns[signal] = now_ns + round(SHOWN_FOR_S * NS_PER_S)
            self._note(signal, sentence, now_ns)

    def _clear_shown(self, now_ns: int) -> None:
        for signal in (VOLTAGE, CURRENT):
            if now_ns >= self._shown_until_ns.get(signal, now_ns):
                self._verdicts.pop(signal, None)
