# SPDX-License-Identifier: Apache-2.0
"""
The power of the heat sources: as commanded, and as their controllers answer (`hvch_status`, `heat_source_status`).

Without answers the planner takes its own commands for the heater's power, as it does once they are silent or
doubted. Instants are integers, in nanoseconds of the node's clock.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.errors import age_beyond, InvalidInput
from bev_preheat.estimation.hypotheses import Heater, HeaterReport
from bev_preheat.numerics import FLOATS, NS_PER_S
from bev_preheat.tunables import COMPARED_OVER_NS, CONFIRMED_WITHIN_S, LEAST_DIFFERENCE_W, REFUSED_S, RESTING_W
from bev_preheat.vehicle.description import HeatSource, HVCH, Vehicle
from bev_preheat.vehicle.heater_controller import Refusal

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from bev_preheat.control.decision import Command
    from bev_preheat.control.settings import Settings
    from bev_preheat.vehicle.variants import DriveInputs

# No caller asks further back.
KEPT_NS = 70_000_000_000
NO_CHANGES: tuple[tuple[int, float], ...] = ((0, 0.0),)


@dataclass(frozen=True)
class CommandHistory:
    """
    The heater's commanded power [W] over the last minutes; instants in nanoseconds.

    `changes` are the instants of changes with the power after each; `heated_ns` is the time of heating up to the
    latest change, since `without_heating`.
    """

    changes: tuple[tuple[int, float], ...] = NO_CHANGES
    heated_ns: int = 0

    def noted(self, instant_ns: int, power_w: float) -> CommandHistory:
        """Return the history with `power_w` commanded from an instant on; instants do not fall."""
        # A clock that was set back voids earlier entries.
        changes = NO_CHANGES if self.changes[-1][0] > instant_ns else self.changes
        if changes[-1][1] == power_w:
            return self if changes is self.changes else replace(self, changes=changes)
        heated_ns = self.heated_ns + _heating_for_ns(changes, instant_ns)
        changes = (*changes, (instant_ns, power_w))
        while len(changes) > 2 and changes[1][0] < instant_ns - KEPT_NS:
            changes = changes[1:]
        return CommandHistory(changes, heated_ns)

    def heating_for_s(self, now_ns: int) -> float:
        """Return for how long [s] the latest power, if it is not 0, has been commanded."""
        return _heating_for_ns(self.changes, now_ns) / NS_PER_S

    def heated_s(self, now_ns: int) -> float:
        """Return for how long [s] heating has been commanded since `without_heating`."""
        return (self.heated_ns + _heating_for_ns(self.changes, now_ns)) / NS_PER_S

    def without_heating(self, now_ns: int) -> CommandHistory:
        """Return the history that counts the time of heating from 0 again, because another drive begins."""
        return replace(self, heated_ns=-_heating_for_ns(self.changes, now_ns))

    def mean_w(self, from_ns: int, to_ns: int) -> float:
        """Return the mean commanded power [W] between two instants; the power then if they are equal."""
        if to_ns <= from_ns:
            return self.power_w(to_ns)
        later_ns, energy = to_ns, 0.0
        for changed_ns, power_w in reversed(self.changes):
            if changed_ns >= later_ns:
                continue
            start_ns = max(changed_ns, from_ns)
            energy += power_w * (later_ns - start_ns)
            later_ns = start_ns
            if later_ns <= from_ns:
                break
        return energy / (to_ns - from_ns)

    def power_w(self, instant_ns: int) -> float:
        """Return the power [W] that was commanded at an instant."""
        for changed_ns, power_w in reversed(self.changes):
            if changed_ns <= instant_ns:
                return power_w
        return 0.0


def _heating_for_ns(changes: tuple[tuple[int, float], ...], now_ns: int) -> int:
    since_ns, power_w = changes[-1]
    return max(0, now_ns - since_ns) if power_w > 0.0 else 0


HEATER_STATUS, SOURCE_STATUS = 'hvch_status', 'heat_source_status'

# These do not depend on a command: they hold at once.
HOLD_AT_ONCE = frozenset((Refusal.HEATER_FAULT, Refusal.LOW_CHARGE, Refusal.HOT_BATTERY, Refusal.IN_MOTION))
FAULTS = {
    Heater.DERATED: 'The {} delivers only {share:.0f} % of its command.',
    Heater.DEAD: 'The {} does not respond to its command.',
    Heater.STUCK_ON: 'The {} heats without a command.',
}
IN_WORDS = {
    Heater.DERATED: 'battery temperature and power show less heat than it reports',
    Heater.DEAD: 'battery temperature and power show no heat',
    Heater.STUCK_ON: 'battery temperature and power show more heat than it reports',
}


class HeaterStatus(NamedTuple):
    """An answer at an instant [ns]: powers [W], None: not measured, and the Refusal with its sentence."""

    stamp_ns: int
    requested_w: float
    active_w: float
    refusal: Refusal = Refusal.NOT_REFUSED
    sentence: str = ''
    measured_w: float | None = None

    @property
    def confirmed_w(self) -> float:
        """The confirmed power [W]: the measured one if there is one."""
        return self.active_w if self.measured_w is None else self.measured_w

    @property
    def has_heat(self) -> bool:
        """Whether the confirmed power is more than that of a heater at rest."""
        return self.confirmed_w > (0.0 if self.measured_w is None else RESTING_W)


class HeaterAnswers(NamedTuple):
    """
    The latest HeaterStatus of a heat source, by `name`, and its power; a value: each answer makes another one.

    `commanded` is the power as commanded; `history` has the confirmed power while the answers are used, otherwise
    the commanded one. `doubt` is the sentence on answers that are contradicted, `problem` that on the latest
    unreadable one; '' for none. `status` None: no answer yet, commands count as served. A refused command is given
    again, if without it nothing is commanded, from `refused_until_ns` [ns] on.
    """

    name: str = HVCH
    commanded: CommandHistory = CommandHistory()
    history: CommandHistory = CommandHistory()
    status: HeaterStatus | None = None
    doubt: str = ''
    problem: str = ''
    refused_until_ns: int = 0

    def with_answer(self, status: HeaterStatus, now_ns: int, settings: Settings) -> HeaterAnswers:
        """Return the answers with a HeaterStatus; raise InvalidInput if its stamp is implausible."""
        age_s = (now_ns - status.stamp_ns) / NS_PER_S
        oldest_s, ahead_s = settings.battery_state_timeout_s, settings.clock_tolerance_s
        if not -ahead_s <= age_s <= oldest_s:
            raise InvalidInput(f'header.stamp: the status is {age_beyond(age_s, ahead_s, oldest_s)}')
        if self.status is not None and status.stamp_ns < self.status.stamp_ns <= now_ns + ahead_s * NS_PER_S:
            # Overtaken.
            return self
        history = self.history if self.doubt else self.history.noted(now_ns, status.confirmed_w)
        return self._replace(status=status, problem='', history=history)

    def with_problem(self, error: InvalidInput) -> HeaterAnswers:
        """Return the answers after a status that could not be used."""
        return self._replace(problem=f'{self._topic} refused: {error}')

    @property
    def _topic(self) -> str:
        return HEATER_STATUS if self.name == HVCH else f'{SOURCE_STATUS} of {self.name}'

    def with_command(self, now_ns: int, power_w: float, settings: Settings) -> HeaterAnswers:
        """Return the answers after a command [W]; it counts as served while no answer is used."""
        is_refused = self.commanded.heating_for_s(now_ns) >= CONFIRMED_WITHIN_S and self.refusal(now_ns, settings)
        return self._replace(
            refused_until_ns=now_ns + round(REFUSED_S * NS_PER_S) if is_refused else self.refused_until_ns,
            commanded=self.commanded.noted(now_ns, power_w), history=self.history if self.are_used(
                now_ns, settings) else self.history.noted(now_ns, power_w))

    def off_since(self, off_ns: int) -> HeaterAnswers:
        """Return the answers of a source that is off from an instant [ns] on: its lease has ended."""
        return self._replace(
            commanded=self.commanded.noted(off_ns, 0.0), history=self.history.noted(off_ns, 0.0))

    def without_heating(self, now_ns: int) -> HeaterAnswers:
        """Return the answers that count the time of heating from 0 again, because another drive begins."""
        return self._replace(history=self.history.without_heating(now_ns))

    def are_used(self, now_ns: int, settings: Settings) -> bool:
        """Return whether the latest answer is recent and not doubted."""
        return not self.doubt and self._is_recent(now_ns, settings)

    def _is_recent(self, now_ns: int, settings: Settings) -> bool:
        return self.status is not None and abs(
            now_ns - self.status.stamp_ns) <= settings.battery_state_timeout_s * NS_PER_S

    def refusal(self, now_ns: int, settings: Settings, cools: bool = False) -> str:
        """Return the sentence on heat, or cold, that the source refuses at an instant; '' if it does not."""
        status = self.status
        if status is None or not self.are_used(now_ns, settings) or status.has_heat:
            return ''
        if (status.refusal not in HOLD_AT_ONCE and now_ns >= self.refused_until_ns
                and self.commanded.heating_for_s(now_ns) < CONFIRMED_WITHIN_S):
            return ''
        reason = status.sentence or status.refusal.name.lower().replace('_', ' ')
        if status.refusal is Refusal.NOT_REFUSED:
            reason = f'it reports {status.confirmed_w:.0f} W'
        name = 'heater' if self.name == HVCH else self.name
        return f'The {name} does not {"cool" if cools else "heat"} ({status.refusal.name}): {reason.rstrip(".")}.'

    def limited_share(self, now_ns: int, settings: Settings) -> float:
        """Return the share of its command that the source executes while a fault limits it; 1: no fault."""
        status = self.status
        is_limited = (status is not None and status.refusal is Refusal.HEATER_FAULT
                      and 0.0 < status.active_w < status.requested_w and self.are_used(now_ns, settings))
        return status.active_w / status.requested_w if status is not None and is_limited else 1.0

    def judged(self, report: HeaterReport, now_ns: int, settings: Settings) -> tuple[HeaterAnswers, bool]:
        """Return the answers, in doubt if a HeaterReport contradicts them, and whether it falls with them."""
        if self.status is None or report.heater is Heater.ANSWERS or not self.are_used(now_ns, settings):
            return self, False
        doubt = (f'{self._topic} is in doubt: it reports {self.status.confirmed_w:.0f} W, but '
                 f'{IN_WORDS[report.heater]} (probability {100.0 * report.probability:.1f} %); the planner '
                 'goes by battery temperature and power')
        from_ns = now_ns - COMPARED_OVER_NS
        return self._replace(doubt=doubt), abs(self.commanded.mean_w(from_ns, now_ns) - self.history.mean_w(
            from_ns, now_ns)) > LEAST_DIFFERENCE_W

    def on_new_trip(self, now_ns: int) -> HeaterAnswers:
        """Return the answers at the beginning of a trip: they are trusted again, and nothing has been heated."""
        return self._replace(doubt='').without_heating(now_ns)

    def without_instants(self) -> HeaterAnswers:
        """Return the answers without the latest one, because the clock was restarted."""
        return self._replace(status=None, refused_until_ns=0)

    @property
    def are_there(self) -> bool:
        """Whether any answer has arrived, also an unreadable one."""
        return self.status is not None or self.problem != ''

    def silence(self, now_ns: int, settings: Settings) -> str:
        """Return the sentence on a latest answer that is too old at an instant; '' if none is."""
        return '' if self.status is None or self._is_recent(now_ns, settings) else (
            f'{self._topic} is {(now_ns - self.status.stamp_ns) / NS_PER_S:.0f} s old; commands count as served')


class SourcePower(NamedTuple):
    """
    The CommandHistory of a heat source, HeatSource or None: the HVCH, and the share that it delivers.

    inf: it is stuck on.
    """

    source: HeatSource | None = None
    history: CommandHistory = CommandHistory()
    share: float = 1.0

    def hvch_watts(self, ambient_c: float, temperature_c: float) -> float:
        """Return the HVCH power with the heat of a watt, in air and with a battery of temperatures [deg C]."""
        return 1.0 if self.source is None else float(
            self.source.hvch_watts.function(FLOATS)(ambient_c, temperature_c))

    def limit_w(self, hvch_limit_w: float, drive: DriveInputs, temperature_c: float) -> float:
        """Return the most power [W] in a drive, with a battery of a temperature [deg C]; of the HVCH as given."""
        source = self.source
        if source is None:
            return hvch_limit_w
        if not source.serves_at(drive.speed_mps):
            return 0.0
        most_w = float(source.maximum_power_w.function(FLOATS)(drive.ambient_temperature_c, temperature_c))
        return max(0.0, most_w - (float(drive.cabin_heating_power_w) if source.shares_cabin_limit else 0.0))


class SourcePowers(NamedTuple):
    """The SourcePower of each of a vehicle's heat sources, the HVCH first; a battery of a temperature [deg C]."""

    each: tuple[SourcePower, ...] = (SourcePower(),)
    temperature_c: float = 0.0

    def drawn_w(self, instant_ns: int) -> float:
        """Return the electrical power of all at an instant [W]."""
        return sum([each.history.power_w(instant_ns) for each in self.each])

    def heat_w(self, instant_ns: int, ambient_c: float) -> float:
        """Return the heat of all at an instant in air of a temperature [deg C], as HVCH power [W]."""
        return sum([each.hvch_watts(ambient_c, self.temperature_c) * each.history.power_w(instant_ns)
                    for each in self.each])

    def others_w(self, of: int, from_ns: int, to_ns: int, ambient_c: float,
                 limits_w: Sequence[float]) -> tuple[float, float, float]:
        """
        Return the mean powers [W] of all but one source between instants, within limits.

        The HVCH's, the electrical power of the others, and their heat as HVCH power.
        """
        hvch_w = drawn_w = heat_w = 0.0
        for number, each in enumerate(self.each):
            if number != of:
                power_w = limits_w[number] if each.share == inf else (
                    each.share * each.history.mean_w(from_ns, to_ns))
                if each.source is None:
                    hvch_w = power_w
                else:
                    drawn_w += power_w
                    heat_w += power_w * each.hvch_watts(ambient_c, self.temperature_c)
        return hvch_w, drawn_w, heat_w


