# SPDX-License-Identifier: Apache-2.0
"""
The heater's heat path into the battery, and the lag of the temperature sensor.

In the paper the heat arrives at once. In a car the heater lags behind its command, the coolant between
heater and battery has to warm up first, and the sensor sits on a cell that warms late:

    lag P' = P_command - P                                   electrical power P of the heater
    C_c T_c' = eta P - G (T_c - T_b)                         coolant temperature T_c
    C_b T_b' = G (T_c - T_b) + other heat                    battery, in place of eta P
    lag_s T_s' = T_b - T_s                                   sensor temperature T_s

A battery of two masses has a shell in the coolant's place, with a share s of the heat capacity C of both.
Heater, drivetrain and air are at the shell; the cells, and so all Joule heat, are the core:

    s C T_c' = eta P - G (T_c - T_b) + gamma (T_amb - T_c) + Q_ed      shell
    (1 - s) C T_b' = G (T_c - T_b) + R I^2                            core

So all heat warms the mean of both, as it warms a battery of one mass. The shell's excess D = T_c - T_b decays with
tau = s (1 - s) C / G; under steady heats Q_c of the shell and Q_b of the core it is ((1 - s) Q_c - s Q_b) / G. The
shell is (1 - s) D above the mean and the core s D below it. For G -> infinity D is 0.

The coolant's time constant may be a few seconds, far below a plan's steps. Heater and coolant are
therefore solved rather than integrated: within a step the command and all other
heat of the battery are constant, so the equations are linear. `make_heat_step` returns that solution,
`make_heated_step` the model's step with it: for the simulated car, for plans and for the program.
"""

from __future__ import annotations

from collections.abc import Callable

from bev_preheat.numerics import AnyNumber, Arithmetic, Number
from bev_preheat.vehicle.description import HeatPath, Vehicle
from bev_preheat.vehicle.model import Integrator, make_rates, make_runge_kutta_4

# The solution for two equal time constants has another form. The step's numbers of time constants are therefore
# kept at least this far apart, which changes the result by a relative 4e-8.
APART_SQUARED = 1e-6

HeatStep = Callable[[Number, Number, Number, Number, Number, Number, Number, Number],
                    tuple[Number, Number, Number, Number]]
HeatedStep = Callable[
    [Number, Number, Number, Number, Number, Number, Number, Number, Number, Number],
    tuple[Number, Number, Number, Number, Number, Number, Number, Number]]


def make_heat_step(vehicle: Vehicle, arithmetic: Arithmetic[Number]) -> HeatStep[Number]:
    """
    Return one step of heater and coolant of the vehicle's `heat_path`.

    `step(power_w, coolant_c, temperature_c, duration_s, command_w, other_heat_w, heat_w, leakage_w_per_k)`
    takes the heater's power [W], coolant and battery temperature [deg C] at its start, and the constants within
    it: the command [W], all other heat of the battery [W], and its parts beside Joule heat, as inputs of `model`.
    It returns (mean electrical power [W], mean heat into the battery [W], electrical power at the end
    [W], coolant temperature at the end [deg C]). The heater's heat goes into battery and coolant, to rounding.

    With a shell the heat into the battery is the core's beyond all other heat, with which callers integrate it as
    if it had no shell.
    """
    path = vehicle.heat_path
    exp = arithmetic.exp
    efficiency = vehicle.hvch.efficiency

    def decay(duration_s: Number, time_constant_s: float) -> tuple[Number, Number]:
        """Return the remaining share of a difference at the end of a step, and its mean over the step."""
        left = exp(-duration_s / time_constant_s)
        return left, (1.0 - left) * time_constant_s / duration_s

    def heater(power_w: Number, duration_s: Number, command_w: Number) -> tuple[Number, Number]:
        """Return (mean, end) of the heater's power [W]."""
        if path.heater_lag_s == 0.0:
            return command_w, command_w
        left, average = decay(duration_s, path.heater_lag_s)
        behind_w = power_w - command_w
        return command_w + behind_w * average, command_w + behind_w * left

    if not path.has_coolant:
        def direct(power_w: Number, coolant_c: Number, temperature_c: Number, duration_s: Number,
                   command_w: Number, other_heat_w: Number, heat_w: Number,
                   leakage_w_per_k: Number) -> tuple[Number, Number, Number, Number]:
            mean_w, end_w = heater(power_w, duration_s, command_w)
            return mean_w, efficiency * mean_w, end_w, temperature_c

        return direct

    coolant_j_per_k = path.coolant_heat_capacity_j_per_k
    conductance_w_per_k = path.coolant_conductance_w_per_k
    battery_j_per_k = vehicle.battery.heat_capacity_j_per_k
    # Decay rate of the difference between coolant and battery; both have a finite heat capacity.
    rate_per_s = conductance_w_per_k * (1.0 / coolant_j_per_k + 1.0 / battery_j_per_k)
    lag_s, root = path.heater_lag_s, arithmetic.root

    def through_coolant(
            power_w: Number, coolant_c: Number, temperature_c: Number, duration_s: Number,
            command_w: Number, other_heat_w: Number, heat_w: Number,
            leakage_w_per_k: Number) -> tuple[Number, Number, Number, Number]:
        mean_w, end_w = heater(power_w, duration_s, command_w)
        excess_k = coolant_c - temperature_c
        made_w, core_w = efficiency * command_w, other_heat_w
        if path.is_shell:
            outer_w = heat_w - leakage_w_per_k * temperature_c
            shell_w = outer_w - leakage_w_per_k * excess_k
            made_w, core_w = made_w + shell_w, other_heat_w - outer_w
        # Steady difference under the command, and the step's number of time constants.
        settled_k = (made_w / coolant_j_per_k - core_w / battery_j_per_k) / rate_per_s
        decays = duration_s * rate_per_s
        mean_excess_k = settled_k + (excess_k - settled_k) * ((1.0 - exp(-decays)) / decays)
        if lag_s > 0.0:
            # Contribution of the heater's lag: two decays in series, over the step [s].
            lags = duration_s / lag_s
            apart = root((lags - decays) * (lags - decays) + APART_SQUARED)
            both_s = (duration_s * exp(-0.5 * (lags + decays - apart)) * (1.0 - exp(-apart)) / apart)
            mean_excess_k = mean_excess_k + (
                efficiency * (power_w - command_w) / coolant_j_per_k
                * (lag_s * (1.0 - exp(-lags)) - both_s) / decays)
        passed_w = conductance_w_per_k * mean_excess_k
        warming_w = efficiency * mean_w
        arriving_w = passed_w
        if path.is_shell:
            warming_w, arriving_w = warming_w + shell_w, passed_w + core_w - other_heat_w
        return (mean_w, arriving_w, end_w, coolant_c + (warming_w - passed_w) * duration_s / coolant_j_per_k)

    return through_coolant


