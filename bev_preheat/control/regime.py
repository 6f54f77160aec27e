# SPDX-License-Identifier: Apache-2.0
"""
The regime of the vehicle, from evidence and not from its route: driving, standing or charging.

The battery's power is the quickest evidence. Charging is steady and flows into the battery where the
route plans no such regeneration; a vehicle that stands takes no more than its consumers where the
route drives. A position outranks the power; `power_supply_status` counts if it is set. Without power, the
course of the state of charge tells the same, within minutes.
Instants are integers, in nanoseconds of the node's clock; power is positive while the battery is
discharged. Limits were chosen on nine measured winter drives (10 300 s): regeneration never lasted
20 s, and never stayed within 10 % for 9 s, although it once ran at the charge limit of a cold battery.
"""

from __future__ import annotations

from enum import Enum
from itertools import dropwhile
from typing import NamedTuple

from bev_preheat.control.charge_course import ChargeCourse
from bev_preheat.control.inputs import SupplyStatus
from bev_preheat.numerics import NS_PER_S
from bev_preheat.tunables import (
    BEYOND_REGENERATION,
    BEYOND_REGENERATION_W,
    CHANGED_CHARGE,
    CHARGES_W,
    CHARGING_AFTER_S,
    CHARGING_DOUBTED_AFTER_S,
    DRIVES_W,
    DRIVING_AFTER_S,
    FROZEN_AFTER_S,
    HEATER_FOLLOWS_S,
    LEAST_CHARGED,
    LEAST_CHARGING_STATES,
    MIRRORED_UP_TO,
    MOVES_WITHIN_NS,
    NOT_PARKED_SHARE,
    PARKED_AFTER_S,
    PARKED_SHARE,
    ROAD_SHARE,
    SHORT_GAP_S,
    STANDING_AFTER_LONG_S,
    STANDING_AFTER_S,
    STANDS_ABOVE_W,
    STANDS_WITHIN_W,
    STEADY_SHARE,
    STEADY_W,
)


class Regime(Enum):
    """Regimes of the vehicle; the values are the words in diagnostics."""

    UNKNOWN = 'unknown'
    DRIVING = 'driving'
    STANDING = 'standing'
    CHARGING = 'charging'


class RegimeReport(NamedTuple):
    """
    A Regime, since when [ns], and the evidence as a sentence without full stop; '': none.

    `recognised_ns` [ns] is the instant at which it was recognised. `suspicion` is a sentence on a
    regime that is likely but not certain; '': no suspicion. `is_parked`: it stands with its consumers
    off. `is_doubtful`: the latest states look like charging, and are too few to recognise it.
    """

    regime: Regime
    since_ns: int = 0
    evidence: str = ''
    recognised_ns: int = 0
    suspicion: str = ''
    is_parked: bool = False
    is_doubtful: bool = False

    @property
    def is_at_rest(self) -> bool:
        """Whether the vehicle stands or is charged."""
        return self.regime in (Regime.STANDING, Regime.CHARGING)

    def entered(self, regime: Regime, now_ns: int, evidence: str, since_ns: int | None = None) -> RegimeReport:
        """Return the RegimeReport of an instant [ns] on a regime since another, None: since then."""
        if regime is not self.regime:
            return RegimeReport(regime, now_ns if since_ns is None else since_ns, evidence, now_ns)
        return self._replace(evidence=evidence) if evidence else self


UNKNOWN_REGIME = RegimeReport(Regime.UNKNOWN)


class PlannedPower(NamedTuple):
    """
    The power that the route plans around an instant [W].

    `propulsion_w` is the mean, `least_propulsion_w` and `most_propulsion_w` are those of segments; `others_w`
    is the power of cabin and auxiliaries. `least_in_60_s_w` and `least_in_300_s_w` are the least means over so
    much time, wherever within its uncertainty the place on the route is. `is_driving`: a leg covers the instant.
    """

    propulsion_w: float
    least_propulsion_w: float
    most_propulsion_w: float
    others_w: float
    least_in_60_s_w: float
    least_in_300_s_w: float
    is_driving: bool = True


