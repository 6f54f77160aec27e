# SPDX-License-Identifier: Apache-2.0
"""
Calls of the native core, with arrays in and out: planning, and the estimation's filters; core.h documents them.

Each raises Declined if the core does not answer.
"""

from __future__ import annotations

from ctypes import addressof, byref, c_double, c_int32
from functools import lru_cache
from struct import Struct as Packed
from typing import Any, NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.vehicle.core_library import call, core, Declined, EMPTY, LEFT
from bev_preheat.vehicle.core_structs import (
    address_of,
    BeliefStruct,
    DOUBLE_BYTES,
    doubles,
    DRIVE_COLUMNS,
    ELEMENTS,
    ENERGIES,
    ExpectedDriveStruct,
    MOST_HEATERS,
    NativeVehicle,
    NotDescribed,
    PassedStruct,
    ReadingStruct,
    room,
    RunOfPowersStruct,
    StrandingStruct,
    SwitchPlanStruct,
    TripTermsStruct,
    ValueGoalStruct,
)
from bev_preheat.vehicle.model import make_euler, make_midpoint, make_runge_kutta_4, TRIP_COLUMNS, TripColumns
from bev_preheat.vehicle.variants import KEPT_VEHICLES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bev_preheat.numerics import FloatArray
    from bev_preheat.vehicle.core_structs import BeliefTermsStruct, NativeTrip
    from bev_preheat.vehicle.description import Leakage, Vehicle
    from bev_preheat.vehicle.model import Integrator
    from bev_preheat.vehicle.variants import DriveInputs

INTEGRATORS: dict[Integrator, int] = {make_euler: 0, make_midpoint: 1, make_runge_kutta_4: 2}
FLOAT = np.dtype(float)
# Here memory is cheaper than computing values twice.
ALL_KEPT = 1


def check_vehicle(vehicle: NativeVehicle) -> None:
    """Do nothing if the core takes a vehicle's numbers, down to its tables."""
    call('bev_check_vehicle', vehicle.address)


def vehicle_in_core(vehicle: Vehicle) -> NativeVehicle:
    """Return the vehicle as a native struct; raises Declined if the core is not used, or cannot take it."""
    # The cache must not depend on whether the core is switched off for a while.
    native = None if core() is None else _native_vehicle(vehicle)
    if native is None:
        raise Declined
    return native


@lru_cache(maxsize=KEPT_VEHICLES)
def _native_vehicle(vehicle: Vehicle) -> NativeVehicle | None:
    try:
        native = NativeVehicle(vehicle)
        check_vehicle(native)
    except (NotDescribed, Declined):
        return None
    return native


def make_trip(terms: Sequence[float], route: FloatArray) -> TripColumns:
    """
    Return the columns of a route, whose columns (8, N) are given in their order; `terms` as of TripTermsStruct.

    Declined also if a step is too long for the integrators.
    """
    steps = route.shape[1]
    columns = np.empty(len(TRIP_COLUMNS) * steps + 1)
    call('bev_make_trip', byref(TripTermsStruct(*terms)), steps, place(route), place(columns))
    return TripColumns(steps, columns)


def run(vehicle: NativeVehicle, integrator: int, trip: NativeTrip, states: FloatArray,
        heater_w: FloatArray | None, brake_w: FloatArray | None) -> None:
    """Write the run after the first charge and temperature [deg C], (2, N + 1); powers are (N,) [W] or None."""
    call('bev_run', vehicle.address, integrator, trip.address, 0, doubles_at(heater_w, trip.steps),
         doubles_at(brake_w, trip.steps), *_rows(states, 2))


