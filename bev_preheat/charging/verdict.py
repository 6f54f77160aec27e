# SPDX-License-Identifier: Apache-2.0
"""
Sentences for the driver on heating before the charger: whether it pays, and whether the battery is too warm there.

A battery is too warm once more heat lowers its charging power; the sentence gives the minutes lost.
"""
from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from bev_preheat.charging.equations import supply_of
from bev_preheat.charging.session import charge, Session
from bev_preheat.charging.stop import chance_text, ChargingProspect, ChargingStop
from bev_preheat.charging.target_worth import HEATING, Prices, TargetWorth
from bev_preheat.numerics import ARRAYS, WH_PER_KWH
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.situation import BatteryState
from bev_preheat.vehicle.charging import charging_of, falls_from_c
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import Vehicle

# Colder arrivals are tried in steps of this [K], then of 1 K around the fastest.
STEP_K = 5.0
# Powers that differ by less than this share, or by less than this [W], are alike.
ALIKE_SHARE, ALIKE_W = 1e-3, 50.0
# Less time than this [s] is not worth a sentence.
LEAST_TIME_S = 10.0


@dataclass(frozen=True)
class Derating:
    """
    Heat lowers the charging power: above a battery temperature [deg C], from a state of charge (0 ... 1) on.

    `hottest_c` is the highest battery temperature of the session [deg C].
    """

    above_c: float
    from_soc: float
    hottest_c: float

    @property
    def reason(self) -> str:
        """The reason, as the end of a sentence."""
        return (f'because the power is derated above {self.above_c:g} degC, from '
                f'{100.0 * self.from_soc:.0f} % on')


@dataclass(frozen=True)
class TooWarm:
    """
    A session in which heat lowers the power, against that of the colder arrival that charges fastest.

    `slower_s` [s] is 0 if no colder arrival charges faster, infinite if only a colder one charges to the end.
    Temperatures on arrival [deg C].
    """

    derating: Derating
    arrival_c: float
    fastest_c: float
    slower_s: float

    @property
    def sentence(self) -> str:
        """The answer for the driver."""
        if self.slower_s == 0.0:
            return (f'The battery reaches {self.derating.hottest_c:.0f} degC; at that temperature it charges more '
                    f'slowly, {self.derating.reason}; a colder arrival would not be faster.')
        slower = ('does not charge to the end' if math.isinf(self.slower_s) else
                  f'charges {duration_text(self.slower_s)} slower')
        than = 'as' if math.isinf(self.slower_s) else 'than'
        return (f'Too warm: arriving at {self.arrival_c:.0f} degC {slower} {than} at {self.fastest_c:.0f} degC, '
                f'{self.derating.reason}.')


def derating_in(vehicle: Vehicle, stop: ChargingStop, session: Session) -> Derating | None:
    """Return where heat lowers the charging power of a Session at a ChargingStop, or None."""
    limit = charging_of(vehicle).power_limit
    above_c = falls_from_c(limit) if isinstance(limit, Table) else math.inf
    temperature_c, soc = session.battery_temperature_c, session.soc
    if not temperature_c.max() > above_c:
        return None
    if len(soc) == 1:
        return Derating(above_c, float(soc[0]), float(temperature_c[0]))
    cooler_w = -limit.function(ARRAYS)(soc, np.full(len(soc), above_c))[:-1]
    left_w = supply_of(vehicle, stop) - session.hvch_battery_power_w - session.cooling_power_w
    hot = np.flatnonzero((temperature_c[1:] > above_c) & (
        session.charging_power_w < (1.0 - ALIKE_SHARE) * np.minimum(cooler_w, left_w) - ALIKE_W))
    if not len(hot):
        return None
    return Derating(above_c, float(soc[hot[0]]), float(temperature_c.max()))


def too_warm(vehicle: Vehicle, stop: ChargingStop, session: Session) -> TooWarm | None:
    """
    Return the TooWarm of a Session of a vehicle at a ChargingStop; None if heat does not lower its power.

    Colder arrivals are simulated with the same state of charge, down to the air or the coldest battery allowed.
    """
    derating = derating_in(vehicle, stop, session)
    if derating is None:
        return None
    arrival_c, soc = float(session.battery_temperature_c[0]), float(session.soc[0])
    # Far colder arrivals are slow, because the battery is cold.
    coldest_c = max(vehicle.battery.temperature_range_c[0], min(stop.ambient_c, 0.0))
    times: dict[float, float] = {arrival_c: session.charging_time_s}

    def time_s(at_c: float) -> float:
        if at_c not in times:
            times[at_c] = charge(vehicle, stop, BatteryState(at_c, soc)).charging_time_s
        return times[at_c]

    coarse = [at_c for at_c in np.arange(STEP_K * math.floor(arrival_c / STEP_K), coldest_c, -STEP_K).tolist()
              if at_c <= arrival_c]
    fastest_c = min((*coarse, arrival_c), key=time_s)
    around = [fastest_c + offset for offset in range(1 - int(STEP_K), int(STEP_K))
              if coldest_c <= fastest_c + offset <= arrival_c]
    # The warmest of those that are equally fast: it needs the least cooling.
    best_s = min(map(time_s, (*around, fastest_c)))
    fastest_c = max(at_c for at_c, value in times.items() if value <= best_s)
    slower_s = session.charging_time_s - best_s
    if math.isnan(slower_s) or slower_s < LEAST_TIME_S:
        return TooWarm(derating, arrival_c, arrival_c, 0.0)
    return TooWarm(derating, arrival_c, fastest_c, slower_s)


