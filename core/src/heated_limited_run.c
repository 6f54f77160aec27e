/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The forward run that keeps the battery's limits, of a vehicle with a heat path:
 * bev_preheat.planning.heated_limits and bev_preheat.planning.foresight.
 */
#include "heating.h"
#include "steps_of_model.h"

/* So many lags after it was switched off, a heater takes nothing worth naming. */
#define LAGS_AHEAD 5.0
/* Surplus is taken while it lasts for so many lags more. */
#define LASTING_LAGS 0.7

/* What stays the same over a run. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  const bev_heating *heating;
  double lag_s;
  /* What a watt of heater power, and a kelvin of coolant excess, will still bring [K]. */
  double k_per_watt;
  double share_of_excess;
  double joules_per_k;
} run_of_limits;

/* One step on its way. */
typedef struct {
  int32_t k;
  bev_inputs idle;
  double states[4];
  /* What is left of a difference between heater and command, on average over the step. */
  double left;
} step_start;

static double mean_share_left(double lag_s, double duration_s) {
  return lag_s == 0.0 ? 0.0 : -expm1(-duration_s / lag_s) * lag_s / duration_s;
}

/* The last of the steps that begin within so long after the end of step k. */
static int32_t last_after(const bev_trip *trip, int32_t k, double duration_s) {
  int32_t last = k;
  double left_s = duration_s;
  while (last + 1 < trip->steps && left_s > 0.0) {
    last++;
    left_s -= trip->duration_s[last];
  }
  return last;
}

static int is_before_climb(const run_of_limits *run, int32_t k) {
  const bev_trip *trip = run->trip;
  const double until_s = trip->time_s[k + 1] + LAGS_AHEAD * run->lag_s;
  for (int32_t j = k + 1; j < trip->steps && trip->time_s[j] < until_s; j++) {
    if (run->heating->may_overdraw[j] != 0 && trip->time_s[j] > trip->time_s[k]) {
      return 1;
    }
  }
  return 0;
}

/* The command after which the heater, switched off, leaves a climb its power [W]. */
static double off_in_time_w(const run_of_limits *run, const step_start *start) {
  const bev_trip *trip = run->trip;
  const int32_t k = start->k;
  if (!is_before_climb(run, k)) {
    return INFINITY;
  }
  double allowed_w = INFINITY;
  for (int32_t j = last_after(trip, k, LAGS_AHEAD * run->lag_s); j > k; j--) {
    const double decay = exp(-trip->duration_s[j] / run->lag_s);
    allowed_w = decay > 0.0 ? allowed_w / decay : INFINITY;
    if (run->heating->may_overdraw[j] != 0) {
      double limits_w[2];
      bev_terminal_limits(run->vehicle, 0, start->states[0], start->states[1],
                          trip->power_variance_w2[j], limits_w);
      allowed_w = bev_minimum(
          allowed_w, bev_maximum(limits_w[1] - trip->idle_power_w[j], 0.0)
              / mean_share_left(run->lag_s, trip->duration_s[j]));
    }
  }
  const double decay = exp(-trip->duration_s[k] / run->lag_s);
  return (allowed_w - decay * start->states[2]) / (1.0 - decay);
}

/* What of the surplus goes on: what the heater takes afterwards is paid for [W]. */
static double lasting_surplus_w(const run_of_limits *run, const step_start *start) {
  const bev_trip *trip = run->trip;
  const int32_t k = start->k;
  const double ahead_s = LASTING_LAGS * run->lag_s - 0.5 * trip->duration_s[k];
  const int32_t last = last_after(trip, k, ahead_s);
  if (last == k) {
    return INFINITY;
  }
  double lasting_s = 0.0;
  double least_w = INFINITY;
  for (int32_t j = k + 1; j <= last; j++) {
    double limits_w[2];
    lasting_s += trip->duration_s[j];
    bev_terminal_limits(run->vehicle, 0, start->states[0], start->states[1],
                        trip->power_variance_w2[j], limits_w);
    least_w = bev_minimum(least_w, limits_w[0] - trip->idle_power_w[j]);
  }
  return lasting_s < ahead_s ? 0.0 : bev_maximum(0.0, least_w);
}

static bev_status end_of(const run_of_limits *run, const step_start *start, double command_w,
                         double brake_w, double result[8]) {
  bev_inputs inputs = start->idle;
  inputs.power_w = start->idle.power_w + brake_w;
  inputs.heat_w = start->idle.heat_w - run->vehicle->heat_share * brake_w;
  bev_integrate_heated(run->vehicle, 1, start->states, &inputs, command_w, result);
  return bev_kind_of(result[0], result[1]) == BEV_OK && bev_kind_of(result[2], result[3]) == BEV_OK
      ? BEV_OK
      : BEV_NOT_FINITE;
}

