# SPDX-License-Identifier: Apache-2.0
"""
Signals in doubt, why and since when; checks of the battery states' source and rate, of voltage and charge.

Two batteries on one topic contradict each other: temperature, charge or voltage jump back and forth between
consecutive messages, faster than any battery can. Or `location` or `serial_number` changes. The traction battery
cannot be distinguished from the other battery.
The terminal voltage lies near U_oc(soc, T) - R(soc, T) I. Vehicle files differ from cars, so the bounds are
wide: they detect another battery, a wrong scale, and a charge that was never set.
A state of charge in per cent lies within 0 ... 1 near empty. Values above 1 are refused. A value below 1 that
follows them has the same scale, unless it continues the last valid value.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

from bev_preheat.errors import quoted
from bev_preheat.numerics import FLOATS
from bev_preheat.tunables import (
    COMPARED_STATES,
    EMPTY_BELOW,
    FROZEN_AFTER_S,
    FULLER_SOC,
    GOES_ON_WITHIN,
    LEAST_JUMPS,
    OTHER_PACK_K,
    OTHER_PACK_SOC,
    OTHER_PACK_VOLTAGE,
    PACK_RATE_K_PER_S,
    SCALE_HOLDS_S,
    SHORT_GAP_S,
    SLOW_GAPS,
    VOLTAGE_WITHIN,
)
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.variants import KEPT_VEHICLES

TEMPERATURE = 'battery_temperature'
STATE_OF_CHARGE = 'state_of_charge'
VOLTAGE = 'voltage'
CURRENT = 'current'
# Which battery the messages come from.
SOURCE = 'source'
# How often they arrive.
FEED = 'feed'
SIGNALS = (TEMPERATURE, STATE_OF_CHARGE, VOLTAGE, CURRENT, SOURCE, FEED)
# Without these the heater is off; voltage and current count as not sent.
NEEDED = frozenset((TEMPERATURE, STATE_OF_CHARGE, SOURCE, FEED))


class SignalVerdict(NamedTuple):
    """
    A signal in doubt (see SIGNALS), the evidence in a sentence, and since when [ns].

    It is shown until an instant [ns]; None: until the signal holds.
    """

    signal: str
    sentence: str
    since_ns: int
    shown_until_ns: int | None = None


@dataclass(frozen=True)
class Doubts:
    """The doubts about signals: a SignalVerdict each, () while every signal holds."""

    verdicts: tuple[SignalVerdict, ...] = ()

    @property
    def needed(self) -> tuple[SignalVerdict, ...]:
        """The SignalVerdicts on signals without which nothing is heated."""
        return tuple([verdict for verdict in self.verdicts if verdict.signal in NEEDED])

    def __contains__(self, signal: str) -> bool:
        """Return whether a signal is in doubt."""
        return any(verdict.signal == signal for verdict in self.verdicts)

    def noted(self, signal: str, sentence: str, now_ns: int, shown_until_ns: int | None = None) -> Doubts:
        """Return the Doubts with the sentence on a signal at an instant [ns]; '' ends its doubt."""
        before = next((verdict for verdict in self.verdicts if verdict.signal == signal), None)
        if not sentence:
            return self if before is None else Doubts(
                tuple([verdict for verdict in self.verdicts if verdict is not before]))
        if before is None:
            return Doubts((*self.verdicts, SignalVerdict(signal, sentence, now_ns, shown_until_ns)))
        noted = before._replace(sentence=sentence, shown_until_ns=shown_until_ns)
        return Doubts(tuple([noted if verdict is before else verdict for verdict in self.verdicts]))

    def at(self, now_ns: int) -> Doubts:
        """Return the Doubts without those that were shown until an instant [ns]."""
        return Doubts(tuple([verdict for verdict in self.verdicts if verdict.shown_until_ns is None
                             or now_ns < verdict.shown_until_ns])) if self.verdicts else self

    def without_instants(self) -> Doubts:
        """Return the Doubts none of which is shown for longer."""
        return Doubts(tuple([verdict if verdict.shown_until_ns is None else verdict._replace(shown_until_ns=0)
                             for verdict in self.verdicts]))


class SeenState(NamedTuple):
    """A battery state: instant [s], temperature [deg C], charge (0 ... 1), voltage [V], name ('': none)."""

    instant_s: float
    temperature_c: float
    soc: float
    voltage_v: float | None
    name: str = ''


class SourceWatch(NamedTuple):
    """
    From which battery the states come; `doubt` is the sentence, '' if it is one battery.

    `before` is the latest state, None if the next one does not follow it. `jumps`: whether each of the latest
    states contradicted the one before.
    """

    doubt: str = ''
    before: SeenState | None = None
    jumps: tuple[bool, ...] = ()

    def without_instants(self) -> SourceWatch:
        """Return the watch whose next state does not follow the latest one."""
        return self._replace(before=None)

    def seen(self, state: SeenState) -> SourceWatch:
        """Return the watch after another state."""
        before = self.before
        if before is None or not 0.0 <= state.instant_s - before.instant_s <= SHORT_GAP_S:
            return self._replace(before=state, jumps=())
        has_jumped = not is_one_battery(before, state)
        doubt, jumps = self.doubt, (*self.jumps, has_jumped)[-COMPARED_STATES:]
        if sum(jumps) >= LEAST_JUMPS:
            doubt = _sentence(before, state, jumps) if has_jumped or not doubt else doubt
        elif not any(jumps) and len(jumps) == COMPARED_STATES:
            doubt = ''
        return SourceWatch(doubt, state, jumps)


def _sentence(one: SeenState, other: SeenState, jumps: tuple[bool, ...]) -> str:
    if _have_other_names(one, other):
        return (f'battery_state comes from two batteries: {quoted(one.name)} and {quoted(other.name)}; remap the '
                'topic to the traction battery')
    share = 100.0 * sum(jumps) / len(jumps)
    jumping = _jumping(one, other)
    # A noisy sensor looks like a second battery that differs in one signal.
    lone = f', or its {jumping[0]} jumps' if len(jumping) == 1 else ''
    return (f'battery_state comes from two batteries{lone}: {share:.0f} % of the readings contradict the one '
            f'before, {_in_words(one)} and {_in_words(other)}; remap the topic to the traction battery')


def is_one_battery(one: SeenState, other: SeenState) -> bool:
    """Return whether two states may be of one battery."""
    return not _have_other_names(one, other) and not _jumping(one, other)


def _have_other_names(one: SeenState, other: SeenState) -> bool:
    # A name that is not given contradicts none: some sources read it now and then.
    return one.name != other.name and '' not in (one.name, other.name)


def _jumping(one: SeenState, other: SeenState) -> list[str]:
    """Return the signals that change from one state to the next faster than those of a battery."""
    elapsed_s = other.instant_s - one.instant_s
    jumps = {
        'temperature': abs(other.temperature_c - one.temperature_c) > max(
            OTHER_PACK_K, PACK_RATE_K_PER_S * elapsed_s),
        'state of charge': abs(other.soc - one.soc) > OTHER_PACK_SOC,
        'voltage': one.voltage_v is not None and other.voltage_v is not None and (
            abs(other.voltage_v - one.voltage_v) > OTHER_PACK_VOLTAGE * max(one.voltage_v, other.voltage_v))}
    return [signal for signal, has_jumped in jumps.items() if has_jumped]


def _in_words(state: SeenState) -> str:
    voltage = '' if state.voltage_v is None else f', {state.voltage_v:.0f} V'
    return f'{state.temperature_c:.1f} degC, {100 * state.soc:.1f} %{voltage}'


class FeedWatch(NamedTuple):
    """
    The time between valid battery states, compared with the allowed time, and whether their values change.

    `latest_s` [s] is the latest state's stamp, None: unknown; `has_expired`: it is too old, and no other has
    arrived. `too_long_s` are the latest gaps that were too long [s], `in_time` is the number of others since.
    `values` are those of the latest state, which have been the same since `same_since_s` [s].
    """

    latest_s: float | None = None
    has_expired: bool = False
    too_long_s: tuple[float, ...] = ()
    in_time: int = 0
    values: tuple[float | None, ...] = ()
    same_since_s: float = 0.0

    def expired(self) -> FeedWatch:
        """Return the watch whose latest state is too old."""
        return self if self.has_expired else self._replace(has_expired=True)

    def without_instants(self) -> FeedWatch:
        """Return the watch that does not know when the latest state arrived."""
        return self._replace(latest_s=None, has_expired=False, values=())

    def seen(self, instant_s: float, values: tuple[float | None, ...]) -> FeedWatch:
        """Return the watch after a state with the stamp `instant_s` [s] and these values."""
        same_since_s = self.same_since_s if values == self.values else instant_s
        watch = self._replace(latest_s=instant_s, has_expired=False, values=values, same_since_s=same_since_s)
        if self.latest_s is None:
            return watch
        if self.has_expired:
            gap_s = instant_s - self.latest_s
            return watch._replace(too_long_s=(*self.too_long_s, gap_s)[-SLOW_GAPS:], in_time=0)
        in_time = self.in_time + 1
        return watch._replace(
            too_long_s=self.too_long_s if self._is_slow and in_time < SLOW_GAPS else (), in_time=in_time)

    @property
    def _is_slow(self) -> bool:
        return len(self.too_long_s) == SLOW_GAPS

    def doubt(self, timeout_s: float, is_driven: bool) -> str:
        """
        Return the sentence on a feed that is in doubt; '' while it is steady.

        Its states are too old after `timeout_s` [s], or frozen: they stay the same although the battery drives.
        """
        same_s = 0.0 if self.latest_s is None else self.latest_s - self.same_since_s
        if is_driven and same_s >= FROZEN_AFTER_S:
            return (f'battery_state has had the same values for more than {FROZEN_AFTER_S:g} s, although by them '
                    'the battery drives the vehicle: its source may hang')
        if not self._is_slow:
            return ''
        every_s = sum(self.too_long_s) / len(self.too_long_s)
        return (f'battery_state arrives every {every_s:.1f} s; battery_state_timeout is {timeout_s:g} s: '
                'raise it, or send battery_state more often')


class ElectricalCheck:
    """Compares voltage and state of charge with the curves of a vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        """Take the curves of a Vehicle."""
        battery = vehicle.battery
        self._voltage_v = battery.open_circuit_voltage.function(FLOATS)
        self._resistance_ohm = battery.resistance.function(FLOATS)
        self._temperatures_c = battery.temperature_range_c

    def voltage_doubt(self, voltage_v: float, current_a: float, temperature_c: float, soc: float) -> str:
        """Return the sentence on a voltage [V] that is not this battery's; '' if it may be."""
        expected_v, drop_v = self._expected(current_a, temperature_c, soc)
        allowed_v = VOLTAGE_WITHIN * expected_v + abs(drop_v)
        if abs(voltage_v - (expected_v - drop_v)) <= allowed_v:
            return ''
        return (f'voltage: {voltage_v:g} V is not that of this battery: {expected_v - drop_v:.0f} V are expected '
                f'at {100 * soc:.1f} % and {current_a:.0f} A, within {allowed_v:.0f} V; voltage and current are '
                'not used')

    def charge_doubt(self, voltage_v: float, current_a: float, temperature_c: float, soc: float) -> str:
        """Return the sentence on a state of charge of 0 that the voltage [V] contradicts; '' if it does not."""
        if soc > EMPTY_BELOW:
            return ''
        empty_v, drop_v = self._expected(current_a, temperature_c, 0.0)
        fuller_v, _ = self._expected(current_a, temperature_c, FULLER_SOC)
        resting_v = voltage_v + drop_v
        if resting_v <= empty_v + 0.5 * (fuller_v - empty_v):
            return ''
        return (f'percentage: {100 * soc:.1f} % contradicts {voltage_v:.1f} V: an empty battery has '
                f'{empty_v - drop_v:.1f} V; the field may not be set')

    def is_nearer(self, voltage_v: float, current_a: float, temperature_c: float, soc: float,
                  other_soc: float) -> bool:
        """Return whether a voltage [V] fits a state of charge better than another."""
        (own_v, drop_v), (other_v, _) = (
            self._expected(current_a, temperature_c, each) for each in (soc, other_soc))
        resting_v = voltage_v + drop_v
        return abs(resting_v - own_v) < abs(resting_v - other_v)

    def _expected(self, current_a: float, temperature_c: float, soc: float) -> tuple[float, float]:
        """Return (open-circuit voltage, voltage drop of a current) [V] at a state within the curves' range."""
        low_c, high_c = self._temperatures_c
        temperature_c = min(max(temperature_c, low_c), high_c)
        return (self._voltage_v(soc, temperature_c),
                self._resistance_ohm(soc, temperature_c) * current_a)


