/* SPDX-License-Identifier: Apache-2.0 */
/* The paper's heuristic, and its whole plan if no limit is active: bev_preheat.planning.paper. */
#include "bev_preheat_core/core.h"
#include "bev_preheat_core_generated/constants.h"
#include "checks.h"
#include "parts_of_plans.h"
#include "steps_of_model.h"

/*
 * The run by Euler's method from soc[0] and temperature_c[0] on, heated from the instant [s] at which the
 * unheated run meets the backward run from the target; NaN if the target is met without heating. Writes the run,
 * the heater power in each step [W], and the instant.
 */
static bev_status run_paper(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                            double *soc, double *temperature_c, double *heater_w,
                            double *instant_s) {
  const int32_t steps = trip->steps;
  *instant_s = NAN;
  for (int32_t k = 0; k < steps; k++) {
    heater_w[k] = 0.0;
  }
  bev_status status = bev_run(vehicle, BEV_EULER, trip, 0, NULL, NULL, soc, temperature_c);
  if (status < BEV_OK || temperature_c[steps] >= target_c) {
    return status;
  }
  status = bev_find_crossing(vehicle, BEV_EULER, trip, target_c, soc[steps], BEV_LOST_ABOVE_TARGET_K,
                             temperature_c, instant_s);
  if (status == BEV_NO_CROSSING) {
    *instant_s = 0.0;
  } else if (status != BEV_OK) {
    return status;
  }
  for (int32_t k = 0; k < steps; k++) {
    const double share_on = (trip->time_s[k + 1] - *instant_s) / trip->duration_s[k];
    heater_w[k] = bev_minimum(bev_maximum(share_on, 0.0), 1.0) * trip->heater_limit_w[k];
  }
  return bev_run(vehicle, BEV_EULER, trip, bev_step_at(trip, *instant_s), heater_w, NULL, soc,
                 temperature_c);
}

/*
 * BEV_LIMITED if a run has a power deficit, or leaves the range of charge or temperature that the model describes:
 * bev_preheat.planning.outcome does not accept such a run unchanged. Writes the limits along the run [W].
 */
static bev_status is_driven_as_planned(const bev_vehicle *vehicle, const bev_trip *trip,
                                       const double *soc, const double *temperature_c,
                                       const double *heater_w, double *least_w, double *most_w) {
  const bev_status status = bev_limits_of_steps(vehicle, trip->steps, soc, temperature_c,
                                             trip->power_variance_w2, least_w, most_w);
  for (int32_t k = 0; k <= trip->steps && status == BEV_OK; k++) {
    if (!(soc[k] > 0.0 && soc[k] <= 1.0 && temperature_c[k] <= vehicle->hottest_c)) {
      return BEV_LIMITED;
    }
    if (k < trip->steps && !(trip->idle_power_w[k] + heater_w[k] <= most_w[k])) {
      return BEV_LIMITED;
    }
  }
  return status;
}

bev_status bev_plan_paper(const bev_vehicle *vehicle, const bev_trip *trip, double start_soc,
                          double start_c, double target_c, double *memory, double *soc,
                          double *temperature_c, double *heater_w, bev_switch_plan *plan) {
  bev_status status = bev_checked(vehicle, trip, 0);
  if (status != BEV_OK) {
    return status;
  }
  if (trip->steps < 1 || memory == NULL || soc == NULL || temperature_c == NULL
      || heater_w == NULL || plan == NULL || vehicle->heater_lag_s > 0.0
      || vehicle->coolant_heat_capacity_j_per_k > 0.0) {
    return BEV_BAD_ARGUMENT;
  }
  if (!isfinite(target_c) || !bev_is_time(trip)) {
    return BEV_BAD_INPUT;
  }
  const int32_t steps = trip->steps;
  double *const idle_soc = memory;
  double *const idle_c = &memory[steps + 1];
  double *const least_w = &memory[2 * (steps + 1)];
  double *const most_w = &memory[3 * (steps + 1)];
  idle_soc[0] = start_soc;
  idle_c[0] = start_c;
  status = bev_run(vehicle, BEV_RUNGE_KUTTA_4, trip, 0, NULL, NULL, idle_soc, idle_c);
  if (status < BEV_OK) {
    return status;
  }
  for (int32_t k = 0; k < steps; k++) {
    heater_w[k] = 0.0;
  }
  bev_seen_run run = {vehicle, trip, idle_soc, idle_c, heater_w, least_w, most_w};
  status = bev_keeps_limits(&run, 0);
  if (status < BEV_OK) {
    return status;
  }
  plan->unheated_keeps_limits = status == BEV_OK ? 1 : 0;
  plan->costs_least = 1;
  soc[0] = start_soc;
  temperature_c[0] = start_c;
  status = run_paper(vehicle, trip, target_c, soc, temperature_c, heater_w,
                         &plan->switching_instant_s);
  if (status == BEV_OK) {
    status = is_driven_as_planned(vehicle, trip, soc, temperature_c, heater_w, least_w, most_w);
  }
  plan->keeps_limits = status == BEV_OK ? 1 : 0;
  if (status != BEV_OK) {
    return status < BEV_OK ? status : BEV_OK;
  }
  run.soc = soc;
  run.temperature_c = temperature_c;
  status = bev_describe_run(&run, plan);
  if (status != BEV_OK) {
    return status;
  }
  /* The circuit's own limit lies at the battery's or above it, so all power is deliverable. */
  const bev_run_of_powers made = {1, soc, temperature_c, heater_w, NULL, NULL};
  return bev_keep_accounts(vehicle, BEV_EULER, trip, &made, NULL, &plan->energy_wh);
}
