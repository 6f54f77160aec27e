/* SPDX-License-Identifier: Apache-2.0 */
/* Effect of a joule of heat along a run within limits: bev_preheat.planning.limited_prices. */
#include "limited_prices.h"

#include "bev_preheat_core_generated/constants.h"
#include "slopes.h"

bev_status bev_look_at_limits(const bev_vehicle *vehicle, const bev_trip *trip,
                              const bev_limited_trajectory *run) {
  return bev_limits_of_steps(vehicle, trip->steps, run->soc, run->temperature_c,
                             trip->power_variance_w2, run->least_w, run->most_w);
}

bev_status bev_find_needs(const bev_limited_trajectory *run, const bev_settling *goal,
                          bev_needs *needs) {
  const bev_trip *trip = needs->trip;
  needs->arrival_c = bev_minimum(goal->target_c, run->temperature_c[trip->steps]);
  for (int32_t k = 0; k < trip->steps; k++) {
    needs->power_w[k] = bev_minimum(trip->idle_power_w[k], run->most_w[k]);
  }
  needs->lowest_soc = goal->lowest_soc + BEV_LOWEST_SOC_MARGIN;
  for (int32_t k = 0; k <= trip->steps; k++) {
    needs->lowest_soc = bev_minimum(needs->lowest_soc, run->soc[k]);
  }
  return bev_find_climbs(needs->vehicle, trip, run->soc, run->temperature_c, needs->climbs,
                         &needs->climb_count);
}

bool bev_are_met(const bev_needs *needs, const bev_limited_trajectory *run) {
  const bev_trip *trip = needs->trip;
  bool are_met = run->temperature_c[trip->steps] >= needs->arrival_c - BEV_ARRIVAL_TOLERANCE_K;
  for (int32_t k = 0; k <= trip->steps && are_met; k++) {
    are_met = run->soc[k] >= needs->lowest_soc;
  }
  for (int32_t k = 0; k < trip->steps && are_met; k++) {
    are_met =
        run->most_w[k] - needs->power_w[k] >= -BEV_POWER_ROUNDING * fabs(trip->idle_power_w[k]);
  }
  return are_met;
}

void bev_spare_of(const bev_needs *needs, const bev_changes *changes, const bev_limited_trajectory *run,
                  double spare[BEV_MOST_NEEDS]) {
  const bev_trip *trip = needs->trip;
  spare[0] = run->temperature_c[trip->steps] - needs->arrival_c - 0.5 * BEV_ARRIVAL_TOLERANCE_K;
  for (int32_t n = 0; n < needs->climb_count; n++) {
    const int32_t k = changes->worst[n];
    spare[n + 1] = (run->most_w[k] - needs->power_w[k])
        - 0.5 * BEV_POWER_SURPLUS * trip->idle_power_w[k];
  }
  if (changes->lowest >= 0) {
    spare[needs->climb_count + 1] =
        run->soc[changes->lowest] - needs->lowest_soc - BEV_LOWEST_SOC_AIM;
  }
}

double bev_free_heat_w(const bev_trip *trip, const bev_limited_trajectory *run, int32_t k) {
  const double surplus_w = run->least_w[k] - trip->idle_power_w[k];
  const double free_w = trip->propulsion_power_w[k] < 0.0
      ? bev_minimum(bev_maximum(surplus_w, 0.0), trip->heater_limit_w[k])
      : 0.0;
  /* If the brake takes a part, the heater takes no more: the battery is warm enough. */
  return run->brake_w[k] > 0.0 ? bev_minimum(free_w, run->heater_w[k]) : free_w;
}

/* The slopes of a step within limits, also for a watt of surplus, and the slopes of the surplus itself [W]. */
typedef struct {
  bev_slopes of_model;
  bev_charge_warmth by_surplus;
  bev_charge_warmth surplus_w;
} limited_slopes;

/* The least terminal power [W] that the battery may take at a state, in a step of that power variance. */
static double least_at(const bev_middle *of, double soc, double temperature_c) {
  double limits_w[2];
  bev_terminal_limits(of->vehicle, BEV_AS_ARRAYS, soc, temperature_c, of->idle.variance_w2,
                      limits_w);
  return limits_w[0];
}

