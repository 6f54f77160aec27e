/* SPDX-License-Identifier: Apache-2.0 */
/* Move heat to steps in which it costs less, within the limits: bev_preheat.planning.exchange. */
#include <stdbool.h>

#include "bev_preheat_core_generated/constants.h"
#include "checks.h"
#include "trajectory.h"
#include "limited_prices.h"
#include "limited_step.h"
#include "linear_program.h"
#include "prices.h"

/* The run so far, the trial run, and the heat exchanged. */
typedef struct {
  bev_needs needs;
  bev_limited_trajectory run;
  bev_limited_trajectory there;
  double *there_states;
  double *there_powers_w;
  double *command_w;
  uint8_t *watched;
  bev_changes changes;
  bev_linear_program program;
  double *gains;
  double *uses;
  double spare[BEV_MOST_NEEDS];
  /* Surplus of the last trial run over the prediction, for each need. */
  double beyond[BEV_MOST_NEEDS];
  int32_t mends;
  /* Maximum heat moved in one exchange [J]. */
  double trusted_j;
} exchange;

/* Predicted and actual result of an exchange. */
typedef struct {
  double saving;
  double moved_j;
  double saved;
  bool is_met;
} exchanged;

static void begin_anew(exchange *of) {
  for (int32_t n = 0; n < of->changes.needs; n++) {
    of->beyond[n] = 0.0;
  }
  of->mends = 0;
}

/* Whether the prices are corrected by the result of an earlier trial run. */
static bool is_corrected(const exchange *of) {
  bool is_one = false;
  for (int32_t n = 0; n < of->changes.needs; n++) {
    is_one = is_one || of->beyond[n] != 0.0;
  }
  return is_one;
}

/* The greatest magnitude of values; 1 if all are 0. */
static double greatest_of(const double *values, int32_t count) {
  double greatest = 0.0;
  for (int32_t n = 0; n < count; n++) {
    greatest = bev_maximum(greatest, fabs(values[n]));
  }
  return greatest > 0.0 ? greatest : 1.0;
}

/* Total effect of the changes found, at `per_j` for each joule. */
static double changed_by(const exchange *of, const double *per_j) {
  double sum = 0.0;
  for (int32_t n = 0; n < of->changes.count; n++) {
    sum += per_j[n] * of->program.found[n];
  }
  return sum;
}

static const double *need_per_j(const exchange *of, int32_t need) {
  return &of->changes.needs_per_j[need * of->changes.count];
}

/* How much of each change saves the most. */
static void find_best(exchange *of, exchanged *best) {
  const int32_t count = of->changes.count;
  const int32_t needs = of->changes.needs;
  bev_linear_program *program = &of->program;
  const double most_saved = greatest_of(of->changes.charge_per_j, count);
  for (int32_t n = 0; n < count; n++) {
    of->gains[n] = of->changes.charge_per_j[n] / most_saved;
    of->uses[needs * count + n] = 1.0;
  }
  for (int32_t need = 0; need < needs; need++) {
    const double *per_j = need_per_j(of, need);
    const double most = greatest_of(per_j, count);
    for (int32_t n = 0; n < count; n++) {
      of->uses[need * count + n] = -per_j[n] / most;
    }
    program->left[need] = (of->spare[need] + of->beyond[need]) / most;
  }
  program->left[needs] = of->trusted_j;
  program->count = count;
  program->rows = needs + 1;
  program->most = of->changes.most_j;
  bev_maximise(program);
  best->saving = changed_by(of, of->changes.charge_per_j);
  best->moved_j = 0.0;
  for (int32_t n = 0; n < count; n++) {
    best->moved_j += program->found[n];
  }
}

/* The commands after an exchange, without surplus. */
static void find_commands(const exchange *of) {
  const bev_trip *trip = of->needs.trip;
  for (int32_t k = 0; k < trip->steps; k++) {
    of->command_w[k] = of->run.heater_w[k];
  }
  for (int32_t n = 0; n < of->changes.count; n++) {
    const int32_t k = (int32_t)of->changes.step[n];
    const double sign = n < of->changes.more ? 1.0 : -1.0;
    of->command_w[k] += sign * of->program.found[n] / trip->duration_s[k];
  }
  for (int32_t k = 0; k < trip->steps; k++) {
    const double free_w = bev_free_heat_w(trip, &of->run, k);
    const bool is_paid = of->command_w[k] > (free_w > 0.0 ? free_w + BEV_SURPLUS_TOLERANCE_W : 0.0);
    of->command_w[k] =
        is_paid ? bev_minimum(of->command_w[k], trip->heater_limit_w[k]) : 0.0;
  }
}