def make_heated_step(vehicle: Vehicle, arithmetic: Arithmetic[Number],
                     make_integrator: Integrator = make_runge_kutta_4) -> HeatedStep[Number]:
    """
    Return one step of the model of a vehicle with its `heat_path`.

    `step(soc, temperature_c, heater_w, excess_k, duration_s, power_w, variance_w2, heat_w, leakage_w_per_k,
    command_w)` takes the states at its start: state of charge, battery temperature [deg C], the heater's
    electrical power [W], and the coolant's temperature above the battery's [K]. The inputs are those of `model`,
    but power [W] and heat [W] exclude the heater's; `command_w` [W] is the commanded heater power. It returns the
    four states at the end, the means of temperature [deg C] and Joule heat [W], and the mean heater power and mean
    heat into the battery [W]. All heat goes into battery and coolant, to rounding.
    """
    path = vehicle.heat_path
    rates = make_rates(vehicle, arithmetic)
    integrate = make_integrator(rates)
    heat_step = make_heat_step(vehicle, arithmetic)
    battery_j_per_k = vehicle.battery.heat_capacity_j_per_k

    def step(soc: Number, temperature_c: Number, heater_w: Number, excess_k: Number,
             duration_s: Number, power_w: Number, variance_w2: Number, heat_w: Number,
             leakage_w_per_k: Number, command_w: Number) -> tuple[
                 Number, Number, Number, Number, Number, Number, Number, Number]:
        # All other heat, needed only with coolant, is that at the start of the step.
        other_heat_w = heat_w if not path.has_coolant else battery_j_per_k * rates(
            soc, temperature_c, power_w + command_w, variance_w2, heat_w, leakage_w_per_k)[1]
        drawn_w, arriving_w, heater_end_w, coolant_end_c = heat_step(
            heater_w, temperature_c + excess_k, temperature_c, duration_s, command_w, other_heat_w, heat_w,
            leakage_w_per_k)
        soc_end, end_c, mean_c, joule_w = integrate(
            soc, temperature_c, duration_s, power_w + drawn_w, variance_w2, heat_w + arriving_w,
            leakage_w_per_k)
        return (soc_end, end_c, heater_end_w,
                coolant_end_c - end_c if path.has_coolant else excess_k,
                mean_c, joule_w, drawn_w, arriving_w)

    return step


def sensed_c(path: HeatPath, temperature_c: AnyNumber, excess_k: AnyNumber) -> AnyNumber:
    """
    Return the temperature at the sensor's place [deg C].

    `temperature_c` is the battery's, with a shell the core's; `excess_k` is the shell's above that [K].
    """
    return temperature_c + path.shell_share * path.sensor_rise * excess_k


def sensor_reading_c(path: HeatPath, reading_c: Number, start_c: Number, end_c: Number,
                     duration_s: Number, arithmetic: Arithmetic[Number]) -> Number:
    """
    Return the sensor reading [deg C] after a step in which the battery warms linearly.

    `reading_c` is the previous reading, `start_c` and `end_c` are the temperatures at the sensor's place.
    """
    if path.sensor_lag_s == 0.0:
        return end_c
    behind_k = (end_c - start_c) * path.sensor_lag_s / duration_s
    left: Number = arithmetic.exp(-duration_s / path.sensor_lag_s)
    return end_c - behind_k + (reading_c - start_c + behind_k) * left