@lru_cache(maxsize=KEPT_VEHICLES)
def electrical_check(vehicle: Vehicle) -> ElectricalCheck:
    """Return the ElectricalCheck of a Vehicle."""
    return ElectricalCheck(vehicle)


class PercentScale(NamedTuple):
    """
    The latest percentages, including refused ones.

    `latest` is the latest one on a scale of 100, at `latest_s` [s], None: a valid one followed. `valid` is the
    latest valid one.
    """

    latest: float | None = None
    latest_s: float = 0.0
    valid: float | None = None

    def refused(self, instant_s: float, percentage: float) -> PercentScale:
        """Return the PercentScale after one was refused at an instant [s]; above 1 it is on a scale of 100."""
        return PercentScale(percentage, instant_s, self.valid) if 1.0 < percentage <= 100.0 else self

    def seen(self, instant_s: float, soc: float, is_vouched_for: Callable[[], bool]) -> tuple[PercentScale, str]:
        """
        Return the PercentScale after a state of charge, and the sentence on one on a scale of 100; '' for none.

        `is_vouched_for()`: the voltage fits the value better than a hundredth of this value.
        """
        before = self.latest
        goes_on = self.valid is not None and abs(soc - self.valid) <= GOES_ON_WITHIN
        if (before is None or goes_on or soc == 0.0
                or not 0.0 <= instant_s - self.latest_s <= SCALE_HOLDS_S or is_vouched_for()):
            return PercentScale(None, 0.0, soc), ''
        return PercentScale(before, instant_s, self.valid), (
            f'percentage: {soc:g} follows {before:g}, which is on a scale of 100; expected 0 ... 1: '
            f'{soc / 100:g}?')
