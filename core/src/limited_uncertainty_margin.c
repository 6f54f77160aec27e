/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Heating a little earlier than a plan needs: bev_preheat.planning.uncertainty_margin for any run, within the
 * battery's limits if one is active, and with a heat path.
 */
#include "bev_preheat_core_generated/constants.h"
#include "bracketing.h"
#include "uncertainty_margin.h"
#include "checks.h"
#include "trajectory.h"
#include "early_start.h"
#include "instants.h"
#include "limited_step.h"
#include "limits_of_run.h"

/* The constant inputs, the run that is computed again, and its heating interval from `start_s` on. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  double target_c;
  int32_t is_direct;
  double *states;
  double *powers_w;
  uint8_t *watched;
  /* Command in each step [W]; before step `first`, in which the interval begins, the planned command. */
  double *command_w;
  double *limits_w;
  int32_t first;
  double start_s;
  double latest_end_s;
  /* The end of heating in the current run [s], and whether that run is driven within limits to its end. */
  double end_s;
  int32_t is_driven;
  bev_stranding stranding;
} last_interval;

static double *powers_of(const last_interval *of, int32_t row) {
  return &of->powers_w[row * of->trip->steps];
}

/* The run's temperatures. */
static double *temperature_of(const last_interval *of) { return &of->states[of->trip->steps + 1]; }

static double above_target_k(const last_interval *of) {
  return temperature_of(of)[of->trip->steps] - of->target_c;
}

/* BEV_OK if the steps before `end` keep all limits, BEV_LIMITED if not. */
static bev_status keeps_limits(const last_interval *of, int32_t end) {
  bev_trip before = *of->trip;
  before.steps = end;
  const bev_seen_run run = {of->vehicle,
                            &before,
                            of->states,
                            temperature_of(of),
                            powers_of(of, of->is_direct ? 0 : 2),
                            of->limits_w,
                            &of->limits_w[of->trip->steps]};
  return bev_keeps_limits(&run, 0);
}

/* Move the end of heating: the run is unchanged until the earlier end. Write the commands; return its step. */
static int32_t command_until(last_interval *of, double end_s) {
  const int32_t first = bev_step_at(of->trip, bev_minimum(of->end_s, end_s));
  bev_heat_between(of->trip, first, of->start_s, end_s, of->command_w);
  of->end_s = end_s;
  return first;
}

/* The run heated until an instant, ignoring limits; its excess over the target on arrival. */
static bev_status run_until(void *searched, double end_s, double *above_k) {
  last_interval *of = (last_interval *)searched;
  const int32_t first = command_until(of, end_s);
  const double *const brake_w = powers_of(of, 1);
  const bev_status status = of->is_direct
      ? bev_run(of->vehicle, BEV_RUNGE_KUTTA_4, of->trip, first, of->command_w, brake_w,
                of->states, temperature_of(of))
      : bev_run_heated(of->vehicle, of->trip, first, of->command_w, brake_w, of->states);
  *above_k = above_target_k(of);
  return status;
}

/* Drive within limits from a step on if the current run was driven that way, else from its beginning. */
static bev_status drive_on(last_interval *of, int32_t first) {
  const bev_status status = bev_drive_on_as_planned(
      of->vehicle, of->trip, of->command_w, of->is_driven ? first : 0, of->states, of->powers_w,
      of->watched, &of->stranding);
  /* A run whose charge runs out is driven again from its beginning. */
  of->is_driven = of->stranding.step < 0 ? 1 : 0;
  return status;
}

/* The run that is heated until an instant as far as the battery's limits let it. */
static bev_status drive_until(void *searched, double end_s, double *above_k) {
  last_interval *of = (last_interval *)searched;
  const bev_status status = drive_on(of, command_until(of, end_s));
  *above_k = above_target_k(of);
  return status;
}

/* The end of heating [s] with which the battery arrives at the target. */
static bev_status find_end(last_interval *of, bev_attempt attempt, double guess_s, double *end_s) {
  const bev_ending ending = {BEV_EARLY_TOLERANCE_K, BEV_EARLY_RESOLUTION_S, BEV_MOST_EARLY_RUNS};
  double above_k = 0.0;
  *end_s = bev_minimum(bev_maximum(guess_s, of->start_s), of->latest_end_s);
  /* At first, everything after the start must be computed. */
  of->end_s = of->start_s;
  bev_status status = attempt(of, *end_s, &above_k);
  if (status >= BEV_OK) {
    /* The later heating ends, the warmer the battery arrives. */
    status = bev_follow_slope(of->latest_end_s, of->start_s,
                              bev_warmed_k_per_s(of->vehicle, of->trip, *end_s), &ending, attempt,
                              of, end_s, &above_k);
  }
  return status;
}

