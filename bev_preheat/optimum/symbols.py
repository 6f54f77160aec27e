# SPDX-License-Identifier: Apache-2.0
"""The model's equations as CasADi expressions."""

import casadi

from bev_preheat.arithmetic import Arithmetic
from bev_preheat.model import make_rates, make_runge_kutta_4

# Below this discriminant [V^2] the power cannot be delivered; the floor keeps derivatives finite.
LEAST_DISCRIMINANT_V2 = 1e-6

SYMBOLS = Arithmetic(
    root=lambda value: casadi.sqrt(casadi.fmax(value, LEAST_DISCRIMINANT_V2)),
    log=casadi.log, maximum=casadi.fmax, minimum=casadi.fmin)


def symbolic_step(vehicle):
    """
    Return the Runge-Kutta step of `model` as a CasADi Function.

    Inputs: soc, temperature [deg C], duration [s], terminal power [W], variance [W^2], heat [W],
    leakage [W/K]. Outputs: soc, temperature at the end, mean temperature, mean Joule heat [W].
    """
    names = ('soc', 'temperature_c', 'duration_s', 'power_w', 'variance_w2', 'heat_w',
             'leakage_w_per_k')
    inputs = [casadi.SX.sym(name) for name in names]
    step = make_runge_kutta_4(make_rates(vehicle, SYMBOLS))
    return casadi.Function('step', inputs, list(step(*inputs)), list(names), [
        'soc_end', 'temperature_end_c', 'mean_temperature_c', 'mean_joule_w'])


def symbolic_rates(vehicle):
    """Return the right-hand side of `model` as a CasADi Function: soc/s, K/s, Joule heat [W]."""
    names = ('soc', 'temperature_c', 'power_w', 'variance_w2', 'heat_w', 'leakage_w_per_k')
    inputs = [casadi.SX.sym(name) for name in names]
    return casadi.Function('rates', inputs, list(make_rates(vehicle, SYMBOLS)(*inputs)),
                           list(names), ['soc_rate', 'temperature_rate', 'joule_w'])


def symbolic_curve(curve):
    """Return a curve of the vehicle as a CasADi Function of soc and temperature [deg C]."""
    soc, temperature_c = casadi.SX.sym('soc'), casadi.SX.sym('temperature_c')
    return casadi.Function('curve', [soc, temperature_c],
                           [curve.function(SYMBOLS)(soc, temperature_c)])
