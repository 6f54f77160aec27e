# SPDX-License-Identifier: Apache-2.0
"""BatteryConditioning of VSS: requests of the cabin as goals, and the state that is reported back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, UTC
import math
from typing import Any

from bev_preheat.errors import InvalidInput, quoted

BRANCH = 'Vehicle.Powertrain.TractionBattery.BatteryConditioning'
MODE, TEMPERATURE, TIME = f'{BRANCH}.RequestedMode', f'{BRANCH}.TargetTemperature', f'{BRANCH}.TargetTime'
IS_ACTIVE, IS_ONGOING = f'{BRANCH}.IsActive', f'{BRANCH}.IsOngoing'
ACTUATORS = (MODE, TEMPERATURE, TIME)
INACTIVE, FAST_CHARGING, DRIVING = 'INACTIVE', 'FAST_CHARGING_PREPARATION', 'DRIVING_PREPARATION'
MODES = (INACTIVE, FAST_CHARGING, DRIVING)
# Targets [deg C] that make sense for a battery; the planner has limits of its own.
LOWEST_C, HIGHEST_C = -40.0, 80.0


@dataclass(frozen=True)
class ConditioningGoal:
    """A battery at `target_c` [deg C] (None: the default) at `ready_at_s` [s since the epoch; 0: soon]."""

    target_c: float | None
    ready_at_s: float


@dataclass(frozen=True)
class ConditioningRequest:
    """The values requested last; MODES has all words for `mode`."""

    mode: str = INACTIVE
    target_c: float | None = None
    ready_at_s: float = 0.0

    def after(self, values: Mapping[str, Any]) -> ConditioningRequest:
        """Return the request after new values by path; raises InvalidInput, one problem per path."""
        mode, target_c, ready_at_s = self.mode, self.target_c, self.ready_at_s
        problems: list[str] = []
        if MODE in values:
            mode = str(values[MODE])
            if mode not in MODES:
                problems.append(f'{MODE}: {quoted(mode)} is not one of {", ".join(MODES)}')
        if TEMPERATURE in values:
            target_c = float(values[TEMPERATURE])
            if not (math.isfinite(target_c) and LOWEST_C <= target_c <= HIGHEST_C):
                problems.append(f'{TEMPERATURE}: {target_c:g} is not allowed; it must be {LOWEST_C:g} ... '
                                f'{HIGHEST_C:g} degC')
        if TIME in values:
            try:
                ready_at_s = instant_of_iso(str(values[TIME]))
            except InvalidInput as error:
                problems.append(f'{TIME}: {error}')
        if not problems and mode == DRIVING and target_c is None:
            problems.append(f'{TEMPERATURE}: is not set; {DRIVING} needs it, because the planner has a default '
                            'for fast charging only')
        if problems:
            raise InvalidInput(problems)
        return ConditioningRequest(mode, target_c, ready_at_s)

    def goal(self) -> ConditioningGoal | None:
        """Return the goal of the request, None while the mode is INACTIVE."""
        return None if self.mode == INACTIVE else ConditioningGoal(self.target_c, self.ready_at_s)

    def values(self) -> dict[str, Any]:
        """Return the request as current values of its paths."""
        values: dict[str, Any] = {MODE: self.mode}
        if self.target_c is not None:
            values[TEMPERATURE] = self.target_c
        if self.ready_at_s:
            at = datetime.fromtimestamp(self.ready_at_s, UTC)
            values[TIME] = at.isoformat(timespec='milliseconds').replace('+00:00', 'Z')
        return values


def instant_of_iso(text: str) -> float:
    """Return an ISO 8601 text as seconds since the epoch, '' as 0; UTC without an offset. Raises InvalidInput."""
    text = text.strip()
    if not text:
        return 0.0
    try:
        moment = datetime.fromisoformat(text)
        instant_s = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError) as error:
        raise InvalidInput(f'{quoted(text)} is no instant in ISO 8601, such as 2026-01-31T06:30:00Z') from error
    if not 0.0 <= instant_s < 2**31:
        raise InvalidInput(f'{quoted(text)} is outside 1970 ... 2038')
    # VSS's own "not set" is the epoch's first instant.
    return instant_s