/* The slopes of step k of a run; the heater takes a given surplus anyway [W]. */
static limited_slopes slopes_of(const bev_middle *of, const bev_limited_trajectory *run, int32_t k,
                                double free_w) {
  static const bev_charge_warmth NOTHING = {0.0, 0.0};
  limited_slopes slopes;
  slopes.of_model = bev_slopes_of_model(of);
  slopes.by_surplus = NOTHING;
  slopes.surplus_w = NOTHING;
  if (of->brake_w > 0.0) {
    slopes.by_surplus = bev_slope_of(
        bev_rates_at(of, of->heater_w, of->brake_w, 0.0, 0.0),
        bev_rates_at(of, of->heater_w, of->brake_w + BEV_BRAKE_DIFFERENCE_W, 0.0, 0.0),
        BEV_BRAKE_DIFFERENCE_W, of->idle.duration_s);
  } else if (free_w > 0.0 && free_w < of->limit_w
             && of->heater_w <= free_w + BEV_SURPLUS_TOLERANCE_W) {
    slopes.by_surplus = slopes.of_model.by_power;
  } else {
    return slopes;
  }
  /* The surplus arises at the end of the step at which the battery takes less. */
  const double start_w = least_at(of, run->soc[k], run->temperature_c[k]);
  const double end_w = least_at(of, run->soc[k + 1], run->temperature_c[k + 1]);
  const int32_t instant = start_w >= end_w ? k : k + 1;
  const double here_w = start_w >= end_w ? start_w : end_w;
  const double soc = run->soc[instant];
  const double temperature_c = run->temperature_c[instant];
  slopes.surplus_w.charge =
      (least_at(of, soc + BEV_SOC_DIFFERENCE, temperature_c) - here_w) / BEV_SOC_DIFFERENCE;
  slopes.surplus_w.warmth =
      (least_at(of, soc, temperature_c + BEV_TEMPERATURE_DIFFERENCE_K) - here_w)
      / BEV_TEMPERATURE_DIFFERENCE_K;
  return slopes;
}

static limited_slopes slopes_at(const bev_changes *changes, int32_t k) {
  const double *at = &changes->slopes[BEV_SLOPES * k];
  const limited_slopes slopes = {
      {{at[0], at[1]}, {at[2], at[3]}, {at[4], at[5]}}, {at[6], at[7]}, {at[8], at[9]}};
  return slopes;
}

static bev_status find_slopes(const bev_needs *needs, const bev_limited_trajectory *run,
                              const bev_changes *changes) {
  const bev_trip *trip = needs->trip;
  for (int32_t k = 0; k < trip->steps; k++) {
    const bev_middle middle = bev_middle_of(needs->vehicle, trip, run->soc, run->temperature_c,
                                            run->heater_w[k], run->brake_w[k], k);
    if (!bev_is_middle(&middle)) {
      return BEV_BAD_INPUT;
    }
    const limited_slopes slopes = slopes_of(&middle, run, k, bev_free_heat_w(trip, run, k));
    double *at = &changes->slopes[BEV_SLOPES * k];
    at[0] = slopes.of_model.by_charge.charge;
    at[1] = slopes.of_model.by_charge.warmth;
    at[2] = slopes.of_model.by_warmth.charge;
    at[3] = slopes.of_model.by_warmth.warmth;
    at[4] = slopes.of_model.by_power.charge;
    at[5] = slopes.of_model.by_power.warmth;
    at[6] = slopes.by_surplus.charge;
    at[7] = slopes.by_surplus.warmth;
    at[8] = slopes.surplus_w.charge;
    at[9] = slopes.surplus_w.warmth;
  }
  return BEV_OK;
}

/* Effect of a joule of each change until an instant; `worth` is the value of charge and warmth there. */
static bev_status find_effects(const bev_trip *trip, const bev_changes *changes, int32_t instant,
                               bev_charge_warmth worth, double *per_j) {
  for (int32_t k = instant; k < trip->steps; k++) {
    changes->per_w[k] = 0.0;
  }
  for (int32_t k = instant - 1; k >= 0; k--) {
    const limited_slopes slopes = slopes_at(changes, k);
    const bev_charge_warmth earlier = bev_worth_before(worth, &slopes.of_model);
    const double surplus = bev_effect(worth, earlier, slopes.by_surplus);
    changes->per_w[k] = bev_effect(worth, earlier, slopes.of_model.by_power);
    worth.charge = earlier.charge + surplus * slopes.surplus_w.charge;
    worth.warmth = earlier.warmth + surplus * slopes.surplus_w.warmth;
  }
  bev_status status = BEV_OK;
  for (int32_t n = 0; n < changes->count; n++) {
    const int32_t k = (int32_t)changes->step[n];
    const double sign = n < changes->more ? 1.0 : -1.0;
    per_j[n] = sign * changes->per_w[k] / trip->duration_s[k];
    if (!isfinite(per_j[n])) {
      status = BEV_NOT_FINITE;
    }
  }
  return status;
}

/* The most terminal power [W] that the battery can give at an instant of a run, in step k. */
static double most_at(const bev_needs *needs, const bev_limited_trajectory *run, int32_t k,
                      int32_t instant, double fuller, double warmer_k) {
  double limits_w[2];
  bev_terminal_limits(needs->vehicle, BEV_AS_ARRAYS, run->soc[instant] + fuller,
                      run->temperature_c[instant] + warmer_k, needs->trip->power_variance_w2[k],
                      limits_w);
  return limits_w[1];
}

