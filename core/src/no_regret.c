/* SPDX-License-Identifier: Apache-2.0 */
/*
 * No plan is worse than not heating: bev_preheat.planning.no_regret over the proposals of merit_order, with an
 * uncertainty margin as in bev_preheat.planning.planner.
 */
#include <stdbool.h>

#include "bev_preheat_core_generated/constants.h"
#include "uncertainty_margin.h"
#include "checks.h"
#include "trajectory.h"
#include "instants.h"
#include "limited_step.h"

/* The constant inputs, the largest power deficit allowed, and the working memory of plans. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  const bev_safe_goal *goal;
  const bev_uncertainty_margin *margin;
  const double *idle_states;
  int32_t rows;
  double allowed_w;
  int32_t serves_climbs;
  uint8_t *watched;
  int32_t *order;
  double *memory;
} no_regret_check;

/* The run proposed for a target, with its instants and its margins. */
typedef struct {
  double *states;
  double *powers_w;
  bev_merit_plan plan;
  double target_c;
  double spare_soc;
  double spare_w;
} proposed;

static bev_trajectory trajectory_of(const no_regret_check *of, const proposed *run) {
  bev_trajectory trajectory = bev_trajectory_of(of->rows, of->trip->steps, run->states, run->powers_w);
  trajectory.stranding = run->plan.stranding;
  return trajectory;
}

static double arrival_c(const no_regret_check *of, const proposed *run) {
  return run->states[2 * of->trip->steps + 1];
}

/* The terminal energy for the rest of a trip whose charge runs out [Wh]. */
static double deficit_wh(const bev_trip *trip, const bev_stranding *stranding) {
  double rest_j = 0.0;
  double most_j = 0.0;
  for (int32_t k = stranding->step; k < trip->steps; k++) {
    const double driven_share = k == stranding->step ? stranding->driven_share : 0.0;
    rest_j += (1.0 - driven_share) * trip->idle_power_w[k] * trip->duration_s[k];
    /* Energy from a later descent is not available before the descent. */
    most_j = bev_maximum(most_j, rest_j);
  }
  return most_j / BEV_JOULES_PER_WH;
}

/* Charge margin: on arrival above the required charge, on the way above the lowest charge. */
static bev_status find_spare_soc(const no_regret_check *of, proposed *run) {
  const int32_t steps = of->trip->steps;
  double least = run->states[0];
  for (int32_t k = 1; k <= steps; k++) {
    least = bev_minimum(least, run->states[k]);
  }
  run->spare_soc =
      bev_minimum(run->states[steps] - of->goal->reserve_soc, least - of->goal->lowest_soc);
  if (run->plan.stranding.step >= 0) {
    const double whole_wh = of->vehicle->capacity_ah
        * bev_at(&of->vehicle->open_circuit_voltage, BEV_EXACT, 0.0, arrival_c(of, run));
    run->spare_soc -=
        bev_maximum(deficit_wh(of->trip, &run->plan.stranding) / whole_wh, BEV_SOC_TOLERANCE);
  }
  return isfinite(run->spare_soc) ? BEV_OK : BEV_NOT_FINITE;
}

static bev_status find_what_is_spare(const no_regret_check *of, proposed *run) {
  const bev_trajectory trajectory = trajectory_of(of, run);
  double deficit_w = 0.0;
  bev_status status = find_spare_soc(of, run);
  if (status == BEV_OK) {
    status = bev_deficit_w(of->vehicle, of->trip, &trajectory, &deficit_w);
  }
  run->spare_w = of->allowed_w - deficit_w;
  return status;
}

/* Whether a run stays within the range of charge and temperature that the model describes. */
static bool is_described(const no_regret_check *of, const proposed *run) {
  const int32_t instants = of->trip->steps + 1;
  bool is = true;
  for (int32_t k = 0; k < instants; k++) {
    is = is && run->states[k] > 0.0 && run->states[k] <= 1.0
        && run->states[instants + k] <= of->vehicle->hottest_c;
  }
  return is;
}

/* Drive the run within limits. */
static bev_status drive(const no_regret_check *of, proposed *run) {
  double *const command_w = of->memory;
  for (int32_t k = 0; k < of->trip->steps; k++) {
    command_w[k] = run->powers_w[k];
  }
  const bev_status status =
      bev_drive_without_surplus(of->vehicle, of->trip, command_w, run->states, run->powers_w,
                                of->watched, &run->plan.stranding);
  run->plan.start_s = bev_switched_on_within_limits_s(of->trip, run->powers_w, of->watched);
  run->plan.end_s =
      of->rows == 2 ? NAN : bev_ends_before_arrival_s(of->trip, run->powers_w);
  return status;
}

