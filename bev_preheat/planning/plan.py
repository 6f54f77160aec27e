# SPDX-License-Identifier: Apache-2.0
"""The result of planning, of the same type for every method and for the NLP."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, TYPE_CHECKING

from bev_preheat.planning.dynamics import Energies
from bev_preheat.planning.outcome import Stranding
from bev_preheat.planning.schedule import HeatRun, HeldBack
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.heating_intervals import HeatingInterval


@dataclass(frozen=True)
class Plan:
    """
    A heating plan and its predicted outcome; times in seconds after the start of the plan.

    `heating_start_s` is None if the plan does not heat; `heating_end_s` is None if heating ends with a step, as on
    arrival. `shortfall_k` is by how much the target is missed, `soc_shortfall` by how much the reserve is missed,
    `undeliverable_power_w` the power deficit of the battery in the worst step (at `undeliverable_at_s`).
    `sentence` turns the plan into its `explanation` on demand: most plans are followed, not read. `intervals`
    (planning.heating_intervals.HeatingInterval) give the reasons for heating, `held_back`
    (planning.schedule.HeldBack) the reason for not heating more, and `stranding` (planning.outcome.Stranding)
    where the charge runs out, or None. Shapes: `time_s`, `battery_temperature_c` and `soc` (N + 1,);
    `hvch_battery_power_w` (N,), the mean electrical power in each step; `friction_brake_power_w` (N,), the power
    that the friction brake takes because the battery cannot. If the vehicle has a heat path,
    `hvch_battery_power_w` is the command and `heat` (planning.schedule.HeatRun) its outcome; else None.
    `note` is a remark on an installed method's powers, '' without one.
    """

    status: Status
    sentence: Callable[..., str]
    method: str
    target_temperature_c: float
    heating_start_s: float | None
    time_s: FloatArray
    battery_temperature_c: FloatArray
    soc: FloatArray
    hvch_battery_power_w: FloatArray
    friction_brake_power_w: FloatArray
    energy_wh: Energies
    shortfall_k: float
    soc_shortfall: float
    undeliverable_power_w: float
    undeliverable_at_s: float | None
    intervals: tuple[HeatingInterval, ...]
    planning_time_s: float
    heating_end_s: float | None = None
    held_back: HeldBack | None = None
    stranding: Stranding | None = None
    heat: HeatRun | None = None
    note: str = ''

    @cached_property
    def explanation(self) -> str:
        """The outcome of the plan, as a sentence."""
        return self.sentence(self)

    @property
    def drawn_power_w(self) -> FloatArray:
        """The mean power of the heater in each step [W], shape (N,)."""
        return self.hvch_battery_power_w if self.heat is None else self.heat.drawn_power_w

    @property
    def start_state(self) -> BatteryState:
        """The state at the start of the plan, with the heat under way."""
        under_way = () if self.heat is None else (
            float(self.heat.heater_power_w[0]), float(self.heat.coolant_excess_k[0]))
        return BatteryState(float(self.battery_temperature_c[0]), float(self.soc[0]), *under_way)

    @property
    def arrival_time_s(self) -> float:
        """Instant of arrival [s]."""
        return self.time_s.item(-1)

    @property
    def arrival_temperature_c(self) -> float:
        """Battery temperature on arrival [deg C]."""
        return self.battery_temperature_c.item(-1)

    @property
    def arrival_soc(self) -> float:
        """State of charge on arrival, 0 ... 1."""
        return self.soc.item(-1)

    def told(self, status: Status, sentence: Callable[..., str]) -> Plan:
        """Return the plan with another status and sentence; `words` of `explain` is passed on to the latter."""
        return replace(self, status=status, sentence=sentence)

    def power_at_w(self, elapsed_s: float) -> float:
        """
        Return the electrical heater power [W] at an instant [s] of the plan, 0 before it starts.

        In a step with a switching instant it is off before the first instant and after the last one, and at
        full power between them.
        """
        last_s = self.arrival_time_s if self.heating_end_s is None else self.heating_end_s
        if self.heating_start_s is None or not self.heating_start_s <= elapsed_s < last_s:
            return 0.0
        step = int(self.time_s.searchsorted(elapsed_s, side='right')) - 1
        start_s, end_s = self.time_s.item(step), self.time_s.item(step + 1)
        heated_s = min(end_s, last_s) - max(start_s, self.heating_start_s)
        return self.hvch_battery_power_w.item(step) * (end_s - start_s) / heated_s

    def as_dictionary(self) -> dict[str, Any]:
        """Return the plan as `preheat plan --json` writes it: plain numbers, texts and lists."""
        return {
            'status': self.status.name,
            'explanation': self.explanation,
            'method': self.method,
            'target_temperature_c': self.target_temperature_c,
            'heating_start_s': self.heating_start_s,
            'heating_end_s': self.heating_end_s,
            'arrival_time_s': self.arrival_time_s,
            'arrival_temperature_c': self.arrival_temperature_c,
            'arrival_soc': self.arrival_soc,
            'shortfall_k': self.shortfall_k,
            'soc_shortfall': self.soc_shortfall,
            'undeliverable_power_w': self.undeliverable_power_w,
            'undeliverable_at_s': self.undeliverable_at_s,
            'charge_runs_out_at_s': self.stranding and self.stranding.at_s,
            'charge_runs_out_at_m': self.stranding and self.stranding.at_m,
            'lacking_energy_wh': self.stranding.deficit_wh if self.stranding else 0.0,
            'stretches': [{'start_s': interval.start_s, 'end_s': interval.end_s,
                           'energy_wh': interval.energy_wh, 'reason': interval.reason.name}
                          for interval in self.intervals],
            'energy_wh': asdict(self.energy_wh),
            'planning_time_s': self.planning_time_s,
            'time_s': self.time_s.tolist(),
            'battery_temperature_c': self.battery_temperature_c.tolist(),
            'soc': self.soc.tolist(),
            'hvch_battery_power_w': self.hvch_battery_power_w.tolist(),
            'friction_brake_power_w': self.friction_brake_power_w.tolist(),
            **({} if self.heat is None else {'heat': self.heat.as_dictionary()}),
        }
