/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The whole plan by merit order, from the unheated run on: bev_preheat.planning.merit_order.plan_merit_order, with
 * the parts that it uses of optimal_switch, two_switches, limits and schedule. The reasons are documented there.
 */
#include <stdbool.h>

#include "bev_preheat_core_generated/constants.h"
#include "checks.h"
#include "trajectory.h"
#include "early_start.h"
#include "instants.h"
#include "limited_step.h"
#include "limited_switch.h"
#include "limits_of_run.h"
#include "prices.h"

/* The constant inputs, and the planned run: its states and powers, one array after the other. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  const bev_settling *goal;
  int32_t is_direct;
  double *states;
  double *powers_w;
  double *paid_w;
  uint8_t *watched;
  double *memory;
} planning;

static double *powers_of(const planning *of, int32_t row) {
  return &of->powers_w[row * of->trip->steps];
}

/* Mean heater power in each step. */
static const double *drawn_of(const planning *of) { return powers_of(of, of->is_direct ? 0 : 2); }

/* The vehicle whose heat arrives at once, in a battery that has the coolant's heat capacity too. */
static bev_vehicle lumped_of(const bev_vehicle *vehicle) {
  bev_vehicle lumped = *vehicle;
  lumped.heat_capacity_j_per_k = vehicle->heat_capacity_j_per_k
      * (1.0 + vehicle->coolant_heat_capacity_j_per_k / vehicle->heat_capacity_j_per_k);
  lumped.heater_lag_s = 0.0;
  lumped.coolant_heat_capacity_j_per_k = 0.0;
  lumped.coolant_conductance_w_per_k = 0.0;
  return lumped;
}

/* One heating interval that meets the target, ignoring limits. */
static bev_status heat_once(const planning *of, const double *idle_states, bev_merit_plan *plan) {
  const bev_trip *trip = of->trip;
  const int32_t steps = trip->steps;
  const int32_t instants = steps + 1;
  double start_s = 0.0;
  double end_s = 0.0;
  bev_status status = BEV_OK;
  for (int32_t n = 0; n < 2 * steps; n++) {
    of->powers_w[n] = 0.0;
  }
  if (idle_states[instants + steps] >= of->goal->target_c) {
    const int32_t rows = of->is_direct ? 2 : 4;
    for (int32_t n = 0; n < rows * instants; n++) {
      of->states[n] = idle_states[n];
    }
  } else if (of->is_direct != 0) {
    status = bev_find_switch(of->vehicle, trip, of->goal->target_c, idle_states,
                             &idle_states[instants], of->states, &of->states[instants],
                             of->powers_w, &start_s);
    plan->start_s = start_s;
  } else {
    status = bev_find_two_switches(of->vehicle, trip, of->goal->target_c, idle_states, of->memory,
                                   of->states, of->powers_w, &start_s, &end_s);
    for (int32_t k = 0; k < steps && isnan(plan->start_s); k++) {
      if (of->powers_w[k] != 0.0) {
        plan->start_s = start_s;
        plan->end_s = end_s < trip->time_s[steps] ? end_s : NAN;
      }
    }
  }
  if (status < BEV_OK) {
    return status;
  }
  return of->is_direct ? BEV_OK
                       : bev_heat_along(of->vehicle, trip, of->states, of->powers_w, NULL,
                                        powers_of(of, 2));
}

static bev_status keeps_limits(const planning *of) {
  const int32_t steps = of->trip->steps;
  const bev_seen_run run = {of->vehicle,   of->trip,   of->states, &of->states[steps + 1],
                            drawn_of(of), of->memory, &of->memory[steps]};
  return bev_keeps_limits(&run, 0);
}

/* The most heater power that each step is paid for: later than a plan without limits nothing is. */
static void find_paid_w(const planning *of, double end_s) {
  const bev_trip *trip = of->trip;
  const double until_s = isnan(end_s) ? trip->time_s[trip->steps] : end_s;
  for (int32_t k = 0; k < trip->steps; k++) {
    of->paid_w[k] = trip->heater_limit_w[k];
    if (!of->is_direct) {
      const double paid_s =
          bev_minimum(trip->time_s[k + 1], until_s) - bev_maximum(trip->time_s[k], 0.0);
      of->paid_w[k] *= bev_minimum(bev_maximum(paid_s / trip->duration_s[k], 0.0), 1.0);
    }
  }
}

