/* SPDX-License-Identifier: Apache-2.0 */
/* Start of the last heating interval of a plan: bev_preheat.planning.uncertainty_margin. */
#include "early_start.h"

#include "limited_step.h"

/* The first step of the heating that lasts until arrival; `steps` without. */
static int32_t first_of_last_interval(const bev_planned_heating *planned) {
  const bev_trip *trip = planned->trip;
  int32_t first = trip->steps;
  for (int32_t k = trip->steps - 1; k >= 0; k--) {
    /* Steps in which heating is impossible are no pause. */
    if (!(trip->heater_limit_w[k] > 0.0 && trip->time_s[k] < planned->latest_end_s)) {
      continue;
    }
    if (!bev_is_heated(trip, planned->command_w, k)) {
      break;
    }
    first = k;
  }
  return first;
}

/* The first instant of heating [s] from a heated step on: heated in part, it is off first, then at full power. */
static double switched_on_s(const bev_planned_heating *planned, int32_t k) {
  const bev_trip *trip = planned->trip;
  const double share_on = bev_minimum(planned->command_w[k] / trip->heater_limit_w[k], 1.0);
  return trip->time_s[k + 1] - share_on * trip->duration_s[k];
}

/* The planned heat from a step on, as time at full power [s]. */
static double heated_s(const bev_planned_heating *planned, int32_t first) {
  const bev_trip *trip = planned->trip;
  double seconds = 0.0;
  for (int32_t k = first; k < trip->steps; k++) {
    if (trip->heater_limit_w[k] > 0.0) {
      seconds = seconds + planned->command_w[k] / trip->heater_limit_w[k] * trip->duration_s[k];
    }
  }
  return seconds;
}

/* Maximum heat from the heater in a step: power [W], and energy over the whole step [J]. */
static double heat_w(const bev_vehicle *vehicle, const bev_trip *trip, int32_t k) {
  return vehicle->heater_efficiency * trip->heater_limit_w[k];
}

static double heat_j(const bev_vehicle *vehicle, const bev_trip *trip, int32_t k) {
  return heat_w(vehicle, trip, k) * trip->duration_s[k];
}

/* The most heat that the heater can give until an instant [J]. */
static double given_until_j(const bev_vehicle *vehicle, const bev_trip *trip, double until_s) {
  const int32_t before = bev_points_up_to(trip->time_s, trip->steps + 1, until_s) - 1;
  double given_j = 0.0;
  for (int32_t k = 0; k < before; k++) {
    given_j = given_j + heat_j(vehicle, trip, k);
  }
  if (before < 0 || before >= trip->steps) {
    return given_j;
  }
  const double slope_w = (given_j + heat_j(vehicle, trip, before) - given_j)
      / (trip->time_s[before + 1] - trip->time_s[before]);
  return slope_w * (until_s - trip->time_s[before]) + given_j;
}

/* The instant [s] from which the heater gives `lead_k` by `until_s`; NaN if no instant does. */
static double earlier_s(const bev_vehicle *vehicle, const bev_trip *trip, double until_s,
                        double lead_k) {
  if (lead_k <= 0.0) {
    return until_s;
  }
  const double wanted_j = bev_maximum(
      0.0, given_until_j(vehicle, trip, until_s) - lead_k * vehicle->heat_capacity_j_per_k);
  double given_j = 0.0;
  for (int32_t k = 0; k < trip->steps; k++) {
    const double following_j = given_j + heat_j(vehicle, trip, k);
    if (following_j > wanted_j) {
      /* This step gives some heat, so its power is not 0. */
      return bev_minimum(trip->time_s[k] + (wanted_j - given_j) / heat_w(vehicle, trip, k),
                         until_s);
    }
    given_j = following_j;
  }
  return NAN;
}

double bev_warmed_k_per_s(const bev_vehicle *vehicle, const bev_trip *trip, double end_s) {
  const int32_t step = bev_step_at(trip, end_s);
  const double capacity = vehicle->heat_capacity_j_per_k;
  const double left =
      exp(-trip->leakage_w_per_k[step] / capacity * (trip->time_s[trip->steps] - end_s));
  return heat_w(vehicle, trip, step) / capacity * left;
}

void bev_heat_between(const bev_trip *trip, int32_t from, double start_s, double end_s,
                      double *heater_w) {
  for (int32_t k = from; k < trip->steps; k++) {
    const double heated_s =
        bev_minimum(trip->time_s[k + 1], end_s) - bev_maximum(trip->time_s[k], start_s);
    heater_w[k] = bev_minimum(bev_maximum(heated_s / trip->duration_s[k], 0.0), 1.0)
        * trip->heater_limit_w[k];
  }
}

bev_status bev_find_early_start(const bev_planned_heating *planned, const bev_uncertainty_margin *margin,
                                bev_early_start *start) {
  const bev_vehicle *vehicle = planned->vehicle;
  const bev_trip *trip = planned->trip;
  const double end_s = planned->latest_end_s;
  start->change = BEV_STAYS;
  start->start_s = end_s;
  start->guess_s = end_s;
  start->first = first_of_last_interval(planned);
  if (start->first == trip->steps) {
    return BEV_OK;
  }
  const double start_s = switched_on_s(planned, start->first);
  /* If heating starts less than the lag before arrival, most of its heat would still be under way on arrival. */
  const double left_s = trip->time_s[trip->steps] - start_s;
  if (margin->is_heating == 0
      && (heated_s(planned, start->first) < margin->least_heating_s || left_s < bev_heat_lag_s(vehicle))) {
    start->change = BEV_LEFT_OUT;
    return BEV_OK;
  }
  double early_s = earlier_s(vehicle, trip, start_s, margin->lead_k);
  if (margin->is_heating != 0 && early_s <= margin->least_pause_s) {
    early_s = 0.0;
  }
  if (isnan(early_s) != 0) {
    return BEV_NOT_FINITE;
  }
  if (early_s >= start_s) {
    return BEV_OK;
  }
  start->change = BEV_BEGINS_EARLY;
  start->start_s = early_s;
  /* Heat given earlier is not needed later. */
  start->guess_s = end_s - (start_s - early_s);
  return BEV_OK;
}
