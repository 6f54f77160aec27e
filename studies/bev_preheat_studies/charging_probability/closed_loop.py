# SPDX-License-Identifier: Apache-2.0
"""
Drives under the planner that may not end at the charger: always heated, never heated, and by expected cost.

Each drive is simulated once for each way of planning, with the same sensor noise. Whether the vehicle charges
is decided on arrival, so it does not change the drive: the cost of a drive is the mean of both outcomes,
weighted by the probability, which has less noise than drawn outcomes. Differences between two ways are taken
drive by drive.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import count
import math
from typing import Any, TYPE_CHECKING

from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.prospect import CERTAIN, ChargingProspect
from bev_preheat.charging.stop import Charger
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics.arithmetic import FLOATS
from bev_preheat.planning.planner import plan_unheated
from bev_preheat.planning.situation import BatteryState
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.simulation.supervised_drive import moments
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat_studies.kept_results import Kept
from bev_preheat_studies.numbered import run_numbered
from bev_preheat_studies.optimality.charging_trips import draw_charging_trip
from bev_preheat_studies.workers import Workers

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bev_preheat_studies.optimality.charging_trips import ChargingTrip

PROBABILITIES = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 0.95)
# Battery states of the simulated car, and its planner's times that go with them [s].
PERIOD_S, LEASE_S = 5.0, 12.0
SENSORS = Sensors(temperature_noise_k=0.2, temperature_resolution_k=0.1, period_s=PERIOD_S)
J_PER_WH = 3600.0


@dataclass(frozen=True)
class Outcome:
    """The costs of a drive if it ends with charging, and if not; and how often the heater was switched on."""

    charged: float
    not_charged: float
    switch_ons: int

    def cost(self, probability: float) -> float:
        """Return the expected cost for a probability of charging (0 ... 1)."""
        return probability * self.charged + (1.0 - probability) * self.not_charged


@dataclass(frozen=True)
class Driven:
    """The Outcomes of one drive: always heated, never heated, and by expected cost for each of PROBABILITIES."""

    number: int
    always: Outcome | None = None
    never: Outcome | None = None
    expected: tuple[Outcome, ...] = ()


def drive(drawn: ChargingTrip, prospect: ChargingProspect | None) -> tuple[BatteryState, int]:
    """Return the BatteryState on arrival and the switch-ons under the planner; `prospect` None: never heated."""
    goal = replace(drawn.goal, target_temperature_c=math.nan, charging_planned=prospect is not None)
    car = ImperfectCar(
        drawn.vehicle, drawn.route, drawn.state, goal, Imperfections(sensors=SENSORS), [drawn.seed, drawn.number],
        charger=Charger(drawn.stop.charger_power_w, drawn.stop.departure_soc), prospect=prospect or CERTAIN)
    supervisor = Supervisor(drawn.vehicle, Settings(
        command_period_s=PERIOD_S, lease_s=LEASE_S, battery_state_timeout_s=LEASE_S,
        energy_price_per_kwh=drawn.prices.energy_per_kwh, value_of_time_per_h=drawn.prices.time_per_h))
    was_on, switch_ons = False, 0
    for moment in moments(car, supervisor, lambda: car.is_over):
        command = moment.output.command
        if command is not None:
            switch_ons += command.battery_heating_power_w > 0.0 and not was_on
            was_on = command.battery_heating_power_w > 0.0
    report = car.reports[0]
    return BatteryState(report.temperature_c, report.soc), switch_ons


def outcome(drawn: ChargingTrip, heating: ChargerHeating, arrival: BatteryState, switch_ons: int,
            unheated_soc: float) -> Outcome:
    """Return the Outcome of an arrival with a BatteryState; the unheated one arrives with `unheated_soc`."""
    session = heating.choose(arrival).session
    battery = drawn.vehicle.battery
    voltage_v = battery.open_circuit_voltage.function(FLOATS)(
        0.5 * (arrival.soc + unheated_soc), arrival.temperature_c)
    return Outcome(drawn.prices.cost(session.bought_energy_wh, session.charging_time_s), drawn.prices.cost(
        (unheated_soc - arrival.soc) * battery.capacity_as * voltage_v / J_PER_WH, 0.0), switch_ons)


def compare_ways(seed: int, number: int) -> Driven:
    """Return the Driven of a drive of the study; without Outcomes if it cannot be driven or charged unheated."""
    drawn = draw_charging_trip(seed, number)
    # The account needs no heat under way.
    drawn = replace(drawn, vehicle=replace(drawn.vehicle, heat_path=HeatPath()))
    heating = ChargerHeating(drawn.vehicle, drawn.stop, drawn.prices)
    try:
        if plan_unheated(drawn.vehicle, drawn.route, drawn.state, drawn.goal).stranding is not None:
            return Driven(number)
        unheated, _ = drive(drawn, None)
        never = outcome(drawn, heating, unheated, 0, unheated.soc)
        if math.isinf(never.charged):
            return Driven(number)

        def under(prospect: ChargingProspect) -> Outcome:
            return outcome(drawn, heating, *drive(drawn, prospect), unheated.soc)

        return Driven(number, under(CERTAIN), never, tuple(under(ChargingProspect(p)) for p in PROBABILITIES))
    except InvalidInput:
        # It arrives with enough charge, or outside the vehicle's range.
        return Driven(number)


def driven_from(record: dict[str, Any]) -> Driven:
    """Return a Driven from its record in a file of results."""
    always, never = (None if way is None else Outcome(**way) for way in (record['always'], record['never']))
    return Driven(record['number'], always, never, tuple(Outcome(**way) for way in record['expected']))


def run_drives(drives: int, seed: int, jobs: int | None, report: Callable[[Driven], object],
               kept: Kept[Driven] | None = None) -> None:
    """Drive until `drives` drives are compared; `report` takes each Driven in order, `kept` are earlier ones."""
    compared, kept = 0, kept or Kept()
    with Workers(jobs) as workers:
        for driven in run_numbered(workers, partial(compare_ways, seed), count(), kept.finished, kept.keep):
            report(driven)
            compared += driven.never is not None
            if compared >= drives:
                return


def difference(costs: Sequence[float], others: Sequence[float]) -> tuple[float, float]:
    """Return the mean of costs - others, pairwise, and half the width of its 95 % confidence interval."""
    pairs = [cost - other for cost, other in zip(costs, others)]
    mean = math.fsum(pairs) / len(pairs)
    if len(pairs) < 2:
        return mean, math.inf
    variance = math.fsum((pair - mean)**2 for pair in pairs) / (len(pairs) - 1)
    return mean, 1.96 * math.sqrt(variance / len(pairs))