/* When a run within limits heats, from its commands and the steps whose limits were checked. */
static void find_instants(const planning *of, bev_merit_plan *plan) {
  plan->start_s = bev_switched_on_within_limits_s(of->trip, of->powers_w, of->watched);
  plan->end_s = of->is_direct ? NAN : bev_ends_before_arrival_s(of->trip, of->powers_w);
}

/* BEV_OK if no limit is missed that can be kept, else BEV_LIMITED. */
static bev_status misses_no_limit(const planning *of) {
  const bev_trip *trip = of->trip;
  const double *drawn_w = drawn_of(of);
  const double *brake_w = powers_of(of, 1);
  double *least_w = of->memory;
  double *most_w = &of->memory[trip->steps];
  bev_status status = bev_limits_of_steps(of->vehicle, trip->steps, of->states,
                                       &of->states[trip->steps + 1], trip->power_variance_w2,
                                       least_w, most_w);
  for (int32_t k = 0; k < trip->steps && status == BEV_OK; k++) {
    const double terminal_w = trip->idle_power_w[k] + drawn_w[k] + brake_w[k];
    const double overcharged_w = bev_minimum(least_w[k] - terminal_w,
                                             -trip->propulsion_power_w[k] - brake_w[k]);
    const double overdrawn_w = bev_minimum(terminal_w - most_w[k], drawn_w[k]);
    if (!(overcharged_w <= BEV_ACTIVE_W && overdrawn_w <= BEV_ACTIVE_W)) {
      status = BEV_LIMITED;
    }
  }
  return status;
}

/* Drive the run within limits, which are checked in each step. */
static bev_status keep_limits(const planning *of, bev_stranding *stranding) {
  for (int32_t k = 0; k < of->trip->steps; k++) {
    of->paid_w[k] = of->powers_w[k];
  }
  return bev_drive_as_planned(of->vehicle, of->trip, of->paid_w, of->states, of->powers_w,
                              of->watched, stranding);
}

/* The run heated in the cheapest steps, if it keeps the limits; otherwise the run heated once. */
static bev_status heat_cheapest(const planning *of, const double *idle_states, int32_t *order,
                                bev_merit_plan *plan) {
  const int32_t steps = of->trip->steps;
  int32_t orders = 0;
  bev_status status = bev_heat_cheapest(of->vehicle, of->trip, of->goal->target_c, of->states,
                                        &of->states[steps + 1], of->powers_w, of->memory, order,
                                        &orders);
  if (status != BEV_OK || orders == 0) {
    return status;
  }
  status = keeps_limits(of);
  if (status == BEV_LIMITED) {
    return heat_once(of, idle_states, plan);
  }
  for (int32_t n = 0; n < 2 * steps; n++) {
    of->watched[n] = 0u;
  }
  find_instants(of, plan);
  return status;
}

/* Exchange heat in a run whose limits were all checked; a run that strands stays unchanged. */
static bev_status exchange_heat(const planning *of, const bev_stranding *stranding) {
  const int32_t steps = of->trip->steps;
  int32_t exchanges = 0;
  if (stranding->step >= 0) {
    return BEV_OK;
  }
  const bev_status status =
      bev_exchange_heat(of->vehicle, of->trip, of->goal, of->states, of->powers_w,
                        &of->watched[2 * steps], of->memory, &exchanges);
  for (int32_t n = 0; n < 2 * steps && exchanges > 0; n++) {
    of->watched[n] = of->watched[2 * steps + n];
  }
  return status;
}

static double missed_k(const planning *of, const bev_trajectory *run) {
  return bev_maximum(0.0, of->goal->target_c - run->states[1][of->trip->steps]);
}

static double least_soc(const planning *of, const bev_trajectory *run) {
  double least = run->states[0][0];
  for (int32_t k = 1; k <= of->trip->steps; k++) {
    least = bev_minimum(least, run->states[0][k]);
  }
  return least;
}

