/* SPDX-License-Identifier: Apache-2.0 */
/* One step within limits: bev_preheat.planning.limits and bev_preheat.planning.heated_limits. */
#include "limited_step.h"

#include <stdbool.h>

#include "foresight.h"
#include "heating.h"

/* One step on its way. */
typedef struct {
  int32_t k;
  bev_inputs idle;
  const double *states;
  /* What is left of a difference between heater and command, on average over the step. */
  double left;
} step_start;

double bev_mean_share_left(double lag_s, double duration_s) {
  return lag_s == 0.0 ? 0.0 : -expm1(-duration_s / lag_s) * lag_s / duration_s;
}

bev_limited_run bev_limited_run_of(const bev_vehicle *vehicle, const bev_trip *trip,
                                   const uint8_t *may_overcharge, const uint8_t *may_overdraw,
                                   int32_t takes_surplus, int32_t is_direct) {
  const double coolant_j_per_k = is_direct ? 0.0 : vehicle->coolant_heat_capacity_j_per_k;
  const double both_j_per_k = vehicle->heat_capacity_j_per_k + coolant_j_per_k;
  const double lag_s = is_direct ? 0.0 : vehicle->heater_lag_s;
  const bev_limited_run run = {
      vehicle, trip, may_overcharge, may_overdraw, takes_surplus, is_direct, lag_s,
      vehicle->heater_efficiency * lag_s / both_j_per_k, coolant_j_per_k / both_j_per_k,
      both_j_per_k / vehicle->heater_efficiency};
  return run;
}

/* The step under a command and a friction brake power [W]: `result` is that of the model's step. */
static bev_status end_of(const bev_limited_run *run, const step_start *start, double command_w,
                         double brake_w, double result[8]) {
  const bev_vehicle *vehicle = run->vehicle;
  bev_inputs inputs = start->idle;
  if (run->is_direct != 0) {
    inputs.power_w = start->idle.power_w + command_w + brake_w;
    inputs.heat_w = start->idle.heat_w + vehicle->heater_efficiency * command_w
        - vehicle->heat_share * brake_w;
    bev_integrate(vehicle, BEV_RUNGE_KUTTA_4, 1, start->states[0], start->states[1], &inputs,
                  result);
    result[2] = 0.0;
    result[3] = 0.0;
    result[6] = command_w;
    result[7] = vehicle->heater_efficiency * command_w;
  } else {
    inputs.power_w = start->idle.power_w + brake_w;
    inputs.heat_w = start->idle.heat_w - vehicle->heat_share * brake_w;
    bev_integrate_heated(vehicle, 1, start->states, &inputs, command_w, result);
  }
  return bev_kind_of(result[0], result[1]) == BEV_OK && bev_kind_of(result[2], result[3]) == BEV_OK
      ? BEV_OK
      : BEV_NOT_FINITE;
}

/* The command before the highest temperature is looked at, and the least terminal power [W]. */
static bev_status limited_command(const bev_limited_run *run, const step_start *start,
                                  double *command_w, double *least_w) {
  const int32_t k = start->k;
  const double power_w = start->idle.power_w;
  const double heater_w = start->states[2];
  const bool may_overcharge = run->may_overcharge[k] != 0u;
  double cap_w = run->trip->heater_limit_w[k];
  double wanted_w = *command_w;
  if (bev_settled_c(run, start->states) >= run->vehicle->highest_c) {
    cap_w = 0.0;
    wanted_w = 0.0;
  }
  if (may_overcharge || run->may_overdraw[k] != 0u) {
    double limits_w[2];
    bev_terminal_limits(run->vehicle, 0, start->states[0], start->states[1],
                        start->idle.variance_w2, limits_w);
    if (!isfinite(limits_w[0]) || !isfinite(limits_w[1])) {
      return BEV_NOT_FINITE;
    }
    *least_w = limits_w[0];
    const double room_w =
        ((limits_w[1] - power_w) - start->left * heater_w) / (1.0 - start->left);
    wanted_w = bev_maximum(0.0, bev_minimum(wanted_w, room_w));
    if (may_overcharge && run->takes_surplus != 0) {
      double surplus_w = *least_w - power_w;
      if (run->lag_s > 0.0 && surplus_w > 0.0) {
        surplus_w = bev_minimum(surplus_w, bev_lasting_surplus_w(run, k, start->states));
      }
      wanted_w = bev_maximum(wanted_w, bev_minimum(cap_w, surplus_w));
    }
  }
  if (run->lag_s > 0.0 && wanted_w > 0.0) {
    wanted_w =
        bev_maximum(0.0, bev_minimum(wanted_w, bev_off_in_time_w(run, k, start->states)));
  }
  *command_w = wanted_w;
  return isfinite(wanted_w) ? BEV_OK : BEV_NOT_FINITE;
}