/* BEV_LIMITED if a limit is active. */
static bev_status heat_early_beyond_limits(last_interval *of, double guess_s, double *end_s) {
  bev_status status = of->first == 0 ? BEV_OK : keeps_limits(of, of->first);
  if (status == BEV_OK) {
    status = find_end(of, run_until, guess_s, end_s);
  }
  if (status < BEV_OK || status == BEV_LIMITED) {
    return status;
  }
  for (int32_t k = 0; k < of->trip->steps; k++) {
    of->powers_w[k] = of->command_w[k];
  }
  status = BEV_OK;
  if (!of->is_direct) {
    status = bev_heat_along(of->vehicle, of->trip, of->states, of->powers_w, powers_of(of, 1),
                            powers_of(of, 2));
  }
  return status == BEV_OK ? keeps_limits(of, of->trip->steps) : status;
}

/* The plan whose last interval begins early, at `start_s`, and ends as soon as the target is reached. */
static bev_status heat_early(last_interval *of, double guess_s, bev_merit_plan *plan) {
  const bev_trip *trip = of->trip;
  double end_s = NAN;
  bev_status status = heat_early_beyond_limits(of, guess_s, &end_s);
  if (status == BEV_OK) {
    plan->start_s = bev_switched_on_s(trip, of->command_w, 0, of->first);
    if (isnan(plan->start_s) != 0 && end_s > of->start_s) {
      plan->start_s = of->start_s;
    }
  } else if (status == BEV_LIMITED) {
    status = find_end(of, drive_until, guess_s, &end_s);
    plan->start_s = bev_switched_on_within_limits_s(trip, of->powers_w, of->watched);
  } else {
    return status;
  }
  plan->end_s = of->start_s < end_s && end_s < trip->time_s[trip->steps] ? end_s : NAN;
  plan->stranding = of->stranding;
  return status;
}

/* The plan without the interval that begins in a step. */
static bev_status leave_out(last_interval *of, int32_t first, bev_merit_plan *plan) {
  for (int32_t k = first; k < of->trip->steps; k++) {
    of->command_w[k] = 0.0;
  }
  const bev_status status = drive_on(of, 0);
  plan->start_s = bev_switched_on_within_limits_s(of->trip, of->powers_w, of->watched);
  plan->end_s = of->is_direct ? NAN : bev_ends_before_arrival_s(of->trip, of->powers_w);
  plan->stranding = of->stranding;
  return status;
}

bev_status bev_heat_early(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                          const bev_uncertainty_margin *margin, double *states, double *powers_w,
                          uint8_t *watched, double *memory, bev_merit_plan *plan,
                          int32_t *is_changed) {
  bev_status status = bev_checked(vehicle, trip, 0);
  if (status != BEV_OK) {
    return status;
  }
  if (margin == NULL || states == NULL || powers_w == NULL || watched == NULL || memory == NULL
      || plan == NULL || is_changed == NULL || trip->steps < 1) {
    return BEV_BAD_ARGUMENT;
  }
  const int32_t steps = trip->steps;
  const int32_t is_direct = bev_is_direct(vehicle);
  const int32_t rows = is_direct ? 2 : 4;
  if (!isfinite(target_c) || !bev_is_uncertainty_margin(margin) || !bev_is_time(trip)
      || !bev_are_numbers(states, rows * (steps + 1)) || !bev_are_numbers(powers_w, rows * steps)
      || isinf(plan->end_s) != 0) {
    return BEV_BAD_INPUT;
  }
  last_interval of;
  of.vehicle = vehicle;
  of.trip = trip;
  of.target_c = target_c;
  of.is_direct = is_direct;
  of.states = states;
  of.powers_w = powers_w;
  of.watched = watched;
  of.command_w = bev_take(&memory, steps);
  of.limits_w = memory;
  of.latest_end_s = is_direct != 0 || isnan(plan->end_s) != 0 ? trip->time_s[steps] : plan->end_s;
  of.is_driven = 0;
  of.stranding.step = -1;
  of.stranding.driven_share = 1.0;
  for (int32_t k = 0; k < steps; k++) {
    of.command_w[k] = powers_w[k];
  }
  const bev_planned_heating planned = {vehicle, trip, of.command_w, of.latest_end_s};
  bev_early_start start;
  status = bev_find_early_start(&planned, margin, &start);
  *is_changed = status == BEV_OK && start.change != BEV_STAYS ? 1 : 0;
  if (*is_changed == 0) {
    return status;
  }
  if (start.change == BEV_LEFT_OUT) {
    return leave_out(&of, start.first, plan);
  }
  of.first = bev_step_at(trip, start.start_s);
  of.start_s = start.start_s;
  return heat_early(&of, start.guess_s, plan);
}