/* The first step whose heating changes. */
static int32_t first_changed(const exchange *of) {
  int32_t first = of->needs.trip->steps;
  for (int32_t n = 0; n < of->changes.count; n++) {
    const int32_t k = (int32_t)of->changes.step[n];
    if (of->program.found[n] > 0.0 && k < first) {
      first = k;
    }
  }
  return first;
}

/* Copy the states of a run until a step, and its powers before it. */
static void copy_until(const bev_limited_trajectory *from, const bev_limited_trajectory *to,
                       int32_t until) {
  for (int32_t k = 0; k <= until; k++) {
    to->soc[k] = from->soc[k];
    to->temperature_c[k] = from->temperature_c[k];
  }
  for (int32_t k = 0; k < until; k++) {
    to->heater_w[k] = from->heater_w[k];
    to->brake_w[k] = from->brake_w[k];
  }
}

/* Drive the run after an exchange. */
static bev_status try_exchange(const exchange *of, exchanged *best) {
  const bev_vehicle *vehicle = of->needs.vehicle;
  const bev_trip *trip = of->needs.trip;
  bev_stranding stranding = {-1, 1.0};
  find_commands(of);
  /* The run is unchanged before the first step whose heating changes. */
  const int32_t first = first_changed(of);
  copy_until(&of->run, &of->there, first);
  bev_status status =
      bev_drive_on_as_planned(vehicle, trip, of->command_w, first, of->there_states,
                              of->there_powers_w, of->watched, &stranding);
  if (status == BEV_OK) {
    status = bev_look_at_limits(vehicle, trip, &of->there);
  }
  if (status == BEV_OK) {
    best->saved = of->there.soc[trip->steps] - of->run.soc[trip->steps];
    best->is_met = stranding.step < 0 && bev_are_met(&of->needs, &of->there);
  }
  return status;
}

/* Accept the trial run. */
static void keep_tried(exchange *of) {
  const int32_t steps = of->needs.trip->steps;
  copy_until(&of->there, &of->run, steps);
  for (int32_t k = 0; k < steps; k++) {
    of->run.least_w[k] = of->there.least_w[k];
    of->run.most_w[k] = of->there.most_w[k];
  }
}

/* Learn from a tried exchange; returns whether its run is accepted. */
static bool learn(exchange *of, const exchanged *best, double least_saving) {
  const bool is_kept = best->is_met && best->saved >= least_saving;
  if (is_kept) {
    if (best->saved > BEV_GOOD_SHARE * best->saving) {
      of->trusted_j = 2.0 * of->trusted_j;
    } else if (best->saved < BEV_POOR_SHARE * best->saving) {
      of->trusted_j = BEV_MOST_LEFT * best->moved_j;
    } else {
      /* As much as before. */
    }
    keep_tried(of);
  } else {
    double now[BEV_MOST_NEEDS];
    double share = 1.0;
    bev_spare_of(&of->needs, &of->changes, &of->there, now);
    if (!best->is_met && best->saved > BEV_MENDED_SHARE * best->saving && of->mends < BEV_MOST_MENDS) {
      of->mends++;
    } else {
      /* The prediction error grows with the square of the heat moved. */
      share = best->saved < best->saving
          ? best->saving / (2.0 * (best->saving - best->saved))
          : BEV_MOST_LEFT;
      share = bev_minimum(bev_maximum(share, BEV_LEAST_LEFT), BEV_MOST_LEFT);
      of->trusted_j = share * best->moved_j;
      of->mends = 0;
    }
    for (int32_t n = 0; n < of->changes.needs; n++) {
      of->beyond[n] =
          share * share * (now[n] - (of->spare[n] + changed_by(of, need_per_j(of, n))));
    }
  }
  return is_kept;
}