class Answers(NamedTuple):
    """The HeaterAnswers of a vehicle's heat sources: of the HVCH, and of the `others`."""

    hvch: HeaterAnswers = HeaterAnswers()
    others: tuple[HeaterAnswers, ...] = ()

    def of_vehicle(self, vehicle: Vehicle) -> Answers:
        """Return the answers for another Vehicle, which has other sources beside the HVCH."""
        return self._replace(others=tuple(HeaterAnswers(source.name) for source in vehicle.heat_sources))

    def powers(self, vehicle: Vehicle, temperature_c: float, shares: Mapping[str, float]) -> SourcePowers:
        """Return the SourcePowers of the Vehicle, with the battery at a temperature [deg C] and shares by name."""
        return SourcePowers((SourcePower(None, self.hvch.history, shares.get(HVCH, 1.0)), *(
            SourcePower(source, each.history, shares.get(source.name, 1.0))
            for source, each in zip(vehicle.heat_sources, self.others))), temperature_c)

    @property
    def of_all(self) -> tuple[HeaterAnswers, ...]:
        """The HeaterAnswers of all heat sources, the HVCH first."""
        return self.hvch, *self.others

    def each(self, change: Callable[[HeaterAnswers], HeaterAnswers]) -> Answers:
        """Return the answers with a change of each."""
        return Answers(change(self.hvch), tuple(map(change, self.others)))

    def changed(self, name: str, change: Callable[[HeaterAnswers], HeaterAnswers]) -> Answers:
        """Return the answers with a change of the source of a name, if there is one."""
        return self.each(lambda each: change(each) if each.name == name else each)

    def heated_s(self, now_ns: int, vehicle: Vehicle) -> float:
        """Return for how long [s] the source that heated longest has heated since `without_heating`."""
        heating = [each for each, source in zip(self.others, vehicle.heat_sources) if not source.cools]
        return max(each.history.heated_s(now_ns) for each in (self.hvch, *heating))

    def with_command(self, now_ns: int, command: Command, settings: Settings) -> Answers:
        """Return the answers after a Command, see HeaterAnswers."""
        return self.each(lambda each: each.with_command(now_ns, command.power_w(each.name), settings))