/* The brake takes what would overfill the battery. */
static bev_status keep_from_overfilling(const bev_limited_run *run, const step_start *start,
                                        double most_w, double command_w, double *brake_w,
                                        double result[8]) {
  double enough_w = most_w;
  double too_little_w = *brake_w;
  for (int32_t n = 0; n < BEV_HALVINGS; n++) {
    const double middle_w = 0.5 * (enough_w + too_little_w);
    const bev_status status = end_of(run, start, command_w, middle_w, result);
    if (status != BEV_OK) {
      return status;
    }
    if (result[0] <= 1.0) {
      enough_w = middle_w;
    } else {
      too_little_w = middle_w;
    }
  }
  *brake_w = enough_w;
  return end_of(run, start, command_w, enough_w, result);
}

/* The step with the command that keeps the highest temperature, and the brake that goes with it. */
static bev_status drive(const bev_limited_run *run, const step_start *start, double *command_w,
                        double *brake_w, double result[8]) {
  const double propulsion_w = run->trip->propulsion_power_w[start->k];
  const double highest_c = run->vehicle->highest_c;
  const bool may_overcharge = run->may_overcharge[start->k] != 0u;
  double least_w = 0.0;
  bev_status status = limited_command(run, start, command_w, &least_w);
  int is_settled = 0;
  for (int32_t round = 0; status == BEV_OK && round < BEV_MOST_ROUNDS && !is_settled; round++) {
    *brake_w = 0.0;
    if (may_overcharge) {
      const double drawn_w = start->left * start->states[2] + (1.0 - start->left) * *command_w;
      *brake_w = bev_minimum(
          bev_maximum(0.0, least_w - start->idle.power_w - drawn_w), -propulsion_w);
    }
    status = end_of(run, start, *command_w, *brake_w, result);
    const double beyond_k = bev_settled_c(run, result) - highest_c;
    if (*command_w <= 0.0 || beyond_k <= BEV_HIGHEST_TOLERANCE_K) {
      is_settled = 1;
    } else {
      *command_w = bev_maximum(
          0.0, *command_w - beyond_k * run->joules_per_k / start->idle.duration_s);
    }
  }
  if (status != BEV_OK) {
    return status;
  }
  if (!is_settled) {
    return BEV_NOT_SETTLED;
  }
  if (result[0] > 1.0) {
    status = keep_from_overfilling(run, start, bev_maximum(0.0, -propulsion_w), *command_w,
                                   brake_w, result);
  }
  return status;
}

bev_status bev_drive_within_limits(const bev_limited_run *run, int32_t k, const double states[4],
                                   double wanted_w, double ends[4], double powers_w[4]) {
  const bev_trip *trip = run->trip;
  step_start start;
  start.k = k;
  start.idle = bev_inputs_of(run->vehicle, trip, k, NULL, NULL);
  start.states = states;
  start.left =
      run->is_direct != 0 ? 0.0 : bev_mean_share_left(run->lag_s, trip->duration_s[k]);
  if (!bev_are_finite(&start.idle) || !isfinite(trip->propulsion_power_w[k])
      || !isfinite(trip->heater_limit_w[k]) || !isfinite(wanted_w)) {
    return BEV_BAD_INPUT;
  }
  double result[8];
  powers_w[0] = wanted_w;
  powers_w[1] = 0.0;
  const bev_status status = drive(run, &start, &powers_w[0], &powers_w[1], result);
  if (status != BEV_OK) {
    return status;
  }
  powers_w[2] = result[6];
  powers_w[3] = result[7];
  if (result[0] <= 0.0) {
    return BEV_EMPTY;
  }
  ends[0] = bev_minimum(result[0], 1.0);
  ends[1] = bev_minimum(result[1], run->vehicle->hottest_c);
  ends[2] = result[2];
  ends[3] = result[3];
  return BEV_OK;
}