/* Exchange heat until an exchange saves no more charge. */
static bev_status exchange_on(exchange *of, double least_saving, int32_t *exchanges) {
  bool is_new = true;
  bool goes_on = true;
  bev_status status = BEV_OK;
  for (int32_t trial = 0; trial < BEV_MOST_EXCHANGE_TRIALS && goes_on && status == BEV_OK; trial++) {
    if (is_new) {
      status = bev_find_changes(&of->needs, &of->run, &of->changes);
      bev_spare_of(&of->needs, &of->changes, &of->run, of->spare);
      begin_anew(of);
      is_new = false;
      goes_on = of->changes.count > 0;
    }
    if (goes_on && status == BEV_OK) {
      exchanged best = {0.0, 0.0, 0.0, false};
      find_best(of, &best);
      if (best.saving >= least_saving) {
        status = try_exchange(of, &best);
        is_new = status == BEV_OK && learn(of, &best, least_saving);
        *exchanges += is_new ? 1 : 0;
      } else {
        goes_on = is_corrected(of);
        of->trusted_j = BEV_MOST_LEFT * best.moved_j;
        begin_anew(of);
      }
    }
  }
  return status;
}

static bev_limited_trajectory trajectory_of(int32_t steps, double *states, double *powers_w,
                                    double *limits_w) {
  const bev_limited_trajectory trajectory = {states,   &states[steps + 1], powers_w, &powers_w[steps],
                                     limits_w, &limits_w[steps]};
  return trajectory;
}

/* Heat of a run that is more than surplus [J]. */
static double paid_j(const bev_trip *trip, const bev_limited_trajectory *run) {
  double paid_j = 0.0;
  for (int32_t k = 0; k < trip->steps; k++) {
    paid_j += bev_maximum(run->heater_w[k] - bev_free_heat_w(trip, run, k), 0.0)
        * trip->duration_s[k];
  }
  return paid_j;
}

bev_status bev_exchange_heat(const bev_vehicle *vehicle, const bev_trip *trip,
                             const bev_settling *goal, double *states, double *powers_w,
                             uint8_t *watched, double *memory, int32_t *exchanges) {
  bev_status status = bev_checked(vehicle, trip, 0);
  if (status != BEV_OK) {
    return status;
  }
  if (trip->steps < 1 || goal == NULL || states == NULL || powers_w == NULL || watched == NULL
      || memory == NULL || exchanges == NULL || !bev_is_direct(vehicle)) {
    return BEV_BAD_ARGUMENT;
  }
  const int32_t steps = trip->steps;
  if (!isfinite(goal->target_c) || !isfinite(goal->lowest_soc)
      || !bev_are_numbers(states, 2 * (steps + 1))
      || !bev_are_numbers(powers_w, 2 * steps)) {
    return BEV_BAD_INPUT;
  }
  exchange of;
  of.needs.vehicle = vehicle;
  of.needs.trip = trip;
  of.needs.power_w = bev_take(&memory, steps);
  of.run = trajectory_of(steps, states, powers_w, bev_take(&memory, 2 * steps));
  of.there_states = bev_take(&memory, 2 * (steps + 1));
  of.there_powers_w = bev_take(&memory, 2 * steps);
  of.there =
      trajectory_of(steps, of.there_states, of.there_powers_w, bev_take(&memory, 2 * steps));
  of.command_w = bev_take(&memory, steps);
  of.watched = watched;
  of.changes.slopes = bev_take(&memory, BEV_SLOPES * steps);
  of.changes.per_w = bev_take(&memory, steps);
  of.changes.step = bev_take(&memory, 2 * steps);
  of.changes.most_j = bev_take(&memory, 2 * steps);
  of.changes.charge_per_j = bev_take(&memory, 2 * steps);
  of.changes.needs_per_j = bev_take(&memory, BEV_MOST_NEEDS * 2 * steps);
  of.gains = bev_take(&memory, 2 * steps);
  of.uses = bev_take(&memory, BEV_MOST_ROWS * 2 * steps);
  of.program.gains = of.gains;
  of.program.uses = of.uses;
  of.program.place = bev_take(&memory, 2 * steps);
  of.program.found = bev_take(&memory, 2 * steps);
  *exchanges = 0;
  status = bev_look_at_limits(vehicle, trip, &of.run);
  if (status == BEV_OK) {
    status = bev_find_needs(&of.run, goal, &of.needs);
  }
  if (status == BEV_OK) {
    of.trusted_j = BEV_FIRST_SHARE * paid_j(trip, &of.run);
    const double whole_wh =
        bev_whole_charge_wh(vehicle, of.run.soc[steps], of.run.temperature_c[steps]);
    status = exchange_on(&of, BEV_LEAST_SAVING_WH / whole_wh, exchanges);
  }
  return status;
}
