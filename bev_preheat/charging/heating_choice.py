# SPDX-License-Identifier: Apache-2.0
"""
The choice at the charger: whether, and up to which temperature, a car that can heats its battery there.

    cost = price · bought energy + value of time · charging time + ageing

Three sessions compete: heating never, heating up to the car's own limit, and heating up to the cheapest limit over
the state of charge (`heating_policy`). Each is simulated by `session`, and the cheapest is chosen, so the choice
never costs more than obeying the car or not heating. In doubt the car does not heat.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
import math
from typing import Any

import numpy as np

from bev_preheat.charging.equations import heated_c
from bev_preheat.charging.heating_policy import ALWAYS, find_policy, HeatingLimit, HeatingPolicy, NEVER
from bev_preheat.charging.session import charge, Session
from bev_preheat.charging.stop import ChargingStop, check_stop
from bev_preheat.charging.target_worth import Prices
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.situation import BatteryState
from bev_preheat.vehicle.charging import charging_of
from bev_preheat.vehicle.description import Vehicle

# More heating must save more than this share of the cost.
LEAST_SAVING_SHARE = 1e-5
# Estimates of the policy are at most this share of a cost away from the sessions'.
ESTIMATE_SHARE = 0.02
# The cheapest limit is tried shifted by these [K], because it lies between the columns of the policy's grid.
SHIFTS_K = (-0.2, 0.15, 0.35)
# Charge spent on heating before arrival, and by how much an arrival may be colder than the first one.
LOWER_SOC, COLDER_K = 0.06, 0.5
# Mean heater power of a step [W] below which it counts as unheated.
HEATED_FROM_W = 1.0
# Smaller differences of cost, in any currency, are not reported.
LEAST_TOLD = 0.005


class HeatingDecision(Enum):
    """A decision on heating the battery at the charger."""

    UNABLE = 'unable'
    NEVER = 'never'
    ALWAYS = 'always'
    LIMITED = 'limited'


@dataclass(frozen=True, eq=False)
class HeatingChoice:
    """
    The chosen HeatingDecision, its HeatingLimit, Session and cost.

    `cost_never` and `cost_always` are those of no heating and of heating up to the car's own limit; infinite if
    the session never ends, NaN if only estimates showed that they are higher. `problem_never` is why the unheated
    battery is not charged to the end, or None.
    """

    decision: HeatingDecision
    limit: HeatingLimit
    session: Session
    cost: float
    cost_never: float
    cost_always: float
    problem_never: str | None = None

    @property
    def heated_wh(self) -> float:
        """Electrical energy of the battery's heating at the charger [Wh]."""
        return self.session.energy_wh.hvch_electric

    @property
    def until_s(self) -> float | None:
        """End of the last heating [s after plugging in]; None: no heating."""
        places = self._heated_steps
        return float(self.session.time_s[places[-1] + 1]) if len(places) else None

    @property
    def until_c(self) -> float | None:
        """Highest temperature [deg C] at the ends of heated steps; None: no heating."""
        places = self._heated_steps
        return float(self.session.battery_temperature_c[places + 1].max()) if len(places) else None

    @property
    def _heated_steps(self) -> Any:
        return np.flatnonzero(self.session.hvch_battery_power_w > HEATED_FROM_W)

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as JSON-compatible data; unknown costs are null."""
        return {'decision': self.decision.value, 'until_s': self.until_s, 'until_c': self.until_c,
                'hvch_electric_wh': self.heated_wh, 'cost': self.cost,
                'cost_never': None if math.isnan(self.cost_never) else self.cost_never,
                'cost_always': None if math.isnan(self.cost_always) else self.cost_always}

    def sentence(self) -> str:
        """Return the sentence for the driver; '' for a car that cannot heat at the charger."""
        if self.decision is HeatingDecision.UNABLE or math.isinf(self.cost):
            return ''
        until_s, until_c = self.until_s, self.until_c
        if self.decision is HeatingDecision.NEVER or until_s is None or until_c is None:
            return f'At the charger the battery is not heated{self._more("always heating", self.cost_always)}.'
        how = (f'up to {until_c:.1f} degC, for the last time after {duration_text(until_s)}'
               if self.decision is HeatingDecision.LIMITED else f'up to {until_c:.1f} degC')
        if self.problem_never is not None:
            soc = 100.0 * float(self.session.soc[-1])
            return (f'At the charger the battery is heated {how}: heated it reaches {soc:.0f} % in '
                    f'{duration_text(self.session.charging_time_s)}; unheated it never does, because '
                    f'{self.problem_never}.')
        more = self._more('no heating', self.cost_never)
        if self.decision is HeatingDecision.LIMITED:
            more += self._more("heating up to the car's limit", self.cost_always)
        return f'At the charger the battery is heated {how}{more}.'

    def _more(self, name: str, cost: float) -> str:
        if math.isnan(cost) or cost - self.cost < LEAST_TOLD:
            return ''
        return f'; {name} would cost {cost - self.cost:.2f} more' if math.isfinite(cost) else (
            f'; with {name} the session would never end')


class ChargerHeating:
    """The choices at one charger, for one vehicle and one pair of prices; the policy is computed once."""

    def __init__(self, vehicle: Vehicle, stop: ChargingStop, prices: Prices) -> None:
        """Take the vehicle, the stop and the prices; nothing is computed yet."""
        self._vehicle, self._stop, self._prices = vehicle, stop, prices
        self._policy: HeatingPolicy | None = None
        self._from_c = math.inf
        self._choices: dict[BatteryState, HeatingChoice] = {}

    def choose(self, state: BatteryState) -> HeatingChoice:
        """Return the HeatingChoice from a BatteryState on arrival; raises what `session.charge` raises."""
        if state not in self._choices:
            self._choices[state] = self._choice(state, is_thorough=False)
        return self._choices[state]

    def compare(self, state: BatteryState) -> HeatingChoice:
        """Return the HeatingChoice from a BatteryState with the costs of all decisions simulated."""
        return self._choice(state, is_thorough=True)

    def cost(self, session: Session) -> float:
        """Return the cost of a Session."""
        return self._prices.cost(session.bought_energy_wh, session.charging_time_s) + session.ageing_cost

    def _session(self, state: BatteryState, limit: HeatingLimit) -> tuple[float, Session]:
        session = charge(self._vehicle, self._stop, state, heating=limit)
        return self.cost(session), session

    def _choice(self, state: BatteryState, is_thorough: bool) -> HeatingChoice:
        check_stop(self._vehicle, self._stop, state)
        policy = self._policy_from(state)
        if policy is None:
            cost, session = self._session(state, ALWAYS)
            is_able = bool(charging_of(self._vehicle).battery_heating)
            decision = HeatingDecision.NEVER if is_able else HeatingDecision.UNABLE
            return HeatingChoice(decision, NEVER, session, cost, cost, cost, session.problem)
        cost, session = self._session(state, policy.limit)
        chosen = HeatingDecision.LIMITED, policy.limit, session, cost
        others = {}
        # The simpler decision wins unless the other saves something.
        for decision, limit, estimates in (
                (HeatingDecision.ALWAYS, ALWAYS, policy.cost_always),
                (HeatingDecision.NEVER, NEVER, policy.cost_never)):
            if is_thorough or not self._is_dearer(policy, estimates, state, chosen[3]):
                cost, session = self._session(state, limit)
                others[decision] = session
                if math.isfinite(cost) and cost <= chosen[3] * (1.0 + LEAST_SAVING_SHARE):
                    chosen = decision, limit, session, cost
        if math.isinf(chosen[3]):
            # The session with the most charge says why none ends: heat may take the little power there is.
            decision, session = max(others.items(), key=lambda item: float(item[1].soc[-1]))
            limit = ALWAYS if decision is HeatingDecision.ALWAYS else NEVER
            chosen = decision, limit, session, chosen[3]
        never, always = (math.nan if decision not in others else self.cost(others[decision])
                         for decision in (HeatingDecision.NEVER, HeatingDecision.ALWAYS))
        unheated = others.get(HeatingDecision.NEVER)
        return HeatingChoice(*chosen, never, always, None if unheated is None else unheated.problem)

    def _is_dearer(self, policy: HeatingPolicy, estimates: Any, state: BatteryState, cost: float) -> bool:
        """Return whether the estimates alone show that a decision costs more than `cost`."""
        reached_c = heated_c(self._vehicle, state.temperature_c, state.heater_power_w, state.coolant_excess_k)
        return policy.cost_at(estimates, state.soc, float(reached_c)) > (1.0 + ESTIMATE_SHARE) * cost

    def _policy_from(self, state: BatteryState) -> HeatingPolicy | None:
        """Return the HeatingPolicy, found from the coldest arrival so far."""
        if state.temperature_c < self._from_c - COLDER_K:
            self._from_c = state.temperature_c
            policy = find_policy(self._vehicle, self._stop, self._prices,
                                 max(0.0, state.soc - LOWER_SOC), state.temperature_c)
            self._policy = None if policy is None else self._shifted(policy, state)
        return self._policy

    def _shifted(self, policy: HeatingPolicy, state: BatteryState) -> HeatingPolicy:
        """Return the HeatingPolicy with its limit shifted to the least cost from a state."""
        limits = [policy.limit, *(policy.limit.shifted(shift_k) for shift_k in SHIFTS_K)]
        return replace(policy, limit=min(limits, key=lambda limit: self._session(state, limit)[0]))
