/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The forward runs that keep the battery's limits: bev_preheat.planning.limits and
 * bev_preheat.planning.heated_limits.
 */
#include "heating.h"
#include "limited_step.h"
#include "parts_of_plans.h"

/* Drive on from step `first`; `states` and `powers_w` are `rows` arrays each. */
static bev_status drive_on(const bev_limited_run *run, const bev_heating *heating, int32_t first,
                           int32_t rows, double *const states[4], double *const powers_w[4],
                           int32_t *empty_step) {
  double here[4] = {0.0, 0.0, 0.0, 0.0};
  for (int32_t n = 0; n < rows; n++) {
    here[n] = states[n][first];
    if (!isfinite(here[n])) {
      return BEV_BAD_INPUT;
    }
  }
  for (int32_t k = first; k < run->trip->steps; k++) {
    double driven_w[4];
    const bev_status status = bev_drive_within_limits(
        run, k, here, bev_wanted_w(heating, k, bev_settled_c(run, here)), here, driven_w);
    if (status != BEV_OK && status != BEV_EMPTY) {
      return status;
    }
    for (int32_t n = 0; n < rows; n++) {
      powers_w[n][k] = driven_w[n];
    }
    if (status == BEV_EMPTY) {
      *empty_step = k;
      return BEV_EMPTY;
    }
    for (int32_t n = 0; n < rows; n++) {
      states[n][k + 1] = here[n];
    }
  }
  return BEV_OK;
}

bev_status bev_run_within_limits(const bev_vehicle *vehicle, const bev_trip *trip,
                                 const bev_heating *heating, int32_t first, double *soc,
                                 double *temperature_c, double *heater_w, double *brake_w,
                                 int32_t *empty_step) {
  const bev_status checked = bev_checked(vehicle, trip, first);
  if (checked != BEV_OK) {
    return checked;
  }
  if (!bev_is_heating(heating) || soc == NULL || temperature_c == NULL || heater_w == NULL
      || brake_w == NULL || empty_step == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  const bev_limited_run run = bev_limited_run_of(
      vehicle, trip, heating->may_overcharge, heating->may_overdraw, heating->takes_surplus, 1);
  double *const states[4] = {soc, temperature_c, NULL, NULL};
  double *const powers_w[4] = {heater_w, brake_w, NULL, NULL};
  return drive_on(&run, heating, first, 2, states, powers_w, empty_step);
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
  const bev_limited_run run = bev_limited_run_of(
      vehicle, trip, heating->may_overcharge, heating->may_overdraw, heating->takes_surplus, 0);
  const int32_t steps = trip->steps;
  double *const all_states[4] = {states, &states[steps + 1], &states[2 * (steps + 1)],
                                 &states[3 * (steps + 1)]};
  double *const all_powers_w[4] = {powers_w, &powers_w[steps], &powers_w[2 * steps],
                                   &powers_w[3 * steps]};
  return drive_on(&run, heating, first, 4, all_states, all_powers_w, empty_step);
}

bev_status bev_drive_as_planned(const bev_vehicle *vehicle, const bev_trip *trip,
                                const double *command_w, double below_c, int32_t takes_surplus,
                                double *states, double *powers_w, uint8_t *flags,
                                bev_stranding *stranding) {
  const bev_status checked = bev_checked(vehicle, trip, 0);
  if (checked != BEV_OK) {
    return checked;
  }
  if (command_w == NULL || states == NULL || powers_w == NULL || flags == NULL
      || stranding == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  const int32_t steps = trip->steps;
  const bev_heating heating = {takes_surplus, below_c, command_w, flags, &flags[steps]};
  for (int32_t k = 0; k < steps; k++) {
    flags[k] = trip->propulsion_power_w[k] < 0.0 ? 1u : 0u;
    flags[steps + k] = 1u;
  }
  int32_t empty_step = -1;
  bev_status status = bev_is_direct(vehicle)
      ? bev_run_within_limits(vehicle, trip, &heating, 0, states, &states[steps + 1], powers_w,
                              &powers_w[steps], &empty_step)
      : bev_run_heated_within_limits(vehicle, trip, &heating, 0, states, powers_w, &empty_step);
  stranding->step = -1;
  stranding->driven_share = 1.0;
  if (status == BEV_EMPTY) {
    stranding->step = empty_step;
    status = bev_stand(vehicle, trip, states, powers_w, stranding);
  }
  return status;
}
