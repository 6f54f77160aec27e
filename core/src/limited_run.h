/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Runs within the battery's limits: bev_preheat.planning.limited_drive.
 *
 * The states of a step are charge, temperature [deg C], heater power [W] and coolant excess [K]. A vehicle whose
 * heat arrives at once has only the first two; the others are 0.
 */
#ifndef BEV_PREHEAT_CORE_LIMITED_RUN_H_
#define BEV_PREHEAT_CORE_LIMITED_RUN_H_

#include "heat_mix.h"
#include "steps_of_model.h"

/* Constants of a run. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  /* Steps in which the charge limit, and the discharge limit, may be active: not 0. */
  const uint8_t *may_overcharge;
  const uint8_t *may_overdraw;
  /* Regeneration beyond the charge limit goes to the heater first, then to the brake. */
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

/* The temperature that must not exceed the highest [deg C]: settled, or of a shell that is warmer. */
static inline double bev_warmest_c(const bev_limited_run *run, const double states[4]) {
  const double settled_c = bev_settled_c(run, states);
  return !run->is_direct && run->vehicle->shell_share > 0.0 && states[1] + states[3] > settled_c
      ? states[1] + states[3]
      : settled_c;
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

bev_limited_run bev_limited_run_of(const bev_vehicle *vehicle, const bev_trip *trip, const uint8_t *may_overcharge,
                                   const uint8_t *may_overdraw, int32_t takes_surplus, int32_t is_direct);

/*
 * Drive step k from its states, heated with `wanted_w` [W] as far as limits let it.
 *
 * Writes the states at its end, and command, friction brake, heater power and heat into the battery, means [W].
 * BEV_EMPTY: the charge does not last for the step, and only the powers are meaningful.
 */
bev_status bev_drive_within_limits(const bev_limited_run *run, int32_t k, const double states[4], double wanted_w,
                                   double ends[4], double powers_w[4]);

#endif /* BEV_PREHEAT_CORE_LIMITED_RUN_H_ */