/* Effect of a joule of each change on the available power at the worse end of step k. */
static bev_status find_effects_on_climb(const bev_needs *needs, const bev_limited_trajectory *run,
                                        const bev_changes *changes, int32_t k, double *per_j) {
  const double start_w = most_at(needs, run, k, k, 0.0, 0.0);
  const double end_w = most_at(needs, run, k, k + 1, 0.0, 0.0);
  const int32_t instant = start_w <= end_w ? k : k + 1;
  const double here_w = start_w <= end_w ? start_w : end_w;
  /* Downward difference: a full battery cannot be fuller. */
  const bev_charge_warmth worth = {
      (here_w - most_at(needs, run, k, instant, -BEV_SOC_DIFFERENCE, 0.0)) / BEV_SOC_DIFFERENCE,
      (most_at(needs, run, k, instant, 0.0, BEV_TEMPERATURE_DIFFERENCE_K) - here_w)
          / BEV_TEMPERATURE_DIFFERENCE_K};
  return find_effects(needs->trip, changes, instant, worth, per_j);
}

static void add_change(const bev_trip *trip, bev_changes *changes, int32_t k, double room_w) {
  if (room_w > BEV_LEAST_ROOM_W) {
    changes->step[changes->count] = (double)k;
    changes->most_j[changes->count] = room_w * trip->duration_s[k];
    changes->count++;
  }
}

/* Which steps can be heated more, and which less. */
static void find_room(const bev_needs *needs, const bev_limited_trajectory *run,
                      bev_changes *changes) {
  const bev_trip *trip = needs->trip;
  const double highest_c = needs->vehicle->highest_c - BEV_NEAR_HIGHEST_K;
  changes->count = 0;
  for (int32_t k = 0; k < trip->steps; k++) {
    const double most_w =
        bev_minimum(trip->heater_limit_w[k], run->most_w[k] - trip->idle_power_w[k]);
    if (!(run->temperature_c[k + 1] >= highest_c || run->brake_w[k] > 0.0)) {
      add_change(trip, changes, k, most_w - run->heater_w[k]);
    }
  }
  changes->more = changes->count;
  for (int32_t k = 0; k < trip->steps; k++) {
    add_change(trip, changes, k, run->heater_w[k] - bev_free_heat_w(trip, run, k));
  }
}

/* The step of each climb in which the least power can be spared. */
static void find_worst(const bev_needs *needs, const bev_limited_trajectory *run,
                       bev_changes *changes) {
  for (int32_t n = 0; n < needs->climb_count; n++) {
    double least_w = INFINITY;
    changes->worst[n] = needs->climbs[n].first;
    for (int32_t k = needs->climbs[n].first; k < needs->climbs[n].last; k++) {
      const double spare_w = run->most_w[k] - needs->power_w[k];
      if (spare_w < least_w) {
        least_w = spare_w;
        changes->worst[n] = k;
      }
    }
  }
}

/* The instant of the lowest charge before a run charges again; -1 if that charge is far above the need. */
static int32_t lowest_instant(const bev_needs *needs, const bev_limited_trajectory *run) {
  int32_t lowest = -1;
  double least_soc = needs->lowest_soc + BEV_NEAR_LOWEST_SOC;
  for (int32_t k = 1; k < needs->trip->steps; k++) {
    if (run->soc[k] < run->soc[k + 1] && run->soc[k] < least_soc) {
      least_soc = run->soc[k];
      lowest = k;
    }
  }
  return lowest;
}

bev_status bev_find_changes(const bev_needs *needs, const bev_limited_trajectory *run,
                            bev_changes *changes) {
  static const bev_charge_warmth CHARGE = {1.0, 0.0};
  static const bev_charge_warmth WARMTH = {0.0, 1.0};
  const bev_trip *trip = needs->trip;
  find_room(needs, run, changes);
  find_worst(needs, run, changes);
  changes->lowest = lowest_instant(needs, run);
  changes->needs = 1 + needs->climb_count + (changes->lowest >= 0 ? 1 : 0);
  bev_status status = find_slopes(needs, run, changes);
  if (status == BEV_OK) {
    status = find_effects(trip, changes, trip->steps, CHARGE, changes->charge_per_j);
  }
  if (status == BEV_OK) {
    status = find_effects(trip, changes, trip->steps, WARMTH, changes->needs_per_j);
  }
  for (int32_t n = 0; n < needs->climb_count && status == BEV_OK; n++) {
    status = find_effects_on_climb(needs, run, changes, changes->worst[n],
                                   &changes->needs_per_j[(n + 1) * changes->count]);
  }
  if (status == BEV_OK && changes->lowest >= 0) {
    status = find_effects(trip, changes, changes->lowest, CHARGE,
                          &changes->needs_per_j[(needs->climb_count + 1) * changes->count]);
  }
  return status;
}