# Cost differences below this, in any currency, do not matter to a driver.
LEAST_COST_DIFFERENCE = 0.01


def verdict_on(best: TargetWorth, without: TargetWorth, break_even: float, prices: Prices,
               problem: str | None, way: str = HEATING) -> str:
    """
    Return the sentence for the driver; `problem` is why the unheated battery is not charged.

    `break_even` is the least value of time for which heating pays [per h], or infinite; `way`: HEATING, COOLING.
    """
    if math.isinf(best.charging_time_s):
        return f'This charger cannot charge the battery that far, heated or not: {problem}.'
    heating = f'{way} the battery to {best.arrival_temperature_c:.1f} degC before arrival'
    if math.isinf(without.charging_time_s):
        return (f'Worth it: {heating} lets it charge within {duration_text(best.charging_time_s)}; '
                f'without {way}, {problem}.')
    pays_from = f'{way} pays as soon as ' + (
        'your time is worth anything.' if break_even == 0.0 else f'an hour is worth {break_even:.2f} to you.')
    if 0.0 < without.cost - best.cost < LEAST_COST_DIFFERENCE:
        return (f'It makes no difference: {heating} would save less than {LEAST_COST_DIFFERENCE:.2f} in all. Some '
                f'{pays_from}')
    if best is not without:
        pays = ('' if math.isinf(break_even) else
                f' Some {way} pays whatever your time is worth.' if break_even == 0.0 else f' Some {pays_from}')
        return f'Worth it: {heating} {_saved_text(best, without, prices)}.{pays}'
    if math.isinf(break_even):
        return f'Not worth it: {way} before arrival saves neither time nor money at this charger.'
    return f'Not worth it at {prices.time_per_h:.2f} an hour: {pays_from}'


def verdict_in_doubt(sentence: str, prospect: ChargingProspect, pays_from: float, way: str = HEATING) -> str:
    """Return `verdict_on` with the prospect; `pays_from`: the least probability at which some heating pays."""
    if prospect.probability == 1.0 or prospect.wait_s is not None:
        return sentence
    pays = '' if pays_from > 1.0 else (
        f' Some {way} pays at any chance.' if pays_from == 0.0 else
        f' Some {way} pays from {chance_text(pays_from)} chance on.')
    return f'{prospect.in_words} chance of charging: {sentence[0].lower()}{sentence[1:]}{pays}'


def warmer_than(fastest: TargetWorth, hottest: TargetWorth, slower_s: float, derating: Derating) -> str:
    """Return the sentence on the `hottest` arrival that charges slower than the `fastest` by `slower_s` [s]."""
    slower = ('would not charge to the end' if math.isinf(slower_s) else
              f'would charge {duration_text(slower_s)} slower than at {fastest.arrival_temperature_c:.0f} degC')
    return f'Arriving at {hottest.arrival_temperature_c:.0f} degC {slower}, {derating.reason}.'


def _saved_text(best: TargetWorth, without: TargetWorth, prices: Prices) -> str:
    saved_s = without.charging_time_s - best.charging_time_s
    more = prices.energy_per_kwh * (best.bought_energy_wh - without.bought_energy_wh) / WH_PER_KWH
    time = (f'saves {duration_text(saved_s)} at the charger' if saved_s >= 0.0 else
            f'takes {duration_text(-saved_s)} longer at the charger')
    energy = ('costs nothing for energy' if prices.energy_per_kwh == 0.0 else
              f'costs {more:.2f} more for energy' if more >= 0.0 else f'saves {-more:.2f} in energy costs')
    younger = without.ageing_cost - best.ageing_cost
    if younger == 0.0:
        return f'{time} and {energy}'
    ageing = f'saves {younger:.2f} in ageing' if younger > 0.0 else f'costs {-younger:.2f} more for ageing'
    return f'{time}, {energy} and {ageing}'
