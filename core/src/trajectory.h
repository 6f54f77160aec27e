/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Limits and charge along a run: the functions of the same names in
 * bev_preheat.planning.limits, no_regret and charge_acceptance.
 */
#ifndef BEV_PREHEAT_CORE_TRAJECTORY_H_
#define BEV_PREHEAT_CORE_TRAJECTORY_H_

#include "steps_of_model.h"

/* Rows of a run: `rows` states over instants and powers over steps, as of bev_settle. */
typedef struct {
  int32_t rows;
  double *states[4];
  double *powers_w[4];
  bev_stranding stranding;
} bev_trajectory;

/* Steps in which charge and discharge limit may matter: not 0. */
typedef struct {
  uint8_t *charge;
  uint8_t *discharge;
} bev_watch;

/* Energy no longer accepted per joule more in the battery, to the brake and to the heater [J/J], over the steps. */
typedef struct {
  double *to_brake;
  double *to_heater;
} bev_acceptance_loss;

/* Take `count` doubles from the memory and advance its beginning behind them. */
static inline double *bev_take(double **memory, int32_t count) {
  double *const taken = *memory;
  *memory = &taken[count];
  return taken;
}

/* The rows of a run that lie one after the other; it does not strand. */
static inline bev_trajectory bev_trajectory_of(int32_t rows, int32_t steps, double *states,
                                       double *powers_w) {
  bev_trajectory trajectory;
  trajectory.rows = rows;
  for (int32_t n = 0; n < 4; n++) {
    trajectory.states[n] = n < rows ? &states[n * (steps + 1)] : NULL;
    trajectory.powers_w[n] = n < rows ? &powers_w[n * steps] : NULL;
  }
  trajectory.stranding.step = -1;
  trajectory.stranding.driven_share = 1.0;
  return trajectory;
}

bev_status bev_watch_limits(const bev_vehicle *vehicle, const bev_trip *trip,
                            const bev_trajectory *trajectory, bev_watch *watch);

/* The worst power deficit of the battery [W]; 0 if it is only rounding. */
bev_status bev_deficit_w(const bev_vehicle *vehicle, const bev_trip *trip,
                         const bev_trajectory *trajectory, double *worst_w);

/* Blend the loss along a run into the loss that was assumed; `any` says whether there is any then. */
bev_status bev_blend_acceptance_loss(const bev_vehicle *vehicle, const bev_trip *trip,
                                     const bev_watch *watch, const bev_trajectory *trajectory,
                                     bev_acceptance_loss *loss, int32_t *any);

#endif /* BEV_PREHEAT_CORE_TRAJECTORY_H_ */