class Evidence(NamedTuple):
    """
    Evidence at an instant [ns].

    `power_w` is the battery's terminal power [W], None: unknown. `command_w` is the heater's
    command [W]. `has_moved`: by its position the vehicle moved within the last seconds; None: no
    position is known. `stood_s` [s] is for how long it has not, by its position.
    `is_sign_proven`: the sign of the current is known to be right. `soc` is the state of charge, None: in doubt,
    and `full_j` the battery's energy [J].
    """

    stamp_ns: int
    power_w: float | None
    command_w: float
    planned: PlannedPower
    supply: SupplyStatus = SupplyStatus.UNKNOWN
    has_moved: bool | None = None
    stood_s: float = 0.0
    is_sign_proven: bool = True
    soc: float | None = None
    full_j: float = 1.0


class _PowerSample(NamedTuple):
    stamp_ns: int
    power_w: float | None
    command_w: float
    supply: SupplyStatus


class RegimeWatch(NamedTuple):
    """
    The RegimeReport `report`, and the memory for the next one.

    `samples` are those of the latest battery states. `low_since_ns` [ns] is the instant since which the power has
    been that of a vehicle that stands; None: it is not. `course` is that of the charge while no power is known,
    `told_soc` the highest one since `power_supply_status` has been CHARGING, `told_ns` [ns] the instant; None: it
    is not. `tells_regeneration`: it was CHARGING for a shorter time than any charge lasts.
    """

    report: RegimeReport = UNKNOWN_REGIME
    samples: tuple[_PowerSample, ...] = ()
    low_since_ns: int | None = None
    course: ChargeCourse = ChargeCourse()
    told_soc: float | None = None
    told_ns: int | None = None
    tells_regeneration: bool = False

    def seen(self, evidence: Evidence) -> RegimeWatch:
        """Return the RegimeWatch after the Evidence of a battery state, the latest so far."""
        report, samples, low_since_ns, now_ns = self.report, self.samples, self.low_since_ns, evidence.stamp_ns
        course, told_soc, told_ns, soc = self.course, self.told_soc, self.told_ns, evidence.soc
        if samples and not 0 <= now_ns - samples[-1].stamp_ns <= SHORT_GAP_S * NS_PER_S:
            report, samples, low_since_ns = RegimeReport(Regime.UNKNOWN, now_ns), (), None
            course, told_soc, told_ns = ChargeCourse(), None, None
        course = ChargeCourse() if evidence.power_w is not None or soc is None else course.seen(
            now_ns, soc, evidence.planned, evidence.command_w, evidence.full_j)
        supply, tells_regeneration = evidence.supply, self.tells_regeneration
        if supply is SupplyStatus.CHARGING:
            told_ns = now_ns if told_ns is None else told_ns
        elif told_ns is not None:
            tells_regeneration = tells_regeneration or now_ns - told_ns < STANDING_AFTER_S * NS_PER_S
            told_ns = None
        if supply is not SupplyStatus.CHARGING or course.latest is None or soc is None:
            told_soc = None
        else:
            told_soc = soc if told_soc is None else max(told_soc, soc)
            if told_soc - soc > course.steps.step + CHANGED_CHARGE:
                # The charge falls, so the field is wrong.
                supply = SupplyStatus.UNKNOWN
        oldest_ns = now_ns - HEATER_FOLLOWS_S * NS_PER_S
        return RegimeWatch(report, (
            *dropwhile(lambda sample: sample.stamp_ns < oldest_ns, samples),
            _PowerSample(now_ns, evidence.power_w, evidence.command_w, supply)),
            low_since_ns, course, told_soc, told_ns, tells_regeneration)._judged(evidence)

    def has_seen_late(self, before: RegimeWatch) -> bool:
        """Return whether the charge shows standing or charging only now, some time after its beginning."""
        return self.course.latest is not None and self.report.is_at_rest and not before.report.is_at_rest

    def _judged(self, evidence: Evidence) -> RegimeWatch:
        """Return the RegimeWatch whose latest sample is that of the Evidence."""
        # A car that stands drives down no hill.
        (charging, since_ns), suspicion = self._charging(
            evidence, CHARGING_AFTER_S, CHANGED_CHARGE if self.report.is_at_rest else LEAST_CHARGED), ''
        if not evidence.is_sign_proven:
            # It stays until a current has flowed out.
            may_be_reversed = evidence.power_w is not None and evidence.power_w < CHARGES_W
            suspicion = self.report.suspicion if may_be_reversed else ''
            if charging and _is_mirrored(evidence):
                suspicion = (f'{charging}, no more than the route takes from it, so the sign of '
                             'battery_state.current may be reversed')
            charging = '' if suspicion else charging
        report, low_since_ns = self._entered(evidence, charging, since_ns, suspicion != '')
        is_doubtful = (report.regime is not Regime.CHARGING and not evidence.has_moved
                       and self._charging(evidence, CHARGING_DOUBTED_AFTER_S, CHANGED_CHARGE)[0] != '')
        return self._replace(
            report=report._replace(suspicion=suspicion, is_doubtful=is_doubtful), low_since_ns=low_since_ns)

    def _entered(self, evidence: Evidence, charging: str, since_ns: int,
                 is_suspected: bool) -> tuple[RegimeReport, int | None]:
        """Return the RegimeReport, and since when the power has been low; `charging`: evidence since [ns]."""
        report, now_ns, before = self.report, evidence.stamp_ns, self.report.regime
        if evidence.has_moved:
            return report.entered(Regime.DRIVING, now_ns, 'the position moves'), self.low_since_ns
        if charging:
            # The charge shows late that it has risen, and since when.
            recognised_ns = now_ns if evidence.power_w is not None else since_ns
            return report.entered(Regime.CHARGING, recognised_ns, charging, since_ns), self.low_since_ns
        if before is Regime.CHARGING and (self._is_still_charged() or self.course.is_rising()):
            return report, self.low_since_ns
        if before is not Regime.DRIVING and not is_suspected and self._drives(evidence):
            return report.entered(Regime.DRIVING, now_ns, f'the battery gives {evidence.power_w or 0.0:.0f} W'
                                  ), self.low_since_ns
        standing, low_since_ns = self._standing(evidence)
        if standing:
            since_ns = now_ns - round(max(evidence.stood_s, STANDING_AFTER_S) * NS_PER_S)
            if low_since_ns is not None:
                since_ns = min(since_ns, low_since_ns)
            # A stop of a minute is part of the route; a charge shows only longer ones.
            stop_s = 0.0 if evidence.power_w is None and evidence.has_moved is None else STANDING_AFTER_S
            report = report.entered(
                Regime.STANDING, since_ns + round(stop_s * NS_PER_S), standing, since_ns)._replace(
                is_parked=self._is_parked(evidence))
        elif before is Regime.CHARGING:
            report = report.entered(Regime.STANDING, now_ns, 'it is no longer charged')
        elif before is Regime.STANDING and (
                evidence.power_w is not None or evidence.has_moved is not None or self.course.stays()):
            pass
        elif evidence.power_w is not None and not is_suspected and (
                evidence.planned.is_driving or before is Regime.DRIVING):
            report = report.entered(Regime.DRIVING, now_ns, '')
        else:
            report = report.entered(Regime.UNKNOWN, now_ns, '')
        return report, low_since_ns

    def _window(self, duration_s: float) -> list[_PowerSample]:
        """Return the samples of the last `duration_s` [s] and the one before; [] if they cover less."""
        samples, from_ns = self.samples, self.samples[-1].stamp_ns - round(duration_s * NS_PER_S)
        if samples[0].stamp_ns > from_ns:
            return []
        window = [sample for sample in samples if sample.stamp_ns > from_ns]
        return [samples[len(samples) - len(window) - 1], *window]

    def _powers_w(self, window: list[_PowerSample]) -> list[float]:
        """Return the powers of a window [W]; [] if one is unknown or there are too few."""
        powers_w = [sample.power_w for sample in window if sample.power_w is not None]
        return powers_w if len(window) >= LEAST_CHARGING_STATES and len(powers_w) == len(window) else []

    def _charging(self, evidence: Evidence, after_s: float, least_charged: float) -> tuple[str, int]:
        """Return evidence of charging for `after_s` [s] or by `least_charged` and since when [ns]; '' for none."""
        if evidence.power_w is not None and evidence.power_w > -CHARGES_W:
            return '', 0
        window = self._window(after_s)
        told = self._window(STANDING_AFTER_S) if self.tells_regeneration else window
        by_status = len(told) >= LEAST_CHARGING_STATES and all(
            sample.supply is SupplyStatus.CHARGING for sample in told)
        planned = evidence.planned
        regeneration_w = max(0.0, -planned.least_propulsion_w) if planned.is_driving else 0.0
        says_otherwise = evidence.has_moved is not False and all(
            sample.supply in (SupplyStatus.DISCHARGING, SupplyStatus.NOT_CHARGING) for sample in window)
        if says_otherwise and evidence.power_w is not None:
            # Power that stays steady for longer outweighs a field that never changes.
            window = self._window(STANDING_AFTER_S)
        since_ns = window[0].stamp_ns if window else 0
        if evidence.power_w is None:
            if by_status and regeneration_w == 0.0 and all(sample.power_w is None for sample in window):
                return 'power_supply_status is CHARGING', since_ns
            risen_ns = None if says_otherwise else self.course.charged_since_ns(least_charged)
            return ('', 0) if risen_ns is None else ('the state of charge rises', risen_ns)
        powers_w = self._powers_w(window)
        is_certain = evidence.has_moved is False or (by_status and regeneration_w == 0.0)
        if not is_certain and not _is_steady_charge(powers_w, regeneration_w):
            # The route may brake as hard, but for less than a minute.
            window = self._window(STANDING_AFTER_S)
            powers_w = self._powers_w(window)
            if not _is_steady_charge(powers_w, max(0.0, -planned.least_in_60_s_w) if planned.is_driving else 0.0):
                return '', 0
        if not powers_w or max(powers_w) > -CHARGES_W:
            return '', 0
        return f'the battery is charged with {-sum(powers_w) / len(powers_w):.0f} W', window[0].stamp_ns

    def _is_still_charged(self) -> bool:
        """Whether any of the last samples still shows charging."""
        window = self._window(DRIVING_AFTER_S) or list(self.samples)
        return any(sample.supply is SupplyStatus.CHARGING if sample.power_w is None
                   else sample.power_w < STANDS_ABOVE_W for sample in window)

    def _drives(self, evidence: Evidence) -> bool:
        """Whether the battery has given more than consumers and heater take for some seconds."""
        window = self._window(DRIVING_AFTER_S)
        powers_w = [sample.power_w for sample in window if sample.power_w is not None]
        if len(powers_w) < 2:
            return False
        heater_w = max(sample.command_w for sample in self.samples)
        return min(powers_w) > evidence.planned.others_w + heater_w + DRIVES_W

    def is_position_frozen(self, evidence: Evidence) -> bool:
        """Return whether the battery drives the vehicle, although its position has not moved for minutes."""
        return (evidence.has_moved is False and evidence.stood_s >= FROZEN_AFTER_S
                and self._has_driven_by_road(evidence))

    def has_driven(self, evidence: Evidence, least_w: float = DRIVES_W) -> bool:
        """Return whether consumers and heater take less, by `least_w` [W], than the battery gave in a minute."""
        window = self._window(STANDING_AFTER_S)
        powers_w = self._powers_w(window)
        if not powers_w:
            return False
        heater_w = max(sample.command_w for sample in window)
        return sum(powers_w) > len(powers_w) * (evidence.planned.others_w + heater_w + least_w)

    def _has_driven_by_road(self, evidence: Evidence) -> bool:
        """
        Return whether it has driven by a power that varies, with regeneration or much of the route's.

        The unplanned consumers of a vehicle that stands are steady or small. The latest power may be that of one
        that starts, whose next position moves.
        """
        until_ns = evidence.stamp_ns - MOVES_WITHIN_NS
        window = [sample for sample in self._window(STANDING_AFTER_S) if sample.stamp_ns <= until_ns]
        return self.has_driven(evidence) and _variation_w(window) > STANDS_WITHIN_W and (
            min(self._powers_w(window), default=0.0) < STANDS_ABOVE_W
            or self.has_driven(evidence, ROAD_SHARE * evidence.planned.propulsion_w))

    def _standing(self, evidence: Evidence) -> tuple[str, int | None]:
        """Return the evidence of standing, '' for none, and since when the power has been low [ns]."""
        is_at_rest = evidence.has_moved is False and evidence.stood_s >= STANDING_AFTER_S
        if is_at_rest and not self._has_driven_by_road(evidence):
            return f'the position has not moved for {evidence.stood_s:.0f} s', self.low_since_ns
        if evidence.has_moved is not None:
            return '', self.low_since_ns
        if evidence.power_w is None:
            since_ns = self.course.standing_since_ns()
            return ('', None) if since_ns is None else (
                'the state of charge hardly falls on a route that takes from it', since_ns)
        power_w = self._low_power_w(evidence)
        if power_w is None:
            return '', None
        since_ns = self._window(STANDING_AFTER_S)[0].stamp_ns if self.low_since_ns is None else self.low_since_ns
        planned, low_s = evidence.planned, (evidence.stamp_ns - since_ns) / NS_PER_S
        if planned.is_driving and not (
                planned.least_in_60_s_w > DRIVES_W
                or (low_s >= STANDING_AFTER_LONG_S and planned.least_in_300_s_w > DRIVES_W)
                or (low_s >= PARKED_AFTER_S and self._is_parked(evidence))):
            return '', since_ns
        if not planned.is_driving:
            return f'the battery gives {power_w:.0f} W', since_ns
        return (f'the battery gives {power_w:.0f} W, and the route plans '
                f'{planned.propulsion_w + planned.others_w + evidence.command_w:.0f} W'), since_ns

    def _low_power_w(self, evidence: Evidence) -> float | None:
        """Return the mean power of the last minute [W] if it is that of a vehicle that stands; None if not."""
        planned = evidence.planned
        if evidence.power_w is None or (
                evidence.power_w - evidence.command_w > planned.others_w + 2.0 * STANDS_WITHIN_W):
            # Most states of a drive are decided by this one alone.
            return None
        window = self._window(STANDING_AFTER_S)
        powers_w = self._powers_w(window)
        if not powers_w or min(powers_w) < STANDS_ABOVE_W:
            return None
        heater_w = sum(sample.command_w for sample in window) / len(window)
        mean_w = sum(powers_w) / len(powers_w)
        most_w = planned.others_w + heater_w + STANDS_WITHIN_W
        return None if mean_w > most_w or _variation_w(window) > STANDS_WITHIN_W else mean_w

    def _is_parked(self, evidence: Evidence) -> bool:
        """Whether the consumers of a vehicle that stands are off, by the power of the last minute."""
        window = self._window(STANDING_AFTER_S)
        powers_w = self._powers_w(window)
        if not powers_w:
            return False
        others_w = evidence.planned.others_w
        if self.report.regime is Regime.STANDING and self.report.is_parked:
            # The power of a heater that has been switched off falls slowly.
            heater_w = max(sample.command_w for sample in self.samples)
            return min(powers_w) - heater_w < NOT_PARKED_SHARE * others_w
        consumers_w = sum(powers_w) - sum(sample.command_w for sample in window)
        return consumers_w < PARKED_SHARE * others_w * len(powers_w)