/* Propose a run for a target. */
static bev_status propose(const no_regret_check *of, double target_c, proposed *run) {
  int32_t is_changed = 0;
  bev_settling goal = {of->serves_climbs, target_c, of->goal->lowest_soc};
  if (of->margin != NULL) {
    goal.target_c = bev_minimum(target_c + of->goal->margin_k, of->vehicle->highest_c);
  }
  bev_status status =
      bev_plan_merit_order(of->vehicle, of->trip, &goal, of->idle_states, run->states,
                           run->powers_w, of->watched, of->order, of->memory, &run->plan);
  if (status == BEV_OK && of->margin != NULL) {
    status = bev_heat_early(of->vehicle, of->trip, goal.target_c, of->margin, run->states,
                            run->powers_w, of->watched, of->memory, &run->plan, &is_changed);
  }
  if (status == BEV_OK && !is_described(of, run)) {
    status = drive(of, run);
  }
  run->target_c = target_c;
  return status == BEV_OK ? find_what_is_spare(of, run) : status;
}

static bool is_allowed(const proposed *run) {
  return run->spare_soc >= 0.0 && run->spare_w >= 0.0;
}

/* Margin of a run [share of the charge]. */
static double excess_of(const proposed *run) {
  /* A power margin does not make heat affordable; a power deficit forbids it. */
  return run->spare_w >= 0.0 ? run->spare_soc
                             : bev_minimum(run->spare_soc, run->spare_w / BEV_POWER_WEIGHT_W);
}

static bool is_close(const proposed *allowed, const proposed *forbidden) {
  const double width_k =
      forbidden->spare_w < 0.0 ? BEV_TARGET_TOLERANCE_OF_POWER_K : BEV_TARGET_TOLERANCE_K;
  return excess_of(allowed) <= BEV_SOC_TOLERANCE || forbidden->target_c - allowed->target_c <= width_k;
}

/* Weight of the side that does not move, once the other side's excess was `before`. */
static double left_of(double excess, double before) {
  const double left = before != 0.0 ? 1.0 - excess / before : 0.0;
  return left > 0.0 ? left : 0.5;
}

/* The warmest allowed run, between an allowed and a forbidden run: close_in of planning.bracketing. */
static bev_status close_in(const no_regret_check *of, proposed *allowed, proposed *room,
                           const proposed *too_warm) {
  proposed forbidden = *too_warm;
  const double aim = excess_of(&forbidden) > -BEV_SOC_AIM ? BEV_SOC_AIM : 0.0;
  double more = excess_of(allowed) - aim;
  double less = excess_of(&forbidden) - aim;
  int was_allowed = -1;
  for (int32_t n = 0; n < BEV_MOST_TARGETS + BEV_MOST_HALVINGS && !is_close(allowed, &forbidden); n++) {
    const double share = n < BEV_MOST_TARGETS ? less / (less - more) : 0.5;
    const double target_c =
        forbidden.target_c + share * (allowed->target_c - forbidden.target_c);
    const bev_status status = propose(of, target_c, room);
    if (status != BEV_OK) {
      return status;
    }
    const double excess = excess_of(room) - aim;
    const bool is_allowed = excess_of(room) >= 0.0;
    if (is_allowed) {
      const proposed before = *allowed;
      less = less * (was_allowed == 1 ? left_of(excess, more) : 1.0);
      more = excess;
      *allowed = *room;
      *room = before;
    } else {
      more = more * (was_allowed == 0 ? left_of(excess, less) : 1.0);
      less = excess;
      forbidden = *room;
    }
    was_allowed = is_allowed ? 1 : 0;
  }
  return BEV_OK;
}

/* The trip without paid heating. */
typedef struct {
  double coldest_c;
  double spare_soc;
} unheated_trip;

/* The warmest run of a proposal that is allowed, if `is_found`; `wanted` is that of the goal's target. */
static bev_status find_warmest(const no_regret_check *of, const unheated_trip *unheated,
                               proposed *wanted, proposed *found, bool *is_found) {
  /* Driving alone meets this target, so only heating that pays for itself is left. */
  const double cold_c =
      bev_maximum(unheated->coldest_c - BEV_BELOW_UNHEATED_K, of->vehicle->lowest_c);
  bev_status status = propose(of, cold_c, found);
  *is_found = false;
  if (status != BEV_OK || found->spare_w < 0.0) {
    return status;
  }
  *is_found = true;
  if (found->spare_soc <= 0.0) {
    *is_found = found->spare_soc >= bev_minimum(unheated->spare_soc, 0.0);
    return BEV_OK;
  }
  found->target_c = bev_maximum(cold_c, arrival_c(of, found));
  proposed forbidden = *wanted;
  const double reached_c = arrival_c(of, wanted);
  if (reached_c < wanted->target_c - BEV_TARGET_TOLERANCE_OF_POWER_K) {
    /*
     * If a target is out of reach, the temperature reached is the only thing known about it. With that temperature
     * as the target, the plan heats less in steps in which the heater gives way to the drive.
     */
    status = propose(of, reached_c, wanted);
    if (status != BEV_OK) {
      return status;
    }
    if (excess_of(wanted) >= 0.0) {
      const proposed before = *found;
      *found = *wanted;
      *wanted = before;
    } else {
      forbidden = *wanted;
    }
  }
  return close_in(of, found, wanted, &forbidden);
}

