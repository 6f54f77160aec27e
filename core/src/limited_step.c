/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One step within limits, at both of its ends: bev_preheat.planning.limited_drive.
 */
#include "limited_run.h"

#include "bev_preheat_core_generated/constants.h"
#include <stdbool.h>

#include "bracketing.h"
#include "checks.h"

/* Maximum number of rounds for finding the command that keeps the highest temperature. */
#define MOST_HEATING_ROUNDS 1000

/* One step on its way. */
typedef struct {
  int32_t k;
  bev_inputs idle;
  const double *states;
  /* Remaining share of the difference between heater and command, mean over the step. */
  double left;
  bev_merit merit;
} step_start;

bev_limited_run bev_limited_run_of(const bev_vehicle *vehicle, const bev_trip *trip, const uint8_t *may_overcharge,
                                   const uint8_t *may_overdraw, int32_t takes_surplus, int32_t is_direct) {
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
static bev_status end_of(const bev_limited_run *run, const step_start *start, double command_w, double brake_w,
                         double result[8]) {
  const bev_vehicle *vehicle = run->vehicle;
  const double drawn_w = bev_electric_w(&start->merit, command_w);
  bev_inputs inputs = start->idle;
  if (run->is_direct != 0) {
    inputs.power_w = start->idle.power_w + drawn_w + brake_w;
    inputs.heat_w = bev_heat_under_w(vehicle, start->idle.heat_w, command_w, brake_w);
    bev_integrate(vehicle, BEV_RUNGE_KUTTA_4, 1, start->states[0], start->states[1], &inputs,
                  result);
    /* Of several sources the command is known from the heat at the end of the step. */
    result[2] = start->merit.count == 0 ? 0.0 : command_w;
    result[3] = 0.0;
    result[6] = drawn_w;
    result[7] = bev_heat_with_heater_w(vehicle, 0.0, command_w);
  } else {
    const double other_w = start->merit.count == 0 ? 0.0 : drawn_w - command_w;
    inputs.power_w = start->idle.power_w + brake_w + other_w;
    inputs.heat_w = bev_heat_with_brake_w(vehicle, start->idle.heat_w, brake_w);
    bev_integrate_heated(vehicle, 1, start->states, &inputs, command_w, result);
    result[6] += other_w;
  }
  return bev_kind_of(result[0], result[1]) == BEV_OK && bev_kind_of(result[2], result[3]) == BEV_OK
      ? BEV_OK
      : BEV_NOT_FINITE;
}

/* The last step that begins within `duration_s` after the end of step k. */
static int32_t last_after(const bev_trip *trip, int32_t k, double duration_s) {
  double left_s = duration_s;
  for (int32_t last = k; last + 1 < trip->steps; last++) {
    if (!(left_s > 0.0)) {
      return last;
    }
    left_s -= trip->duration_s[last + 1];
  }
  return trip->steps - 1;
}

static int is_before_climb(const bev_limited_run *run, int32_t k) {
  const bev_trip *trip = run->trip;
  const double until_s = trip->time_s[k + 1] + BEV_LAGS_AHEAD * run->lag_s;
  for (int32_t j = k + 1; j < trip->steps; j++) {
    if (!(trip->time_s[j] < until_s)) {
      return 0;
    }
    if (run->may_overdraw[j] != 0u && trip->time_s[j] > trip->time_s[k]) {
      return 1;
    }
  }
  return 0;
}

/* The command after which the heater, switched off, leaves a climb its power [W]. */
static double off_in_time_w(const bev_limited_run *run, int32_t k, const double states[4]) {
  const bev_trip *trip = run->trip;
  if (!is_before_climb(run, k)) {
    return INFINITY;
  }
  double allowed_w = INFINITY;
  for (int32_t j = last_after(trip, k, BEV_LAGS_AHEAD * run->lag_s); j > k; j--) {
    const double decay = exp(-trip->duration_s[j] / run->lag_s);
    allowed_w = decay > 0.0 ? allowed_w / decay : INFINITY;
    if (run->may_overdraw[j] != 0u) {
      double limits_w[2];
      bev_terminal_limits(run->vehicle, 0, states[0], states[1],
                          trip->power_variance_w2[j], limits_w);
      allowed_w = bev_minimum(
          allowed_w, bev_maximum(limits_w[1] - trip->idle_power_w[j], 0.0)
              / bev_mean_share_left(run->lag_s, trip->duration_s[j]));
    }
  }
  const double decay = exp(-trip->duration_s[k] / run->lag_s);
  return (allowed_w - decay * states[2]) / (1.0 - decay);
}

/* The part of the surplus that lasts [W]: heater power beyond it is paid for later. */
static double lasting_surplus_w(const bev_limited_run *run, int32_t k, const double states[4]) {
  const bev_trip *trip = run->trip;
  const double ahead_s = BEV_LASTING_LAGS * run->lag_s - 0.5 * trip->duration_s[k];
  const int32_t last = last_after(trip, k, ahead_s);
  if (last == k) {
    return INFINITY;
  }
  double lasting_s = 0.0;
  double least_w = INFINITY;
  for (int32_t j = k + 1; j <= last; j++) {
    double limits_w[2];
    lasting_s += trip->duration_s[j];
    bev_terminal_limits(run->vehicle, 0, states[0], states[1],
                        trip->power_variance_w2[j], limits_w);
    least_w = bev_minimum(least_w, limits_w[0] - trip->idle_power_w[j]);
  }
  return lasting_s < ahead_s ? 0.0 : bev_maximum(0.0, least_w);
}

/*
 * The command between two terminal powers [W], without regard to temperatures; its part beyond `paid_w` is surplus.
 */
static bev_status limited_command(const bev_limited_run *run, const step_start *start, const double limits_w[2],
                                  double *command_w, double *paid_w) {
  const int32_t k = start->k;
  const double power_w = start->idle.power_w;
  const double heater_w = start->states[2];
  const bool may_overcharge = run->may_overcharge[k] != 0u;
  double cap_w = bev_capped_w(&start->merit, run->trip->heater_limit_w[k]);
  double wanted_w = bev_capped_w(&start->merit, *command_w);
  if (bev_warmest_c(run, start->states) >= run->vehicle->highest_c) {
    cap_w = 0.0;
    wanted_w = bev_minimum(wanted_w, 0.0);
  }
  if (may_overcharge || run->may_overdraw[k] != 0u) {
    const double room_w =
        (bev_heat_of_w(&start->merit, limits_w[1] - power_w) - start->left * heater_w)
        / (1.0 - start->left);
    wanted_w = wanted_w < 0.0
        ? bev_maximum(wanted_w, bev_cold_of_w(&start->merit, limits_w[1] - power_w))
        : bev_maximum(0.0, bev_minimum(wanted_w, room_w));
  }
  *paid_w = wanted_w;
  if (may_overcharge && run->takes_surplus != 0 && wanted_w >= 0.0) {
    double surplus_w = bev_heat_of_w(&start->merit, limits_w[0] - power_w);
    if (run->lag_s > 0.0 && surplus_w > 0.0) {
      surplus_w = bev_minimum(surplus_w, lasting_surplus_w(run, k, start->states));
    }
    const double free_w = bev_minimum(cap_w, surplus_w);
    if (wanted_w <= free_w) {
      /* The surplus covers the wanted heat: no heat is paid for, for any caller. */
      wanted_w = free_w;
      *paid_w = 0.0;
    }
  }
  if (run->lag_s > 0.0 && wanted_w > 0.0) {
    wanted_w =
        bev_maximum(0.0, bev_minimum(wanted_w, off_in_time_w(run, k, start->states)));
  }
  *command_w = wanted_w;
  return isfinite(wanted_w) ? BEV_OK : BEV_NOT_FINITE;
}

/* The brake takes what would overfill the battery. */
static bev_status keep_from_overfilling(const bev_limited_run *run, const step_start *start, double most_w,
                                        double command_w, double *brake_w, double result[8]) {
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

/*
 * The step between two terminal powers [W], with the command that keeps the highest temperature, its surplus as far
 * as that is useful, and the brake that goes with it. `command_w` is the request, then the command.
 */
static bev_status drive_between(const bev_limited_run *run, const step_start *start, const double limits_w[2],
                                double *command_w, double *brake_w, double result[8]) {
  const double propulsion_w = run->trip->propulsion_power_w[start->k];
  const double highest_c = run->vehicle->highest_c;
  const bool may_overcharge = run->may_overcharge[start->k] != 0u;
  double paid_w = 0.0;
  bev_status status = limited_command(run, start, limits_w, command_w, &paid_w);
  int is_settled = 0;
  for (int32_t round = 0; status == BEV_OK && round < MOST_HEATING_ROUNDS && !is_settled; round++) {
    *brake_w = 0.0;
    if (may_overcharge) {
      const double drawn_w = bev_electric_w(
          &start->merit, start->left * start->states[2] + (1.0 - start->left) * *command_w);
      *brake_w = bev_minimum(
          bev_maximum(0.0, limits_w[0] - start->idle.power_w - drawn_w), -propulsion_w);
    }
    status = end_of(run, start, *command_w, *brake_w, result);
    /* Near the highest temperature surplus goes to the brake. */
    const bool has_surplus = *command_w > paid_w;
    const double beyond_k =
        bev_warmest_c(run, result) - (has_surplus ? highest_c - BEV_BELOW_HIGHEST_K : highest_c);
    if (*command_w <= 0.0 || beyond_k <= BEV_HIGHEST_TOLERANCE_K) {
      is_settled = 1;
    } else {
      *command_w =
          bev_maximum(has_surplus ? paid_w : 0.0,
                      *command_w - beyond_k * run->joules_per_k / start->idle.duration_s);
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

/* A step that keeps the limits at its end, and the result of the last terminal power tried. */
typedef struct {
  const bev_limited_run *run;
  const step_start *start;
  double wanted_w;
  /* Least and most terminal power [W]; which of them is moved. */
  double limits_w[2];
  int moved;
  double command_w;
  double brake_w;
  double *result;
} step_to_end;

static double terminal_w(const step_to_end *of) {
  return of->start->idle.power_w + of->result[6] + of->brake_w;
}

static bev_status limits_at_end(const step_to_end *of, double limits_w[2]) {
  const bev_vehicle *vehicle = of->run->vehicle;
  bev_terminal_limits(vehicle, 0, bev_minimum(of->result[0], 1.0),
                      bev_minimum(of->result[1], vehicle->hottest_c),
                      of->start->idle.variance_w2, limits_w);
  return isfinite(limits_w[0]) && isfinite(limits_w[1]) ? BEV_OK : BEV_NOT_FINITE;
}

static double spare_w(const step_to_end *of, const double limits_w[2]) {
  const double to_spare_w =
      of->moved == 1 ? limits_w[1] - terminal_w(of) : terminal_w(of) - limits_w[0];
  return to_spare_w - 0.5 * BEV_END_TOLERANCE_W;
}

/* The step with one limit moved. */
static bev_status attempt_end(void *moved, double limit_w, double *excess) {
  step_to_end *of = (step_to_end *)moved;
  double at_end_w[2];
  of->limits_w[of->moved] = limit_w;
  of->command_w = of->wanted_w;
  bev_status status = drive_between(of->run, of->start, of->limits_w, &of->command_w,
                                    &of->brake_w, of->result);
  if (status == BEV_OK) {
    status = limits_at_end(of, at_end_w);
  }
  *excess = status == BEV_OK ? spare_w(of, at_end_w) : NAN;
  return status;
}

/* Move the step's terminal power towards the utmost until the limit at the end holds. */
static bev_status move_limit(step_to_end *of, int moved, double utmost_w, const double at_end_w[2]) {
  double value_w = terminal_w(of);
  of->moved = moved;
  double excess_w = spare_w(of, at_end_w);
  const bev_ending ending = {0.5 * BEV_END_TOLERANCE_W, 0.0, BEV_MOST_TRIALS};
  bev_status status = bev_follow_slope(utmost_w, value_w, moved == 1 ? -1.0 : 1.0, &ending,
                                       attempt_end, of, &value_w, &excess_w);
  if (status == BEV_OK && excess_w < -0.5 * BEV_END_TOLERANCE_W && value_w != utmost_w) {
    /* In a long step less heat may lower the limit by more than it saves: the limit cannot be kept. */
    status = attempt_end(of, utmost_w, &excess_w);
  }
  return status;
}

/* The step that keeps the limits at both ends, as far as heater and brake can. */
static bev_status drive_to_end(step_to_end *of) {
  const bev_limited_run *run = of->run;
  const step_start *start = of->start;
  const double propulsion_w = run->trip->propulsion_power_w[start->k];
  const bool may_overcharge = run->may_overcharge[start->k] != 0u;
  bev_terminal_limits(run->vehicle, 0, start->states[0], start->states[1],
                      start->idle.variance_w2, of->limits_w);
  if (!isfinite(of->limits_w[0]) || !isfinite(of->limits_w[1])) {
    return BEV_NOT_FINITE;
  }
  bev_status status = drive_between(run, start, of->limits_w, &of->command_w, &of->brake_w,
                                    of->result);
  if (status != BEV_OK || of->result[0] <= 0.0) {
    return status;
  }
  double at_end_w[2];
  status = limits_at_end(of, at_end_w);
  if (status != BEV_OK) {
    return status;
  }
  if (terminal_w(of) > at_end_w[1] && of->command_w != 0.0) {
    return move_limit(of, 1, start->idle.power_w, at_end_w);
  }
  if (may_overcharge && terminal_w(of) < at_end_w[0] && of->brake_w < -propulsion_w) {
    return move_limit(of, 0, start->idle.power_w - propulsion_w, at_end_w);
  }
  return BEV_OK;
}

bev_status bev_drive_within_limits(const bev_limited_run *run, int32_t k, const double states[4], double wanted_w,
                                   double ends[4], double powers_w[4]) {
  const bev_trip *trip = run->trip;
  step_start start;
  start.k = k;
  start.idle = bev_inputs_of(run->vehicle, trip, k, NULL, NULL);
  start.states = states;
  bev_merit_at(trip, k, states[1], &start.merit);
  start.left =
      run->is_direct != 0 ? 0.0 : bev_mean_share_left(run->lag_s, trip->duration_s[k]);
  if (!bev_are_finite(&start.idle) || !isfinite(trip->propulsion_power_w[k])
      || !isfinite(trip->heater_limit_w[k]) || !isfinite(wanted_w)) {
    return BEV_BAD_INPUT;
  }
  double result[8];
  step_to_end driven = {run, &start, wanted_w, {0.0, 0.0}, 0, wanted_w, 0.0, result};
  const bev_status status =
      run->may_overcharge[k] != 0u || run->may_overdraw[k] != 0u
          ? drive_to_end(&driven)
          : drive_between(run, &start, driven.limits_w, &driven.command_w, &driven.brake_w, result);
  if (status != BEV_OK) {
    return status;
  }
  powers_w[0] = driven.command_w;
  powers_w[1] = driven.brake_w;
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
