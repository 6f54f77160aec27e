# SPDX-License-Identifier: Apache-2.0
"""
Planning methods of other packages: entry points of the group `bev_preheat.methods`.

A method is a function of a MethodSituation that returns the heater's power in each step [W], shape (N,). Entry
points are read only if a name is not built in, or if all names are listed: reading takes longer than many plans.
"""
from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
import math
import re
from time import perf_counter
from typing import ClassVar, NamedTuple, Self, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput, LONGEST_PROBLEM, PlanningFailure, quoted, shortened
from bev_preheat.numerics import FloatArray, frozen
from bev_preheat.planning.engine import keep_accounts
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.two_switches import maximum_between
from bev_preheat.tunables import PAUSE_FACTOR, ROUNDING_W

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from numpy.typing import ArrayLike

    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.planning.trip import Trip
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle


@dataclass(frozen=True, eq=False)
class Prediction:
    """
    The model's prediction of a trip under heater powers, within the battery's limits.

    `battery_temperature_c` [deg C] and `soc` (0 ... 1) have shape (N + 1,), at the ends of the steps;
    `hvch_battery_power_w` (N,) is the heater's power in each step after the limits have cut it [W];
    `battery_energy_wh` is the energy from the cells until arrival, including losses [Wh].
    """

    battery_temperature_c: FloatArray
    soc: FloatArray
    hvch_battery_power_w: FloatArray
    battery_energy_wh: float

    @property
    def arrival_temperature_c(self) -> float:
        """Battery temperature on arrival [deg C]."""
        return self.battery_temperature_c.item(-1)

    @property
    def arrival_soc(self) -> float:
        """State of charge on arrival, 0 ... 1."""
        return self.soc.item(-1)


@dataclass(frozen=True, eq=False)
class MethodSituation:
    """
    The situation that a planning method plans for, from now until arrival; all arrays are read-only.

    `vehicle` is the model to plan with, `route` the rest of the route in N steps, `state` the battery's current
    state, `goal` the conditions to meet on arrival. In a running planner, `vehicle` and `state` are estimated and
    the goal's target includes the margin for the uncertainty. `time_s` (N + 1,) are the ends of the steps [s],
    from 0 to the arrival; `heater_limit_w` (N,) is the most electrical power that the heater can give to the
    battery in each step [W], after cabin heating and derating.
    """

    vehicle: Vehicle
    route: Route
    state: BatteryState
    goal: Goal
    time_s: FloatArray
    heater_limit_w: FloatArray
    _trip: Trip

    @classmethod
    def of_trip(cls, trip: Trip, state: BatteryState, goal: Goal) -> Self:
        """Return the MethodSituation of a Trip."""
        # Copies, because the planner uses the originals again for later plans.
        return cls(trip.vehicle, trip.route.read_only(), state, goal, frozen(trip.time_s.copy()),
                   frozen(trip.heater_limit_w.copy()), trip)

    def full_power(self, start_s: float = 0.0, end_s: float = math.inf) -> FloatArray:
        """
        Return the powers (N,) [W] of heating at `heater_limit_w` between two instants [s] of `time_s`.

        A step that is heated in part has its mean. Add the powers of intervals that do not overlap.
        """
        return maximum_between(self._trip, start_s, end_s)

    def predict(self, heater_power_w: ArrayLike) -> Prediction:
        """Return the Prediction for powers (N,) [W], clipped to `heater_limit_w`; raise ValueError for others."""
        schedule = self.driven(checked_powers(heater_power_w, len(self.route)))
        return Prediction(schedule.temperature_c, schedule.soc, schedule.heater_power_w,
                          keep_accounts(self._trip, schedule).energy_wh.battery_total)

    def driven(self, power_w: FloatArray) -> Schedule:
        """Return the planning.schedule.Schedule of checked powers (N,) [W], within heater and battery limits."""
        return drive_as_planned(self._trip, self.state, np.minimum(power_w, self._trip.heater_limit_w))


def checked_powers(answer: ArrayLike, steps: int) -> FloatArray:
    """Return heater powers as an array (N,) [W] of its own; raise ValueError unless finite and positive."""
    given = np.asarray(answer)
    if given.dtype.kind not in 'fiu':
        raise ValueError(f'{type(answer).__name__} of {given.dtype} is not allowed; it must be an array of powers '
                         'in W, one for each step')
    if given.shape != (steps,):
        raise ValueError(f'shape {given.shape} is not allowed; it must be ({steps},), a power in W for each step')
    power_w = given.astype(float)
    bad = ~(np.isfinite(power_w) & (power_w >= -ROUNDING_W))
    if bad.any():
        at, others = int(bad.argmax()), int(bad.sum()) - 1
        more = f' (and {others} more)' if others else ''
        raise ValueError(
            f'{power_w[at]:g} W in step {at} is not allowed; it must be finite and at least 0 W{more}')
    positive_w: FloatArray = np.maximum(power_w, 0.0)
    return positive_w


GROUP = 'bev_preheat.methods'
NAME = re.compile(r'[a-z][a-z0-9_]{0,39}')
# Names of results beside those of methods, and of a method of earlier versions.
TAKEN = frozenset({'merit_order', 'nlp', 'optimum', 'planner', 'replanned_paper', 'no_heating', 'always_on'})
# Anything a method raises; sys.exit in a method must not end the planner.
BROKEN = (Exception, SystemExit)


