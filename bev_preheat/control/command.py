# SPDX-License-Identifier: Apache-2.0
"""
The one gate between plans and the heater: 0 W unless every condition for heating holds.

`Commander` turns a decision into a command with a lease; an obstacle (`decision.find_obstacle`) outranks it.
It is a value: each command makes another one.
Nothing is planned here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from bev_preheat.control.decision import Command, Decision, Moment
from bev_preheat.control.events import BATTERY_STATE, ROUTE_PLAN
from bev_preheat.control.heat_division import (
    at_rest,
    HeatDivision,
    heater_limit_w,
    is_gated,
    may_be_held_on,
    Powers,
    Switches,
)
from bev_preheat.control.heater_switch import HeaterSwitch
from bev_preheat.control.settings import Settings
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.status import LATER, Status
from bev_preheat.tunables import LEAST_STATUS_S, ROUNDING_W
from bev_preheat.vehicle.description import Vehicle


class SteadyStatus(NamedTuple):
    """
    The status that is shown; instants in nanoseconds.

    Doubt, the driver and the heater's switching show at once. Another status than `shown` has been wanted since
    `differs_since_ns`, None: none is. `was_on`: the heater was on.
    """

    shown: Status | None = None
    differs_since_ns: int | None = None
    was_on: bool = False

    def forgotten(self) -> SteadyStatus:
        """Return the state in which the next status is shown at once."""
        return SteadyStatus(was_on=self.was_on)

    def settled(self, now_ns: int, status: Status, is_on: bool) -> SteadyStatus:
        """Return the state with the status to show for a `status` of now; `is_on`: the heater is on."""
        shown = self.shown
        # After a clock that was set back the time begins again.
        since_ns = now_ns if self.differs_since_ns is None else min(now_ns, self.differs_since_ns)
        if (shown is None or status is shown or is_on is not self.was_on
                or not (shown.meaning.is_of_plan and status.meaning.is_of_plan)
                or now_ns - since_ns >= LEAST_STATUS_S * NS_PER_S):
            return SteadyStatus(status, None, is_on)
        return SteadyStatus(shown, since_ns, is_on)


class Commander(NamedTuple):
    """
    Gives the heater's commands and remembers them; instants in nanoseconds.

    `switch` has the least times on and off, for the heat of all sources as HVCH power. `doubt` is the reason for
    the latest pause; `is_paused`: requested heat waits for its end. `reason` is that of the latest command that a
    plan gave, with its `words`; None: the heater was off for another reason. `cools`: the switch is for cooling.
    `sources` are the Switches of single sources.
    """

    switch: HeaterSwitch = HeaterSwitch()
    doubt: Status = Status.WAITING
    is_paused: bool = False
    steady: SteadyStatus = SteadyStatus()
    reason: Status | None = None
    words: str = ''
    cools: bool = False
    sources: Switches = ()

    @property
    def direction(self) -> int:
        """The direction of heat: 1 if the switch is on and heats, -1 if it cools, else 0."""
        return 0 if not self.switch.is_on else -1 if self.cools else 1

    def free_to_switch(self) -> Commander:
        """Return the Commander that may switch at once: the reason for its waiting time no longer holds."""
        return self._replace(switch=self.switch.allowed(), steady=self.steady.forgotten())

    def off(self, now_ns: int, settings: Settings, reason: Status,
            sentence: str = '') -> tuple[Commander, Command]:
        """Return the Commander with a Command of 0 W for a reason, and the sentence on it, and that Command."""
        switch, doubt = self.switch, self.doubt
        if reason.meaning.is_doubt:
            switch, doubt = switch.doubted(now_ns, _cause_in_words(reason, sentence)), reason
        elif reason.meaning.ends_by_plan:
            switch = switch.turned_off(now_ns)
        else:
            switch = switch.forced_off()
        return self._replace(
            switch=switch, doubt=doubt, steady=self.steady.forgotten(), reason=None,
            sources=at_rest(self.sources, now_ns)), Command(
                0.0, now_ns + round(settings.command_lease_s * NS_PER_S), reason)

    def in_words(self, moment: Moment, decision: Decision) -> tuple[Commander, Decision]:
        """
        Return a Decision with the status and the sentence of the command that was given for it at a Moment.

        They are its own unless a pause keeps the heater off, its least time keeps it on or off, or another
        status has held for a moment only. The Commander that is returned with it remembers the sentence.
        """
        plan = decision.commanded or decision.plan
        if plan is None or self.reason is None:
            return self, decision
        settings, switch = moment.settings, self.switch
        left_s = switch.held_for_s(moment.now_ns, settings.minimum_on_time_s, settings.minimum_off_time_s)
        own = decision.explanation
        status, words = self.reason, own
        if self.is_paused:
            words = f'{switch.pause.sentence} {words}'
            status = LATER.get(decision.status, decision.status)
        elif switch.is_held:
            what, aim = (('cooling', f'at most {plan.maximum_arrival_temperature_c:.1f}') if self.cools else
                         ('heater', f'target {plan.target_temperature_c:.1f}'))
            words = (f'The {what} stays on for its minimum time, {left_s:.0f} s more: arrival at '
                     f'{plan.arrival_temperature_c:.1f} degC, {aim} degC.')
        elif decision.status in LATER and not switch.is_on:
            what = 'cooling' if decision.status is Status.COOLING else 'heater'
            words = f'The {what} stays off for its minimum time, {left_s:.0f} s more. {words}'
        elif status is not decision.status:
            words = self.words or words
        commander = self if words == self.words else self._replace(words=words)
        if (status, words) == (decision.status, own):
            return commander, decision
        return commander, replace(decision, status=status, sentence=words)

    def give(self, moment: Moment, decision: Decision, obstacle: Decision | None) -> tuple[Commander, Command]:
        """Return the Command for a Decision without an obstacle, and the Commander after it."""
        commander, now_ns = self._replace(is_paused=False), moment.now_ns
        decision = obstacle or decision
        has_departed = bool(decision.later_legs) and now_ns >= decision.later_legs[0].start_ns
        if decision.charger_heat_w > 0.0 and not has_departed:
            return commander._heat_at_charger(moment, decision)
        reason = self._reason_for_off(now_ns, decision)
        if reason is not None:
            return commander.off(now_ns, moment.settings, reason, decision.explanation)
        return commander._follow_plan(moment, decision)

    def _follow_plan(self, moment: Moment, decision: Decision) -> tuple[Commander, Command]:
        """Return the Command of a Decision with a plan that may heat or cool, and the Commander after it."""
        settings, switch, now_ns = moment.settings, self.switch, moment.now_ns
        plan = decision.commanded or decision.plan
        assert plan is not None and decision.leg is not None
        # A partial step's power is computed and may round to slightly more than the limit.
        share = decision.command_share
        sources = HeatDivision(moment, decision, self.sources) if plan.source_power_w else None
        limit_w = heater_limit_w(moment, decision.leg) if sources is None else sources.limit_w
        elapsed_s = (now_ns - decision.plan_start_ns) / NS_PER_S
        planned_w = plan.power_at_w(elapsed_s)
        if sources is not None and sources.held_w != 0.0:
            planned_w = max(planned_w, sources.held_w) if sources.held_w > 0.0 else min(planned_w, sources.held_w)
        cools = planned_w < 0.0
        if cools:
            assert sources is not None
            planned_w, limit_w = -planned_w, sources.most_cold_w
        if cools is not self.cools and switch.is_on:
            switch = switch.turned_off(now_ns)
        wanted_w = min(planned_w if sources is not None else _step_below_w(
            moment.vehicle, planned_w / share), limit_w)
        if wanted_w == 0.0 and decision.status is Status.OUT_OF_CHARGE:
            # Not even for the heater's minimum time on: each watt-hour is needed to get further.
            return self.off(now_ns, settings, decision.status)
        if wanted_w == 0.0 and not may_be_held_on(moment, plan):
            switch = switch.turned_off(now_ns)
        switch = switch.asked(
            now_ns, wanted_w, limit_w, settings.minimum_on_time_s, settings.minimum_off_time_s)
        power_w, reason = switch.power_w, decision.status
        powers = Powers(power_w, (), at_rest(self.sources, now_ns))
        if sources is not None and power_w > 0.0:
            powers = sources.divided(-power_w if cools else power_w)
            power_w = power_w if powers.hvch_w > 0.0 or powers.sources_w else 0.0
        active = Status.COOLING if cools else Status.HEATING
        is_paused = wanted_w > 0.0 and power_w == 0.0 and switch.pause.left_s > 0.0
        if is_paused:
            reason = self.doubt if switch.pause.is_for_doubt else LATER[active]
        elif power_w > 0.0 and reason in (*LATER.values(), Status.NOT_NEEDED):
            reason = active
        elif power_w == 0.0:
            reason = LATER.get(reason, reason)
        steady = self.steady.forgotten() if switch.is_held else self.steady
        steady = steady.settled(now_ns, reason, power_w > 0.0)
        assert steady.shown is not None
        return self._replace(
            switch=switch, is_paused=is_paused, steady=steady, reason=steady.shown, cools=cools,
            sources=powers.switches), Command(
                powers.hvch_w, _lease_end_ns(moment), steady.shown, powers.sources_w)

    def _heat_at_charger(self, moment: Moment, decision: Decision) -> tuple[Commander, Command]:
        """Return the Command of a Decision that heats while the vehicle charges, and the Commander after it."""
        settings, now_ns = moment.settings, moment.now_ns
        wanted_w = 0.0 if is_gated(moment, 0.0) else moment.vehicle.heating_gates.step_below_w(
            decision.charger_heat_w)
        switch = self.switch.asked(
            now_ns, wanted_w, wanted_w, settings.minimum_on_time_s, settings.minimum_off_time_s)
        return self._replace(
            switch=switch, cools=False, sources=at_rest(self.sources, now_ns)), Command(
            switch.power_w, _lease_end_ns(moment), decision.status)

    @staticmethod
    def _reason_for_off(now_ns: int, decision: Decision) -> Status | None:
        """Return the Status that keeps the heater off under a Decision; None if it may heat."""
        plan = decision.commanded or decision.plan
        if plan is None:
            return decision.status
        elapsed_s = (now_ns - decision.plan_start_ns) / NS_PER_S
        if elapsed_s >= plan.arrival_time_s:
            return Status.CHARGING if decision.later_legs else Status.ARRIVED
        # No heating before the trip begins, without planned charging, or if heating for it does not pay.
        if elapsed_s < 0.0 or decision.status in (
                Status.NO_CHARGING_PLANNED, Status.NOT_WORTH_IT):
            return decision.status
        return None


def _cause_in_words(reason: Status, sentence: str) -> str:
    """Return the cause of a pause, for a sentence that continues with its age."""
    if reason is Status.INVALID_INPUT:
        for source in (BATTERY_STATE, ROUTE_PLAN):
            if sentence.startswith(f'{source} refused'):
                return f'{source} was refused'
        return 'A signal was in doubt' if sentence.startswith('Signal in doubt') else 'The input was refused'
    return reason.meaning.cause


def _lease_end_ns(moment: Moment) -> int:
    """Return the instant [ns] until which a command of a Moment may be used."""
    settings, measurement = moment.settings, moment.measurement
    assert measurement is not None
    # No lease outlives the battery state that it is based on.
    return min(moment.now_ns + round(settings.command_lease_s * NS_PER_S),
               measurement.expires_ns(settings.battery_state_timeout_s))


def _step_below_w(vehicle: Vehicle, power_w: float) -> float:
    """Return the heater's step of power for a plan's power [W], which may round to slightly less than a step."""
    gates = vehicle.heating_gates
    return power_w if not gates.power_steps_w else gates.step_below_w(power_w + ROUNDING_W)
