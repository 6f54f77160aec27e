/* SPDX-License-Identifier: Apache-2.0 */
/* The constants of a run within the battery's limits, which its steps and its foresight share. */
#ifndef BEV_PREHEAT_CORE_LIMITED_RUN_H_
#define BEV_PREHEAT_CORE_LIMITED_RUN_H_

#include "steps_of_model.h"

/* Constants of a run. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  /* As in bev_heating. */
  const uint8_t *may_overcharge;
  const uint8_t *may_overdraw;
  int32_t takes_surplus;
  int32_t is_direct;
  double lag_s;
  /* Warming still to come from a watt of heater power, and from a kelvin of coolant excess [K]. */
  double k_per_watt;
  double share_of_excess;
  double joules_per_k;
} bev_limited_run;

/* The temperature when all heat that is under way has arrived [deg C]. */
static inline double bev_settled_c(const bev_limited_run *run, const double states[4]) {
  return run->is_direct ? states[1]
                        : states[1] + run->k_per_watt * states[2]
          + run->share_of_excess * states[3];
}

/* Whether heat arrives at once. */
static inline int32_t bev_is_direct(const bev_vehicle *vehicle) {
  return vehicle->heater_lag_s == 0.0 && vehicle->coolant_heat_capacity_j_per_k == 0.0;
}

/* Total lag of the heat [s]. */
static inline double bev_heat_lag_s(const bev_vehicle *vehicle) {
  return vehicle->heater_lag_s
      + (vehicle->coolant_heat_capacity_j_per_k > 0.0
             ? (1.0 - vehicle->shell_share)
                 * (vehicle->coolant_heat_capacity_j_per_k / vehicle->coolant_conductance_w_per_k)
             : 0.0);
}

/* Remaining share of the difference between heater and command, mean over a step. */
static inline double bev_mean_share_left(double lag_s, double duration_s) {
  return lag_s == 0.0 ? 0.0 : -expm1(-duration_s / lag_s) * lag_s / duration_s;
}

#endif /* BEV_PREHEAT_CORE_LIMITED_RUN_H_ */