/* Whether a run is nearer to the target than another, or saves charge, and is else no worse. */
static bev_status saves(const planning *of, const bev_trajectory *run, const bev_trajectory *other,
                        bool *is_so) {
  const int32_t steps = of->trip->steps;
  const double more_missed_k = missed_k(of, run) - missed_k(of, other);
  const double soc = run->states[0][steps];
  const double other_soc = other->states[0][steps];
  const double whole_wh = bev_whole_charge_wh(of->vehicle, other_soc, other->states[1][steps]);
  const double soc_per_k = BEV_PENALTY * of->vehicle->heat_capacity_j_per_k
      / of->vehicle->heater_efficiency / (whole_wh * BEV_JOULES_PER_WH);
  const bool is_warmer = more_missed_k < -BEV_LEAST_WARMER_K
      || (more_missed_k < -BEV_ARRIVAL_TOLERANCE_K
          && other_soc - soc <= -more_missed_k * soc_per_k);
  const bool is_cheaper =
      more_missed_k <= BEV_ARRIVAL_TOLERANCE_K && soc > other_soc + BEV_LEAST_SAVING_SOC;
  double deficit_w = 0.0;
  double other_deficit_w = 0.0;
  bev_status status = BEV_OK;
  *is_so = run->stranding.step < 0 && (is_warmer || is_cheaper)
      && least_soc(of, run) >= bev_minimum(of->goal->lowest_soc, least_soc(of, other));
  if (*is_so) {
    status = bev_deficit_w(of->vehicle, of->trip, run, &deficit_w);
    if (status == BEV_OK) {
      status = bev_deficit_w(of->vehicle, of->trip, other, &other_deficit_w);
    }
    *is_so = deficit_w <= other_deficit_w;
  }
  return status;
}

/* Replace the planned run by another. */
static void take_over(const planning *of, const bev_trajectory *from, const uint8_t *watched) {
  const int32_t steps = of->trip->steps;
  for (int32_t n = 0; n < from->rows * (steps + 1); n++) {
    of->states[n] = from->states[0][n];
  }
  for (int32_t n = 0; n < from->rows * steps; n++) {
    of->powers_w[n] = from->powers_w[0][n];
  }
  for (int32_t n = 0; n < 2 * steps; n++) {
    of->watched[n] = watched[n];
  }
}

/*
 * If heat arrives late: the run without thresholds, heated once between two instants (NaN: not, and until arrival)
 * or not at all, if it saves charge compared with the planned run.
 */
static bev_status leave_out_thresholds(const planning *of, const bev_merit_plan *once,
                                       bev_stranding *stranding) {
  const bev_trip *trip = of->trip;
  const int32_t steps = trip->steps;
  const double end_s = isnan(once->end_s) != 0 ? trip->time_s[steps] : once->end_s;
  double *memory = of->memory;
  uint8_t *const watched = &of->watched[2 * steps];
  double *const command_w = of->paid_w;
  double *const states = bev_take(&memory, 4 * (steps + 1));
  double *const powers_w = bev_take(&memory, 4 * steps);
  bev_trajectory best = bev_trajectory_of(4, steps, of->states, of->powers_w);
  bev_status status = BEV_OK;
  best.stranding = *stranding;
  for (int32_t n = 0; n < 4 && status == BEV_OK; n++) {
    bev_trajectory run = bev_trajectory_of(4, steps, states, powers_w);
    bool is_better = false;
    for (int32_t k = 0; k < steps; k++) {
      command_w[k] = 0.0;
    }
    if (n < 2 && isnan(once->start_s) == 0) {
      bev_heat_between(trip, 0, once->start_s, end_s, command_w);
    }
    for (int32_t row = 0; row < 4; row++) {
      run.states[row][0] = of->states[row * (steps + 1)];
    }
    status = n % 2 == 0
        ? bev_drive_as_planned(of->vehicle, trip, command_w, states, powers_w, watched,
                               &run.stranding)
        : bev_drive_without_surplus(of->vehicle, trip, command_w, states, powers_w, watched,
                                    &run.stranding);
    if (status == BEV_OK) {
      status = saves(of, &run, &best, &is_better);
    }
    if (status == BEV_OK && is_better) {
      take_over(of, &run, watched);
      best.stranding = run.stranding;
      *stranding = run.stranding;
    }
  }
  return status;
}

