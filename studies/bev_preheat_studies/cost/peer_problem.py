# SPDX-License-Identifier: Apache-2.0
"""
The nonlinear program stated for do-mpc, as an independent implementation.

Both use the same problem: the Runge-Kutta step of `model` as the discrete model, the same
variables, scales, bounds, power limits at both ends of a step, cost and IPOPT options. do-mpc builds
a single SX graph of all steps and starts from the initial state everywhere, as its own users would do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
import warnings

import casadi
import numpy as np

from bev_preheat.nonlinear_program.blocks import POWER_SCALE_W
from bev_preheat.nonlinear_program.drive_step import ENERGY_SCALE_J, SOC_SCALE
from bev_preheat.nonlinear_program.program_solvers import IPOPT_OPTIONS
from bev_preheat.nonlinear_program.symbols import SYMBOLS
from bev_preheat.planning.engine import run_forward
from bev_preheat.planning.schedule import Schedule, switched_on_s
from bev_preheat.planning.situation import reserve_soc
from bev_preheat.vehicle.model import make_rates, make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.planning.trip import Trip

with warnings.catch_warnings():
    # do-mpc warns about each optional feature that is not installed.
    warnings.simplefilter('ignore')
    import do_mpc


class PeerProblem:
    """A trip as do-mpc's MPC whose horizon is the whole trip."""

    def __init__(self, trip: Trip, state: BatteryState, goal: Goal, limited: bool = True) -> None:
        """Set the problem up; `limited`: with the power limits of the battery (9i)."""
        self._trip, self._state, self._limited = trip, state, limited
        model = self._model()
        self._mpc = do_mpc.controller.MPC(model)
        self._configure(model, goal)

    def solve(self) -> None:
        """Solve from a cold start; raise RuntimeError if IPOPT finds no optimum."""
        mpc = self._mpc
        mpc.reset_history()
        # Otherwise the multipliers of the last solution are the start.
        mpc.flags['initial_run'] = False
        mpc.x0 = np.array([self._state.soc, self._state.temperature_c])
        mpc.u0 = np.zeros(2)
        mpc.set_initial_guess()
        mpc.make_step(mpc.x0.cat)
        if not mpc.solver_stats['success']:
            raise RuntimeError(f'do-mpc: {mpc.solver_stats["return_status"]}')

    def schedule(self) -> Schedule:
        """Return the Schedule of the solution, its states from a forward run."""
        trip, state = self._trip, self._state
        powers_w = np.array([np.asarray(self._mpc.opt_x_num_unscaled['_u', k, 0]).ravel()
                             for k in range(len(trip.route))])
        heater_w, brake_w = powers_w.T
        soc, temperature_c = run_forward(
            trip, make_runge_kutta_4, state.soc, state.temperature_c, heater_w, brake_w)
        return Schedule(switched_on_s(trip, heater_w), heater_w, brake_w, soc, temperature_c,
                        make_runge_kutta_4)

    def _model(self) -> do_mpc.model.Model:
        vehicle = self._trip.vehicle
        model = do_mpc.model.Model('discrete', 'SX')
        soc, temperature_c = (model.set_variable('_x', name) for name in ('soc', 'temperature'))
        heater_w, brake_w = (model.set_variable('_u', name) for name in ('heater', 'brake'))
        duration_s, idle_power_w, variance_w2, idle_heat_w, leakage_w_per_k = (
            model.set_variable('_tvp', name)
            for name in ('duration', 'idle_power', 'variance', 'idle_heat', 'leakage'))
        power_w = idle_power_w + heater_w + brake_w
        inputs = (power_w, variance_w2, idle_heat_w + vehicle.hvch.efficiency * heater_w
                  - vehicle.drivetrain.heat_share * brake_w, leakage_w_per_k)
        rates = make_rates(vehicle, SYMBOLS)
        soc_end, end_c, _, mean_joule_w = make_runge_kutta_4(rates)(
            soc, temperature_c, duration_s, *inputs)
        model.set_rhs('soc', soc_end)
        model.set_rhs('temperature', end_c)
        battery = vehicle.battery
        for end, state in (('', (soc, temperature_c)), ('_at_end', (soc_end, end_c))):
            battery_w = power_w + rates(*state, *inputs)[2]
            most_w, least_w = (curve.function(SYMBOLS)(*state) for curve in (
                battery.discharge_power_limit, battery.charge_power_limit))
            model.set_expression(f'overdraw{end}', (battery_w - most_w) / POWER_SCALE_W)
            model.set_expression(f'overcharge{end}', (least_w - battery_w) / POWER_SCALE_W)
        model.set_expression('energy', duration_s * (power_w + mean_joule_w) / ENERGY_SCALE_J)
        model.setup()
        return model

    def _configure(self, model: do_mpc.model.Model, goal: Goal) -> None:
        trip, mpc, battery = self._trip, self._mpc, self._trip.vehicle.battery
        steps = len(trip.route)
        # do-mpc's step is nominal: the real durations are among the time-varying parameters.
        mpc.settings.n_horizon, mpc.settings.t_step = steps, 1.0
        mpc.settings.nlpsol_opts.update(IPOPT_OPTIONS)
        mpc.scaling['_x', 'soc'] = SOC_SCALE
        mpc.scaling['_u', 'heater'] = mpc.scaling['_u', 'brake'] = POWER_SCALE_W
        mpc.set_objective(mterm=casadi.DM(0.0), lterm=model.aux['energy'])
        mpc.set_rterm(heater=0.0, brake=0.0)
        for name, (low, high) in (('soc', battery.soc_range),
                                  ('temperature', battery.temperature_range_c)):
            mpc.bounds['lower', '_x', name] = low
            mpc.bounds['upper', '_x', name] = mpc.terminal_bounds['upper', name] = high
        mpc.terminal_bounds['lower', 'soc'] = reserve_soc(trip.vehicle, goal)
        mpc.terminal_bounds['lower', 'temperature'] = goal.target_temperature_c
        for name in ('heater', 'brake'):
            mpc.bounds['lower', '_u', name] = 0.0
        if self._limited:
            for name in ('overdraw', 'overcharge', 'overdraw_at_end', 'overcharge_at_end'):
                mpc.set_nl_cons(name, model.aux[name], ub=0.0)
        # The trip is the horizon, so these parameters do not depend on the time.
        trip_now = mpc.get_tvp_template()
        for k in range(steps):
            for name, values in (('duration', trip.route.duration_s),
                                 ('idle_power', trip.idle_power_w),
                                 ('variance', trip.power_variance_w2),
                                 ('idle_heat', trip.idle_heat_w),
                                 ('leakage', trip.leakage_w_per_k)):
                trip_now['_tvp', k, name] = values[k]
        mpc.set_tvp_fun(lambda time_s: trip_now)
        mpc.setup()
        regenerated_w = np.maximum(-trip.route.propulsion_power_w, 0.0) * self._limited
        for k in range(steps):
            mpc.ub_opt_x['_u', k, 0, 'heater'] = trip.heater_limit_w[k]
            mpc.ub_opt_x['_u', k, 0, 'brake'] = regenerated_w[k]
