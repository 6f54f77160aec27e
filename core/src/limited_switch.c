/* SPDX-License-Identifier: Apache-2.0 */
/* One switching instant within limits: bev_preheat.planning.limited_switch, which documents the reasons. */
#include "limited_switch.h"

#include "bev_preheat_core_generated/constants.h"
#include "bracketing.h"
#include "early_start.h"
#include "limited_step.h"

/* The unheated run, the trial run, and the trial run's commands. */
typedef struct {
  const bev_limited_interval *interval;
  bev_trajectory idle;
  bev_trajectory *run;
  double *command_w;
  uint8_t *watched;
} limited_switch;

static bev_status drive_commanded(limited_switch *of, bev_trajectory *run, int32_t first) {
  const bev_limited_interval *interval = of->interval;
  return bev_drive_on_as_planned(interval->vehicle, interval->trip, of->command_w, first,
                                 run->states[0], run->powers_w[0], of->watched, &run->stranding);
}

/* Copy the unheated run up to step `first`. */
static void copy_idle(limited_switch *of, int32_t first) {
  for (int32_t row = 0; row < of->idle.rows; row++) {
    for (int32_t k = 0; k <= first; k++) {
      of->run->states[row][k] = of->idle.states[row][k];
    }
    for (int32_t k = 0; k < first; k++) {
      of->run->powers_w[row][k] = of->idle.powers_w[row][k];
    }
  }
}

/* The share of the maximum command of a step that the battery can give, from the state of the unheated run. */
static double share_given(const limited_switch *of, int32_t step) {
  const bev_vehicle *vehicle = of->interval->vehicle;
  const bev_trip *trip = of->interval->trip;
  double limits_w[2];
  bev_terminal_limits(vehicle, BEV_AS_ARRAYS, of->idle.states[0][step], of->idle.states[1][step],
                      trip->power_variance_w2[step], limits_w);
  /* A lagging heater takes only part of its limit in this step. */
  const double taken_w = trip->heater_limit_w[step]
      * (1.0 - bev_mean_share_left(vehicle->heater_lag_s, trip->duration_s[step]));
  const double room_w = bev_maximum(limits_w[1] - trip->idle_power_w[step], 0.0);
  return room_w < taken_w ? room_w / taken_w : 1.0;
}

/* The run that is heated from an instant on, above the target on arrival. */
static bev_status heat_within_limits_from(void *searched, double on_s, double *above_k) {
  limited_switch *of = (limited_switch *)searched;
  const bev_trip *trip = of->interval->trip;
  /* A run whose charge runs out cannot be the beginning of another run. */
  const int32_t step = bev_step_at(trip, on_s);
  const int32_t first = of->idle.stranding.step < 0 ? step : 0;
  copy_idle(of, first);
  bev_heat_between(trip, 0, on_s, of->interval->off_s, of->command_w);
  /* A share of the power available to the heater, or a part of the step would heat like the whole step. */
  of->command_w[step] *= share_given(of, step);
  const bev_status status = drive_commanded(of, of->run, first);
  *above_k = of->run->states[1][trip->steps] - of->interval->target_c;
  return status;
}

/* The instant [s] from which heating takes the same energy as in a planned run, whose limits are `most_w` [W]. */
static double guessed_on_s(const limited_switch *of, const double *most_w) {
  const bev_trip *trip = of->interval->trip;
  const bev_trajectory *planned = of->interval->planned;
  const double *idle_w = of->idle.powers_w[0];
  if (planned->states[1][trip->steps] < of->interval->target_c - BEV_ARRIVAL_TOLERANCE_K) {
    /* Heating all the way may not be enough either. */
    return 0.0;
  }
  double left_j = 0.0;
  for (int32_t k = 0; k < trip->steps; k++) {
    left_j += (planned->powers_w[0][k] - idle_w[k]) * trip->duration_s[k];
  }
  bev_heat_between(trip, 0, 0.0, of->interval->off_s, of->command_w);
  for (int32_t k = trip->steps - 1; k >= 0; k--) {
    const double room_w = bev_minimum(of->command_w[k], most_w[k] - trip->idle_power_w[k]);
    const double most_j = (room_w - idle_w[k]) * trip->duration_s[k];
    if (most_j > 0.0) {
      if (left_j <= most_j) {
        const double end_s = bev_minimum(trip->time_s[k + 1], of->interval->off_s);
        return end_s - bev_maximum(left_j, 0.0) / most_j * (end_s - trip->time_s[k]);
      }
      left_j -= most_j;
    }
  }
  return 0.0;
}

bev_status bev_switch_within_limits(const bev_limited_interval *interval, bev_trajectory *run,
                                    uint8_t *watched, double *memory) {
  const bev_trip *trip = interval->trip;
  const int32_t steps = trip->steps;
  const int32_t rows = interval->planned->rows;
  double *left = memory;
  double *const idle_states = bev_take(&left, rows * (steps + 1));
  double *const idle_powers_w = bev_take(&left, rows * steps);
  double *const limits_w = bev_take(&left, 2 * steps);
  limited_switch of;
  of.interval = interval;
  of.idle = bev_trajectory_of(rows, steps, idle_states, idle_powers_w);
  of.run = run;
  of.command_w = bev_take(&left, steps);
  of.watched = watched;
  for (int32_t row = 0; row < rows; row++) {
    of.idle.states[row][0] = interval->planned->states[row][0];
  }
  for (int32_t k = 0; k < steps; k++) {
    of.command_w[k] = 0.0;
  }
  bev_status status = drive_commanded(&of, &of.idle, 0);
  if (status != BEV_OK) {
    return status;
  }
  if (of.idle.states[1][steps] >= interval->target_c) {
    copy_idle(&of, steps);
    run->stranding = of.idle.stranding;
    return BEV_OK;
  }
  status = bev_limits_of_steps(interval->vehicle, steps, interval->planned->states[0],
                               interval->planned->states[1], trip->power_variance_w2, limits_w,
                               &limits_w[steps]);
  if (status != BEV_OK) {
    return status;
  }
  double on_s = guessed_on_s(&of, &limits_w[steps]);
  double above_k = 0.0;
  status = heat_within_limits_from(&of, on_s, &above_k);
  if (status != BEV_OK) {
    return status;
  }
  const bev_ending ending = {BEV_ARRIVAL_TOLERANCE_K, 0.0, BEV_MOST_LIMITED_SWITCH_RUNS};
  const double slope = -bev_warmed_k_per_s(interval->vehicle, trip, on_s)
      * share_given(&of, bev_step_at(trip, on_s));
  return bev_follow_slope(0.0, interval->off_s, slope, &ending, heat_within_limits_from, &of, &on_s, &above_k);
}