/* One heating interval driven within limits, with the end of that of `once`, if it saves charge. */
static bev_status switch_once(const planning *of, const bev_merit_plan *once,
                              bev_stranding *stranding, bool *is_taken) {
  const bev_trip *trip = of->trip;
  const int32_t steps = trip->steps;
  const int32_t rows = of->is_direct != 0 ? 2 : 4;
  double *memory = of->memory;
  uint8_t *const watched = &of->watched[2 * steps];
  double *const states = bev_take(&memory, rows * (steps + 1));
  double *const powers_w = bev_take(&memory, rows * steps);
  bev_trajectory run = bev_trajectory_of(rows, steps, states, powers_w);
  bev_trajectory best = bev_trajectory_of(rows, steps, of->states, of->powers_w);
  best.stranding = *stranding;
  const bev_limited_interval interval = {
      of->vehicle, trip, of->goal->target_c,
      isnan(once->end_s) != 0 ? trip->time_s[steps] : once->end_s, &best};
  bev_status status = bev_switch_within_limits(&interval, &run, watched, memory);
  if (status == BEV_OK) {
    status = saves(of, &run, &best, is_taken);
  }
  if (status == BEV_OK && *is_taken) {
    take_over(of, &run, watched);
    *stranding = run.stranding;
  }
  return status;
}

/* Remaining improvements: of the run under thresholds, and one heating interval if that is better. */
static bev_status improve(const planning *of, const bev_merit_plan *once,
                          bev_stranding *stranding) {
  bool is_taken = false;
  bev_status status = of->is_direct != 0 ? exchange_heat(of, stranding)
                                         : leave_out_thresholds(of, once, stranding);
  if (status == BEV_OK) {
    status = switch_once(of, once, stranding, &is_taken);
  }
  return status == BEV_OK && is_taken && of->is_direct != 0 ? exchange_heat(of, stranding) : status;
}

bev_status bev_plan_merit_order(const bev_vehicle *vehicle, const bev_trip *trip,
                                const bev_settling *goal, const double *idle_states,
                                double *states, double *powers_w, uint8_t *watched,
                                int32_t *order, double *memory, bev_merit_plan *plan) {
  bev_status status = bev_checked(vehicle, trip, 0);
  if (status != BEV_OK) {
    return status;
  }
  if (goal == NULL || idle_states == NULL || states == NULL || powers_w == NULL || watched == NULL
      || order == NULL || memory == NULL || plan == NULL || trip->steps < 1) {
    return BEV_BAD_ARGUMENT;
  }
  planning of;
  of.vehicle = vehicle;
  of.trip = trip;
  of.goal = goal;
  of.is_direct = bev_is_direct(vehicle);
  of.states = states;
  of.powers_w = powers_w;
  of.paid_w = bev_take(&memory, trip->steps);
  of.watched = watched;
  of.memory = memory;
  if (!isfinite(goal->target_c) || !isfinite(goal->lowest_soc) || !bev_is_time(trip)
      || !bev_are_numbers(idle_states, (of.is_direct ? 2 : 4) * (trip->steps + 1))) {
    return BEV_BAD_INPUT;
  }
  plan->start_s = NAN;
  plan->end_s = NAN;
  plan->stranding.step = -1;
  plan->stranding.driven_share = 1.0;
  status = heat_once(&of, idle_states, plan);
  if (status == BEV_OK) {
    status = keeps_limits(&of);
  }
  if (status == BEV_OK && of.is_direct != 0) {
    status = heat_cheapest(&of, idle_states, order, plan);
  }
  if (status != BEV_LIMITED) {
    return status;
  }
  const bev_vehicle lumped = lumped_of(vehicle);
  const bev_merit_plan once = *plan;
  find_paid_w(&of, plan->end_s);
  status = bev_merit_order(vehicle, &lumped, trip, goal, of.paid_w, states, powers_w,
                           &plan->stranding, watched, memory);
  if (status == BEV_OK) {
    status = misses_no_limit(&of);
  }
  if (status == BEV_LIMITED) {
    status = keep_limits(&of, &plan->stranding);
  }
  if (status == BEV_OK) {
    status = improve(&of, &once, &plan->stranding);
  }
  if (status == BEV_OK) {
    find_instants(&of, plan);
  }
  return status;
}