class Found(NamedTuple):
    """The entry points of usable names, and for each other name the sentence on why it is refused."""

    usable: dict[str, EntryPoint]
    refused: dict[str, str]


def find_methods(built_in: Collection[str]) -> Found:
    """Return the Found entry points of all installed packages; `built_in` names cannot be used again."""
    # Not at the top: the import alone takes as long as hundreds of plans.
    from importlib.metadata import entry_points
    by_name: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=GROUP):
        by_name.setdefault(entry.name, []).append(entry)
    found = Found({}, {})
    for name, entries in sorted(by_name.items()):
        packages = ' and '.join(map(_package_of, entries))
        if name in built_in or name in TAKEN:
            found.refused[name] = f'{name} of {packages} is not used, because the name is built in'
        elif not NAME.fullmatch(name):
            found.refused[name] = (f'{quoted(name)} of {packages} is not used; a name must be lower-case letters, '
                                   'digits and underscores, at most 40, a letter first')
        elif len(entries) > 1:
            found.refused[name] = f'{name} is in {packages}; uninstall all but one'
        else:
            found.usable[name] = entries[0]
    return found


def _package_of(entry: EntryPoint) -> str:
    return 'an unknown package' if entry.dist is None else f'package {entry.dist.name} {entry.dist.version}'


@dataclass(eq=False)
class InstalledMethod:
    """A loaded method: its name, the package that it comes from, and its function."""

    # The longest time that an answer may take [s]; unlimited without a running planner.
    answer_limit_s: ClassVar[float] = math.inf

    name: str
    package: str
    function: Callable[[MethodSituation], ArrayLike]
    _asked_again_s: float = field(default=-math.inf, init=False)
    _late: str = field(default='', init=False)

    def _failure(self, reason: str) -> PlanningFailure:
        return PlanningFailure(shortened(f'method {self.name} of {self.package}: {reason}', LONGEST_PROBLEM))

    def plan(self, trip: Trip, state: BatteryState, goal: Goal, notes: dict[str, None]) -> Schedule:
        """Return the Schedule of the method's powers within the limits; add to `notes`; raise PlanningFailure."""
        situation = MethodSituation.of_trip(trip, state, goal)
        started_s = perf_counter()
        if started_s < self._asked_again_s:
            raise self._failure(self._late)
        failure = None
        try:
            power_w = self.function(situation)
        except BROKEN as error:
            failure = self._failure(f'raised {type(error).__name__}: {error}')
            failure.__cause__ = error
        took_s = perf_counter() - started_s
        if took_s > self.answer_limit_s:
            self._asked_again_s = perf_counter() + PAUSE_FACTOR * took_s
            self._late = (f'took {took_s:.2f} s; at most {self.answer_limit_s:.2g} s are allowed, a tenth of the '
                          'time by which command_lease is longer than command_period')
            failure = self._failure(self._late)
        if failure is not None:
            raise failure
        try:
            checked_w = checked_powers(power_w, len(situation.route))
        except BROKEN as error:
            raise self._failure(f'the answer is refused: {error}') from error
        beyond_w = checked_w - situation.heater_limit_w
        if beyond_w.max() > ROUNDING_W:
            at = int(beyond_w.argmax())
            notes[f'Method {self.name} asked for {checked_w[at]:.0f} W where the heater has '
                  f'{situation.heater_limit_w[at]:.0f} W for the battery; its powers are clipped.'] = None
        return situation.driven(checked_w)


def limit_answer_time(limit_s: float) -> None:
    """Refuse answers of installed methods that take longer [s], from now on in this process."""
    InstalledMethod.answer_limit_s = limit_s


LOADED: dict[str, InstalledMethod] = {}


def use_function(function: Callable[[MethodSituation], ArrayLike]) -> str:
    """Let a function be a method in this process; return its name, which no installed method can have."""
    called = getattr(function, '__name__', type(function).__name__)
    name = f'function {called}'
    LOADED[name] = InstalledMethod(called, 'this program', function)
    return name


def installed_method(name: str, built_in: Collection[str]) -> InstalledMethod:
    """Return the method of a name that is not built in, loaded once; raises InvalidInput."""
    if name in LOADED:
        return LOADED[name]
    found = find_methods(built_in)
    if name in found.refused:
        raise InvalidInput(f'method: {found.refused[name]}')
    if name not in found.usable:
        raise InvalidInput(f'method: {quoted(name)} is not one of {", ".join((*built_in, *found.usable))}')
    entry = found.usable[name]
    about = f'method: {name} of {_package_of(entry)}'
    try:
        function = entry.load()
    except BROKEN as error:
        raise InvalidInput(
            f'{about} cannot be loaded from {entry.value}: {type(error).__name__}: {error}') from error
    if not callable(function):
        raise InvalidInput(f'{about}: {entry.value} is {type(function).__name__}; it must be a function of a '
                           'MethodSituation')
    LOADED[name] = InstalledMethod(name, _package_of(entry), function)
    return LOADED[name]
