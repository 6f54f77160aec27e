# SPDX-License-Identifier: Apache-2.0
"""
Divides the heat of a command among the heat sources, by merit and steps, each with a `HeaterSwitch` of its own.

A source with steps runs at the step nearest to its part. Once on it runs at its least power at least, and once off
it rests; the others take its part then. The least time on of the settings holds for each, that off for the HVCH.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple, TYPE_CHECKING, TypeAlias

import numpy as np

from bev_preheat.control.heater_switch import HeaterSwitch
from bev_preheat.numerics import JOULES_PER_WH, NS_PER_S
from bev_preheat.planning.heat_mix import mix_in_segment, parts, Sources
from bev_preheat.planning.status import Status
from bev_preheat.tunables import (
    HELD_ABOVE_TARGET_K,
    HELD_BELOW_HIGHEST_K,
    LEAST_MIXED_SHARE,
    LEAST_SOURCE_W,
    ROUNDING_W,
)
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import HeatSource, HVCH
from bev_preheat.vehicle.heater_controller import Refusal

if TYPE_CHECKING:
    from bev_preheat.control.decision import Decision, Moment
    from bev_preheat.control.inputs import Leg
    from bev_preheat.planning.plan import Plan

# Those of the HVCH and of the sources with least times or a price of a start, by name.
Switches: TypeAlias = tuple[tuple[str, HeaterSwitch], ...]


def at_rest(switches: Switches, now_ns: int) -> Switches:
    """Return Switches that are off from an instant [ns] on; that of all heat stands for the HVCH then."""
    return tuple((name, switch.turned_off(now_ns)) for name, switch in switches if name != HVCH)


class Powers(NamedTuple):
    """Power of the HVCH, and of each other source in use [W], and the Switches after it."""

    hvch_w: float
    sources_w: tuple[tuple[str, float], ...]
    switches: Switches


class HeatDivision:
    """
    The heat sources at a Moment of a Decision.

    `limit_w` is their most heat, `most_cold_w` the most heat that they take from the battery, `held_w` the heat of
    those that must stay on, below 0 if they cool, as HVCH power [W].
    """

    def __init__(self, moment: Moment, decision: Decision, switches: Switches) -> None:
        """Take the Switches before this instant."""
        plan, leg = decision.commanded or decision.plan, decision.leg
        assert plan is not None and leg is not None and decision.vehicle is not None
        self._now_ns, self._plan = moment.now_ns, plan
        hvch = HeatSource(
            HVCH, Table.constant(1.0), Table.constant(1.0), power_steps_w=moment.vehicle.steps_w(HVCH),
            minimum_off_time_s=moment.settings.minimum_off_time_s)
        # Plans of neighbouring instants may differ by a source.
        self._sources = {source.name: replace(source, minimum_on_time_s=max(
            source.minimum_on_time_s, moment.settings.minimum_on_time_s))
            for source in (hvch, *moment.vehicle.heat_sources)}
        self._elapsed_s = (moment.now_ns - decision.plan_start_ns) / NS_PER_S
        segment = leg.route.segment_at((moment.now_ns - leg.start_ns) / NS_PER_S)
        # The heat of a source depends on the battery's temperature: the plan's own, for the division of its heat.
        temperature_c = float(np.interp(self._elapsed_s, plan.time_s, plan.battery_temperature_c))
        share, hvch_w = decision.command_share, heater_limit_w(moment, leg)
        mix = mix_in_segment(decision.vehicle, leg.route, segment, share * hvch_w)
        self._merit, self._by_merit = mix.at(0, temperature_c), mix.by_merit(temperature_c)
        # Of its command that a source delivers; 0 of the HVCH: it is only asked on.
        self._shares = {HVCH: share or 1.0, **{each.name: each.share for each in moment.unserved}}
        # A source that refuses is asked on: it draws nothing until it serves again.
        whole = mix_in_segment(moment.vehicle, leg.route, segment, hvch_w).by_merit(temperature_c)
        refusing = {each.name for each in moment.unserved if each.is_refused} | ({HVCH} if share == 0.0 else set())
        self._asked = {name: most for name, most in whole.items() if name in refusing}
        is_closed = is_gated(moment, float(leg.route.speed_mps[segment]))
        self.limit_w = 0.0 if is_closed else float(self._merit.ends_w[-1])
        self.most_cold_w = -float(self._merit.cold_ends_w[-1]) if mix.cools else 0.0
        self._switches, self._held = dict(switches), dict[str, tuple[float, float]]()
        for source in filter(lambda source: source.is_switched, self._sources.values()):
            self._hold(source, decision.status is Status.OUT_OF_CHARGE or (
                not source.cools and (is_closed or not may_be_held_on(moment, plan))))
        self.held_w: float = sum(heat_w for heat_w, _ in self._held.values())

    def _hold(self, source: HeatSource, is_free: bool) -> None:
        """Turn a source off if it has no power now; hold it if it must stay on, unless it `is_free` to switch."""
        name, switch = source.name, self._switches.get(source.name, HeaterSwitch())
        heat_w, most_w = self._by_merit.get(name, (0.0, 0.0))
        if most_w == 0.0 == self._asked.get(name, (0.0, 0.0))[1]:
            switch = switch.forced_off() if name == HVCH else switch.turned_off(self._now_ns)
        elif is_free and switch.is_on:
            switch = switch.allowed()
        elif most_w > 0.0 and switch.is_on and switch.must_wait(self._now_ns, source.minimum_on_time_s, 0.0):
            most_w /= self._shares.get(name, 1.0)
            least_w = source.power_steps_w[0] if source.power_steps_w else min(
                switch.power_w, most_w * (LEAST_MIXED_SHARE if name == HVCH else 1.0))
            least_w = min(least_w, most_w)
            self._held[name] = heat_w * least_w / most_w, least_w
        self._switches[name] = switch

    def divided(self, heat_w: float) -> Powers:
        """Return the Powers of a heat as HVCH power [W]."""
        heat_w, powers_w = float(self._merit.capped_w(heat_w)), dict[str, float]()
        left_w = heat_w - self.held_w
        for name, (most_heat_w, most_w) in self._by_merit.items():
            held_heat_w, held_w = self._held.get(name, (0.0, 0.0))
            left_w += held_heat_w
            (part_w, part), share = next(parts(left_w, [most_heat_w])), self._shares.get(name, 1.0)
            powers_w[name] = self._switched(name, max(part * most_w / share, held_w), most_w / share, heat_w)
            # Its steps and the next plans give it its part in the mean.
            if powers_w[name] > 0.0:
                left_w -= max(part_w, held_heat_w, key=abs)
            if self._held and abs(left_w) < LEAST_SOURCE_W:
                left_w = 0.0
        for name, (most_heat_w, most_w) in self._asked.items():
            powers_w[name] = self._switched(name, most_w if most_heat_w * heat_w > 0.0 else 0.0, most_w, heat_w)
        return Powers(powers_w.pop(HVCH), tuple(
            (name, power_w) for name, power_w in powers_w.items() if power_w > 0.0), tuple(self._switches.items()))

    def _switched(self, name: str, wanted_w: float, most_w: float, heat_w: float) -> float:
        """Return the command [W] of a source for `wanted_w` of `most_w`, as a part of a heat as HVCH power [W]."""
        source = self._sources[name]
        if source.power_steps_w:
            wanted_w = min((step_w for step_w in (0.0, *source.power_steps_w) if step_w <= most_w + ROUNDING_W),
                           key=lambda step_w: abs(step_w - wanted_w))
        if name not in self._switches:
            return wanted_w
        switch = self._switches[name]
        if not switch.is_on and name not in self._asked and name != HVCH and not self._pays(source, heat_w):
            wanted_w = 0.0
        switch = self._switches[name] = switch.asked(
            self._now_ns, wanted_w, wanted_w, source.minimum_on_time_s, source.minimum_off_time_s)
        return switch.power_w

    def _pays(self, source: HeatSource, heat_w: float) -> bool:
        """
        Return whether a start pays: the plan uses the source for its least time, and that saves the price.

        Heat that the others cannot give pays at any price, also for less time if the arrival ends the use.
        """
        plan = self._plan
        first = int(plan.time_s.searchsorted(self._elapsed_s, side='right')) - 1
        # A plan of a moment ago may have been made without the source.
        power_w = plan.source_power_w.get(source.name, np.zeros(len(plan.command_w)))
        unused = np.flatnonzero(power_w[first:] < LEAST_SOURCE_W)
        lasts_s = plan.time_s.item(first + unused.item(0) if len(unused) else -1) - self._elapsed_s
        is_long = lasts_s >= source.minimum_on_time_s
        if source.switch_on_wh == 0.0 if is_long else len(unused) > 0:
            return is_long
        most = [most for name, most in self._by_merit.items() if name != source.name]
        others = Sources([most_heat_w for most_heat_w, _ in most], [most_w for _, most_w in most], 0)
        saved_w = others.electric_w(heat_w) - self._merit.electric_w(heat_w)
        return (abs(others.capped_w(heat_w) - heat_w) > LEAST_SOURCE_W
                or (is_long and float(saved_w) * lasts_s > source.switch_on_wh * JOULES_PER_WH))


def may_be_held_on(moment: Moment, plan: Plan) -> bool:
    """Return whether a source may heat on for its least time beyond its Plan, because the heat is harmless."""
    assert moment.measurement is not None
    temperature_c = moment.measurement.state.temperature_c
    highest_c = moment.vehicle.battery.temperature_range_c[1]
    return temperature_c <= min(plan.target_temperature_c + HELD_ABOVE_TARGET_K, highest_c - HELD_BELOW_HIGHEST_K)


def heater_limit_w(moment: Moment, leg: Leg) -> float:
    """Return the power of the HVCH that the cabin and the car's gates leave [W] on a leg."""
    vehicle = moment.vehicle
    segment = leg.route.segment_at((moment.now_ns - leg.start_ns) / NS_PER_S)
    cabin_w = float(leg.route.cabin_heating_power_w[segment])
    if is_gated(moment, float(leg.route.speed_mps[segment])):
        return 0.0
    return vehicle.heating_gates.step_below_w(max(0.0, vehicle.hvch.maximum_power_w - cabin_w))


def is_gated(moment: Moment, speed_mps: float) -> bool:
    """Return whether a gate of the car is closed for the measured battery at a speed [m/s]."""
    gates, measurement = moment.vehicle.heating_gates, moment.measurement
    if not gates.is_any:
        return False
    assert measurement is not None
    verdict = gates.verdict(measurement.state.soc, measurement.state.temperature_c, speed_mps)
    return verdict.refusal is not Refusal.NOT_REFUSED