/* The command before the highest temperature is looked at, and the least terminal power [W]. */
static bev_status wanted_command(const run_of_limits *run, const step_start *start,
                                 double *command_w, double *least_w) {
  const int32_t k = start->k;
  const double power_w = start->idle.power_w;
  const double heater_w = start->states[2];
  const int may_overcharge = run->heating->may_overcharge[k] != 0;
  const double settled_c = start->states[1] + run->k_per_watt * heater_w
      + run->share_of_excess * start->states[3];
  double cap_w = run->trip->heater_limit_w[k];
  double wanted_w = 0.0;
  if (settled_c >= run->vehicle->highest_c) {
    cap_w = 0.0;
  } else {
    wanted_w = bev_wanted_w(run->heating, k, settled_c);
  }
  if (may_overcharge || run->heating->may_overdraw[k] != 0) {
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
    if (may_overcharge && run->heating->takes_surplus != 0) {
      double surplus_w = *least_w - power_w;
      if (run->lag_s > 0.0 && surplus_w > 0.0) {
        surplus_w = bev_minimum(surplus_w, lasting_surplus_w(run, start));
      }
      wanted_w = bev_maximum(wanted_w, bev_minimum(cap_w, surplus_w));
    }
  }
  if (run->lag_s > 0.0 && wanted_w > 0.0) {
    wanted_w = bev_maximum(0.0, bev_minimum(wanted_w, off_in_time_w(run, start)));
  }
  *command_w = wanted_w;
  return isfinite(wanted_w) ? BEV_OK : BEV_NOT_FINITE;
}

/* The brake takes what would overfill the battery. */
static bev_status keep_from_overfilling(const run_of_limits *run, const step_start *start,
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

/* Drive a step: `result` is that of the heated step, `powers_w` command and friction brake. */
static bev_status drive(const run_of_limits *run, const step_start *start, double result[8],
                        double powers_w[2]) {
  const double propulsion_w = run->trip->propulsion_power_w[start->k];
  const double highest_c = run->vehicle->highest_c;
  const int may_overcharge = run->heating->may_overcharge[start->k] != 0;
  double command_w = 0.0;
  double least_w = 0.0;
  double brake_w = 0.0;
  bev_status status = wanted_command(run, start, &command_w, &least_w);
  int is_settled = 0;
  for (int32_t round = 0; status == BEV_OK && round < BEV_MOST_ROUNDS && !is_settled; round++) {
    brake_w = 0.0;
    if (may_overcharge) {
      const double drawn_w = start->left * start->states[2] + (1.0 - start->left) * command_w;
      brake_w = bev_minimum(
          bev_maximum(0.0, least_w - start->idle.power_w - drawn_w), -propulsion_w);
    }
    status = end_of(run, start, command_w, brake_w, result);
    const double beyond_k = result[1] + run->k_per_watt * result[2]
        + run->share_of_excess * result[3] - highest_c;
    if (command_w <= 0.0 || beyond_k <= BEV_HIGHEST_TOLERANCE_K) {
      is_settled = 1;
    } else {
      command_w = bev_maximum(
          0.0, command_w - beyond_k * run->joules_per_k / start->idle.duration_s);
    }
  }
  if (status != BEV_OK) {
    return status;
  }
  if (!is_settled) {
    return BEV_NOT_SETTLED;
  }
  if (result[0] > 1.0) {
    status = keep_from_overfilling(run, start, bev_maximum(0.0, -propulsion_w), command_w,
                                   &brake_w, result);
  }
  powers_w[0] = command_w;
  powers_w[1] = brake_w;
  return status;
}

bev_status bev_run_heated_within_limits(const bev_vehicle *vehicle, const bev_trip *trip,
                                        const bev_heating *heating, int32_t first, double *states,
                                        double *powers_w, int32_t *empty_step) {
  const bev_status checked = bev_checked(vehicle, trip, first);
  if (checked != BEV_OK) {
    return checked;
  }
  if (!bev_is_heating(heating) || states == NULL || powers_w == NULL || empty_step == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  const int32_t steps = trip->steps;
  const double both_j_per_k =
      vehicle->heat_capacity_j_per_k + vehicle->coolant_heat_capacity_j_per_k;
  const run_of_limits run = {
      vehicle, trip, heating, vehicle->heater_lag_s,
      vehicle->heater_efficiency * vehicle->heater_lag_s / both_j_per_k,
      vehicle->coolant_heat_capacity_j_per_k / both_j_per_k,
      both_j_per_k / vehicle->heater_efficiency};
  for (int32_t k = first; k < steps; k++) {
    step_start start = {k, bev_inputs_of(vehicle, trip, k, NULL, NULL), {0.0, 0.0, 0.0, 0.0},
                        mean_share_left(run.lag_s, trip->duration_s[k])};
    for (int32_t n = 0; n < 4; n++) {
      start.states[n] = states[n * (steps + 1) + k];
      if (!isfinite(start.states[n])) {
        return BEV_BAD_INPUT;
      }
    }
    if (!bev_are_finite(&start.idle) || !isfinite(trip->propulsion_power_w[k])
        || !isfinite(trip->heater_limit_w[k]) || !isfinite(heating->power_w[k])) {
      return BEV_BAD_INPUT;
    }
    double result[8];
    double driven_w[2] = {0.0, 0.0};
    const bev_status status = drive(&run, &start, result, driven_w);
    if (status != BEV_OK) {
      return status;
    }
    powers_w[k] = driven_w[0];
    powers_w[steps + k] = driven_w[1];
    powers_w[2 * steps + k] = result[6];
    powers_w[3 * steps + k] = result[7];
    if (result[0] <= 0.0) {
      *empty_step = k;
      return BEV_EMPTY;
    }
    states[k + 1] = bev_minimum(result[0], 1.0);
    states[steps + 1 + k + 1] = bev_minimum(result[1], vehicle->hottest_c);
    states[2 * (steps + 1) + k + 1] = result[2];
    states[3 * (steps + 1) + k + 1] = result[3];
  }
  return BEV_OK;
}