/* Drive the trip without paid heating; its power deficit is the deficit allowed. */
static bev_status drive_unheated(no_regret_check *of, proposed *run, unheated_trip *unheated) {
  const int32_t instants = of->trip->steps + 1;
  double *const command_w = of->memory;
  double deficit_w = 0.0;
  for (int32_t k = 0; k < of->trip->steps; k++) {
    command_w[k] = 0.0;
  }
  for (int32_t n = 0; n < of->rows; n++) {
    run->states[n * instants] = of->idle_states[n * instants];
  }
  bev_status status = bev_drive_as_planned(of->vehicle, of->trip, command_w, run->states,
                                           run->powers_w, of->watched, &run->plan.stranding);
  if (status == BEV_OK) {
    const bev_trajectory trajectory = trajectory_of(of, run);
    status = bev_deficit_w(of->vehicle, of->trip, &trajectory, &deficit_w);
  }
  if (status == BEV_OK) {
    status = find_spare_soc(of, run);
  }
  of->allowed_w = deficit_w > 0.0 ? deficit_w + BEV_NO_WORSE_W : 0.0;
  unheated->spare_soc = run->spare_soc;
  unheated->coldest_c = run->states[instants];
  for (int32_t k = 1; k < instants; k++) {
    unheated->coldest_c = bev_minimum(unheated->coldest_c, run->states[instants + k]);
  }
  return status;
}

/* The first proposal that is allowed: with the goal's target, else the warmest below it. */
static bev_status serve(no_regret_check *of, const unheated_trip *unheated, proposed *wanted,
                        proposed *found, bev_safe_plan *plan) {
  for (int32_t n = 0; n < 2 && plan->is_unheated != 0; n++) {
    of->serves_climbs = n == 0 ? 1 : 0;
    bev_status status = propose(of, of->goal->target_c, wanted);
    if (status != BEV_OK) {
      return status;
    }
    if (is_allowed(wanted)) {
      plan->is_unheated = 0;
      plan->held_back = BEV_NOT_HELD_BACK;
      *found = *wanted;
    } else {
      bool is_found = false;
      plan->held_back = wanted->spare_soc < 0.0 ? BEV_BY_RESERVE : BEV_BY_POWER;
      status = find_warmest(of, unheated, wanted, found, &is_found);
      if (status != BEV_OK) {
        return status;
      }
      plan->is_unheated = is_found ? 0 : 1;
    }
  }
  return BEV_OK;
}

bev_status bev_plan_no_regret(const bev_vehicle *vehicle, const bev_trip *trip,
                                const bev_safe_goal *goal, const bev_uncertainty_margin *margin,
                                const double *idle_states, double *states, double *powers_w,
                                uint8_t *watched, int32_t *order, double *memory,
                                bev_safe_plan *plan) {
  bev_status status = bev_checked(vehicle, trip, 0);
  if (status != BEV_OK) {
    return status;
  }
  if (goal == NULL || idle_states == NULL || states == NULL || powers_w == NULL || watched == NULL
      || order == NULL || memory == NULL || plan == NULL || trip->steps < 1) {
    return BEV_BAD_ARGUMENT;
  }
  const int32_t steps = trip->steps;
  no_regret_check of;
  of.vehicle = vehicle;
  of.trip = trip;
  of.goal = goal;
  of.margin = margin;
  of.idle_states = idle_states;
  of.rows = bev_is_direct(vehicle) ? 2 : 4;
  of.allowed_w = 0.0;
  of.serves_climbs = 1;
  of.watched = watched;
  of.order = order;
  if (!isfinite(goal->target_c) || !isfinite(goal->margin_k) || !isfinite(goal->reserve_soc)
      || !isfinite(goal->lowest_soc) || !bev_is_uncertainty_margin(margin)
      || !bev_are_numbers(idle_states, of.rows * (steps + 1))) {
    return BEV_BAD_INPUT;
  }
  const bev_merit_plan none = {NAN, NAN, {-1, 1.0}};
  proposed wanted = {states, powers_w, none, goal->target_c, 0.0, 0.0};
  proposed found = wanted;
  found.states = bev_take(&memory, of.rows * (steps + 1));
  found.powers_w = bev_take(&memory, of.rows * steps);
  of.memory = memory;
  unheated_trip unheated = {0.0, 0.0};
  plan->is_unheated = 1;
  plan->held_back = BEV_NOT_HELD_BACK;
  plan->plan = none;
  status = drive_unheated(&of, &wanted, &unheated);
  if (status != BEV_OK || wanted.plan.stranding.step >= 0) {
    return status;
  }
  status = serve(&of, &unheated, &wanted, &found, plan);
  if (status != BEV_OK || plan->is_unheated != 0) {
    return status;
  }
  plan->plan = found.plan;
  for (int32_t n = 0; n < of.rows * (steps + 1) && found.states != states; n++) {
    states[n] = found.states[n];
  }
  for (int32_t n = 0; n < of.rows * steps && found.powers_w != powers_w; n++) {
    powers_w[n] = found.powers_w[n];
  }
  return BEV_OK;
}