def _is_steady_charge(powers_w: list[float], regeneration_w: float) -> bool:
    """Whether powers [W] are as steady as those of a charger, and far beyond the regeneration planned [W]."""
    if not powers_w or max(powers_w) > -CHARGES_W:
        return False
    charge_w = -sum(powers_w) / len(powers_w)
    return (max(powers_w) - min(powers_w) <= max(STEADY_SHARE * charge_w, STEADY_W)
            and charge_w >= BEYOND_REGENERATION * regeneration_w + (
                BEYOND_REGENERATION_W if regeneration_w > 0.0 else 0.0))


def _variation_w(window: list[_PowerSample]) -> float:
    """Return by how much the power [W] of samples varies more than their command."""
    powers_w = [sample.power_w for sample in window if sample.power_w is not None]
    commands_w = [sample.command_w for sample in window]
    return max(powers_w) - min(powers_w) - (max(commands_w) - min(commands_w))


def _is_mirrored(evidence: Evidence) -> bool:
    """Whether the power, with the other sign, may be that of the vehicle on its route."""
    planned = evidence.planned
    expected_w = max(planned.most_propulsion_w, 0.0) + planned.others_w + evidence.command_w
    return (planned.is_driving and evidence.power_w is not None
            and -evidence.power_w <= MIRRORED_UP_TO * expected_w)