def run_heated(vehicle: NativeVehicle, trip: NativeTrip, states: FloatArray,
               command_w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Do as `run` for four states; return means of heater power and of the heat that arrives [W] (N,)."""
    heat_w = np.empty((2, trip.steps))
    call('bev_run_heated', vehicle.address, trip.address, doubles_at(command_w, trip.steps), place(states),
         place(heat_w))
    return heat_w[0], heat_w[1]


def drive_as_planned(vehicle: NativeVehicle, trip: NativeTrip, command_w: FloatArray, below_c: float,
                     takes_surplus: bool, states: FloatArray, powers_w: FloatArray) -> tuple[int, float] | None:
    """
    Write the run within limits after the first states (S, N + 1), and its powers (S, N), under commands (N,) [W].

    Returns the step in which the charge runs out and its driven share, or None.
    """
    stranding, flags = StrandingStruct(), np.empty(2 * trip.steps, np.uint8)
    call('bev_drive_as_planned', vehicle.address, trip.address, doubles_at(command_w, trip.steps), below_c,
         takes_surplus, place(states), place(powers_w), flags.ctypes.data, addressof(stranding))
    return None if stranding.step < 0 else (stranding.step, stranding.driven_share)


def limits_of_steps(vehicle: NativeVehicle, soc: FloatArray, temperature_c: FloatArray,
                    variance_w2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return least and most terminal power [W] (K,) of steps with variances (K,) between states (K + 1,)."""
    count = len(variance_w2)
    limits_w = np.empty((2, count))
    call('bev_limits_of_steps', vehicle.address, count, doubles_at(soc, count + 1),
         doubles_at(temperature_c, count + 1), doubles_at(variance_w2, count), *_rows(limits_w, 2))
    return limits_w[0], limits_w[1]


def keep_accounts(vehicle: NativeVehicle, integrator: int, trip: NativeTrip, deliverable: bool,
                  run_of_powers: Sequence[FloatArray | None]) -> tuple[list[float], FloatArray]:
    """
    Return energies [Wh], as ENERGIES, and means over each step [W], (4, N), of a run as of RunOfPowersStruct.

    The means are Joule heat, leakage, power of the cells, and deficit of the circuit.
    """
    columns, energies_wh = np.empty((4, trip.steps)), (c_double * len(ENERGIES))()
    kept = [array if array is None else np.ascontiguousarray(array, dtype=float) for array in run_of_powers]
    made = RunOfPowersStruct(deliverable, *map(address_of, kept))
    call('bev_keep_accounts', vehicle.address, integrator, trip.address, addressof(made), place(columns),
         addressof(energies_wh))
    return energies_wh[:], columns


class SwitchedRun(NamedTuple):
    """
    Charge and temperature [deg C] (N + 1,) and heater power [W] (N,) of a plan with one switching instant.

    `plan` has the instant, the limits and the energies, `idle_soc` and `idle_c` (N + 1,) are the unheated run.
    """

    plan: SwitchPlanStruct
    idle_soc: FloatArray
    idle_c: FloatArray
    soc: FloatArray
    temperature_c: FloatArray
    heater_power_w: FloatArray


def plan_switch(vehicle: NativeVehicle, trip: NativeTrip, soc: float, temperature_c: float, target_c: float,
                in_one_interval: bool) -> SwitchedRun:
    """Return the run that is switched on once to arrive at the target [deg C]."""
    return _switched('bev_plan_switch', trip, (
        vehicle.address, trip.address, soc, temperature_c, target_c, in_one_interval))


def plan_paper(vehicle: NativeVehicle, trip: NativeTrip, soc: float, temperature_c: float,
               target_c: float) -> SwitchedRun:
    """Return the run of the paper's heuristic."""
    return _switched('bev_plan_paper', trip, (
        vehicle.address, trip.address, soc, temperature_c, target_c))


def _switched(name: str, trip: NativeTrip, arguments: tuple[Any, ...]) -> SwitchedRun:
    instants, steps = trip.steps + 1, trip.steps
    block = np.empty(2 * instants + steps)
    at = addressof(c_double.from_buffer(block))  # type: ignore[arg-type]
    memory, found = np.empty(room('BEV_SWITCH_MEMORY', steps)), SwitchPlanStruct()
    call(name, *arguments, place(memory), at, at + DOUBLE_BYTES * instants, at + 2 * DOUBLE_BYTES * instants,
         addressof(found))
    # The memory begins with the unheated run.
    return SwitchedRun(found, memory[:instants], memory[instants:2 * instants], block[:instants],
                       block[instants:2 * instants], block[2 * instants:])


class TwiceSwitchedRun(NamedTuple):
    """
    A run that is heated between two instants [s]: states (4, N + 1), heater commands [W] (N,).

    `heat_w` are means of heater power and of the heat that arrives [W] (N,).
    """

    on_s: float
    off_s: float
    states: FloatArray
    command_w: FloatArray
    heat_w: tuple[FloatArray, FloatArray]


def find_two_switches(vehicle: NativeVehicle, trip: NativeTrip, target_c: float,
                      idle_states: FloatArray) -> TwiceSwitchedRun:
    """Return the run that arrives at a target [deg C], from the unheated one (4, N + 1), which does not."""
    states, command_w, heat_w = np.empty((4, trip.steps + 1)), np.empty(trip.steps), np.empty((2, trip.steps))
    instants_s = (c_double * 2)()
    call('bev_find_two_switches', vehicle.address, trip.address, target_c, place(idle_states),
         place(np.empty(room('BEV_TWO_SWITCHES_MEMORY', trip.steps))), place(states), place(command_w),
         place(heat_w), byref(instants_s), byref(instants_s, DOUBLE_BYTES))
    return TwiceSwitchedRun(instants_s[0], instants_s[1], states, command_w, (heat_w[0], heat_w[1]))


class NativeValues(NamedTuple):
    """What `bev_plan_by_values` leaves for `bev_follow_values`, of a trip of so many steps."""

    steps: int
    flags: NDArray[np.uint8]
    memory: FloatArray


class ValueRequirements(NamedTuple):
    """A `bev_value_goal`: target [deg C], charge to keep, standard deviation [K], is it heating, prices (N,)."""

    target_c: float
    lowest_soc: float
    deviation_k: float
    is_heating: bool
    price: FloatArray | None

    def struct(self) -> ValueGoalStruct:
        """Return the struct; it points to the prices."""
        return ValueGoalStruct(self.is_heating, self.target_c, self.lowest_soc, self.deviation_k,
                               address_of(self.price))


def plan_by_values(vehicle: NativeVehicle, trip: NativeTrip, start: Sequence[float], wanted: ValueRequirements,
                   ) -> tuple[FloatArray | None, int | None, NativeValues]:
    """
    Return the commands [W] (N,) from four states on, the step within which heating ends or None, and the values.

    The commands are None if the charge does not carry the trip.
    """
    steps = trip.steps
    values = NativeValues(steps, np.zeros(room('BEV_VALUE_BYTES', steps), dtype=np.uint8),
                          np.empty(room('BEV_VALUE_MEMORY', steps)))
    states, powers_w, ends_in, goal = _begin(trip, start, wanted)
    status = call(
        'bev_plan_by_values', vehicle.address, trip.address, byref(goal), *map(address_of, (states, powers_w)),
        address_of(values.flags), address_of(values.memory), byref(ends_in), ALL_KEPT)
    return None if status == EMPTY else powers_w[0], None if ends_in.value < 0 else ends_in.value, values


def follow_values(vehicle: NativeVehicle, trip: NativeTrip, start: Sequence[float], wanted: ValueRequirements,
                  values: NativeValues) -> tuple[FloatArray | None, int | None] | None:
    """Return commands and end as `plan_by_values`, from values of an earlier plan; None if they lead to none."""
    states, powers_w, ends_in, goal = _begin(trip, start, wanted)
    status = call(
        'bev_follow_values', vehicle.address, trip.address, byref(goal), values.steps,
        *map(address_of, (states, powers_w)), address_of(values.flags), address_of(values.memory), byref(ends_in))
    if status == LEFT:
        return None
    return None if status == EMPTY else powers_w[0], None if ends_in.value < 0 else ends_in.value


def _begin(trip: NativeTrip, start: Sequence[float],
           wanted: ValueRequirements) -> tuple[FloatArray, FloatArray, c_int32, ValueGoalStruct]:
    states, powers_w = np.zeros((4, trip.steps + 1)), np.zeros((4, trip.steps))
    states[:, 0] = start
    return states, powers_w, c_int32(), wanted.struct()


def doubles_at(values: FloatArray | None, count: int) -> Any:
    """Return a pointer to values (count,), or to a contiguous copy; None for None."""
    if values is None:
        return None
    try:
        if values.dtype is FLOAT and len(values) == count:
            return place(values)
    except (TypeError, ValueError):
        # Not contiguous, read only, or empty.
        pass
    copy = np.zeros(count + 1)
    copy[:count] = values
    return place(copy)


def _rows(array: FloatArray, rows: int) -> list[Any]:
    """Return pointers to the rows of a contiguous array (rows, any)."""
    width = DOUBLE_BYTES * array.shape[1]
    return [place(array, row * width) for row in range(rows)]


def place(array: FloatArray, offset: int = 0) -> Any:
    """Return a pointer into an array, at an offset in bytes from its beginning; keeps the array alive."""
    return byref(c_double.from_buffer(array, offset))  # type: ignore[arg-type]


class Elapsing:
    """Time that passes [s]: the transitions (heaters, heaters) and the variances (ELEMENTS,) that come with it."""

    def __init__(self, duration_s: float, transitions: FloatArray, wander: FloatArray) -> None:
        """Keep the arrays alive, which must be contiguous."""
        self.duration_s, self.transitions, self.wander = duration_s, transitions, wander
        self.addresses = address_of(transitions), address_of(wander)


class ReadingNoise:
    """Variances (noises,) of a reading's temperature [K^2] and charge."""

    def __init__(self, temperature_k2: FloatArray, soc: FloatArray) -> None:
        """Keep the arrays alive, which must be contiguous."""
        self._kept = temperature_k2, soc
        self.addresses = address_of(temperature_k2), address_of(soc)


# The numbers of these structs in a row: written at once, which takes a fifth of field by field.
PASSED, READING = Packed(f'2P6d{MOST_HEATERS}d{len(DRIVE_COLUMNS)}di'), Packed('2P4di')


class NativeBelief:
    """A `bev_belief`: copies of the arrays of weights, means and covariances, which its calls change."""

    def __init__(self, weights: FloatArray, mean: FloatArray, covariance: FloatArray) -> None:
        """Copy arrays (heaters, noises), (…, ELEMENTS) and (…, ELEMENTS, ELEMENTS); Declined without the core."""
        if core() is None:
            raise Declined
        self.weights, self.mean, self.covariance = arrays = weights.copy(), mean.copy(), covariance.copy()
        self._memory = np.empty(sum([array.size for array in arrays]))
        self._struct = BeliefStruct(*weights.shape, *map(address_of, (*arrays, self._memory)))
        self._address = addressof(self._struct)
        self._passed, self._reading = PassedStruct(), ReadingStruct()
        self._places = addressof(self._passed), addressof(self._reading)
        self._lost = c_int32()
        self._others_w = (0.0,) * (MOST_HEATERS - len(weights))

    def follow(self, vehicle: NativeVehicle, terms: BeliefTermsStruct, elapsing: Elapsing, drive: DriveInputs,
               leakage: Leakage, heater_w: Sequence[float], hidden_variance_s2: float,
               propulsion: tuple[float, float, float, float]) -> int:
        """
        Do `bev_follow`; return how many filters are lost.

        `propulsion` is power seen and power of the route [W], variance [W^2], and most difference [W].
        """
        PASSED.pack_into(
            self._passed, 0, *elapsing.addresses, elapsing.duration_s, hidden_variance_s2, *propulsion,
            *heater_w, *self._others_w, *_numbers_of(drive, leakage))
        call('bev_follow', vehicle.address, self._address, addressof(terms), self._places[0],
             addressof(self._lost))
        return self._lost.value

    def take_reading(self, terms: BeliefTermsStruct, noise: ReadingNoise, interval_c: tuple[float, float],
                     interval: tuple[float, float], tells_hypotheses: bool) -> tuple[FloatArray, FloatArray]:
        """
        Do `bev_take_reading` of intervals of temperature [deg C] and charge; return mean and covariance.

        Declined also if filters are lost, because that ends it.
        """
        both = np.empty((ELEMENTS + 1, ELEMENTS))
        at = address_of(both)
        READING.pack_into(self._reading, 0, *noise.addresses, *interval_c, *interval, tells_hypotheses)
        call('bev_take_reading', self._address, addressof(terms), self._places[1], at,
             at + DOUBLE_BYTES * ELEMENTS, addressof(self._lost))
        if self._lost.value:
            raise Declined
        both.setflags(write=False)
        return both[0], both[1:]


def arrival_variance(vehicle: NativeVehicle, terms: BeliefTermsStruct, leakage: Leakage, route: FloatArray,
                     heater_w: FloatArray, temperature_c: FloatArray, soc: FloatArray,
                     covariance: FloatArray) -> float:
    """
    Do `bev_arrival_variance`; return the variance of the temperature on arrival [K^2].

    `route` (8, N) are the columns of a route, `heater_w` (N,) is the heater power in each step [W],
    temperatures [deg C] and charge (N + 1,) are the run, `covariance` is (ELEMENTS, ELEMENTS).
    """
    arrays = [*map(doubles, (route, heater_w, temperature_c, soc, covariance))]
    *columns, believed = map(address_of, arrays)
    expected = ExpectedDriveStruct(
        route.shape[1], *columns, leakage.gamma_0_w_per_k, leakage.gamma_v_w_per_k_per_mps)
    variance_k2 = c_double()
    call('bev_arrival_variance', vehicle.address, addressof(expected), addressof(terms), believed,
         addressof(variance_k2))
    return variance_k2.value


def _numbers_of(drive: DriveInputs, leakage: Leakage) -> tuple[float, ...]:
    """Return a `bev_drive` in the order of its fields."""
    seen_w = drive.terminal_power_w
    return (drive.speed_mps, drive.ambient_temperature_c, drive.propulsion_power_w,
            drive.power_variance_w2, drive.propulsion_power_magnitude_w, drive.cabin_heating_power_w,
            drive.auxiliary_power_w, 0.0 if seen_w is None else seen_w, drive.hidden_variance_w2,
            leakage.gamma_0_w_per_k, leakage.gamma_v_w_per_k_per_mps, seen_w is not None)
