/* SPDX-License-Identifier: Apache-2.0 */
/* Runs, searches, and checks of runs, the parts of plans. Arguments, memory and statuses are as in core.h. */
#ifndef BEV_PREHEAT_CORE_PARTS_OF_PLANS_H_
#define BEV_PREHEAT_CORE_PARTS_OF_PLANS_H_

#include "bev_preheat_core/core.h"

/*
 * Heater and coolant in the steps of a run: `heat_w` is two arrays of `steps` values, one after the other, the
 * means of the heater's power and of the heat that reaches the battery [W]. `states` are as in bev_run_heated.
 */
bev_status bev_heat_along(const bev_vehicle *vehicle, const bev_trip *trip, const double *states,
                          const double *command_w, double *heat_w);

/*
 * The instant [s] at which a run backward from the target, heated with all power that the cabin leaves, meets the
 * unheated run. The backward run ends `lost_k` above the target.
 */
bev_status bev_find_crossing(const bev_vehicle *vehicle, int32_t integrator, const bev_trip *trip, double target_c,
                             double terminal_soc, double lost_k, const double *idle_temperature_c,
                             double *instant_s);

/*
 * The switch-on instant [s] from which the heater takes all power that the cabin leaves, so that the battery
 * arrives at a target; heat arrives at once, limits are ignored. 0 if that is not enough.
 *
 * `idle_soc` and `idle_c` are the unheated run, which arrives below the target. The run, its start included, and
 * the heater's power in each step [W] are written.
 */
bev_status bev_find_switch(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                           const double *idle_soc, const double *idle_c, double *soc, double *temperature_c,
                           double *heater_w, double *instant_s);

/* Means over each step of a run: arrays of `steps` values; null if not requested. */
typedef struct {
  double *temperature_c;
  double *joule_w;
} bev_means;

/* As bev_run, with the means of the steps from `first` on. */
bev_status bev_run_with_means(const bev_vehicle *vehicle, int32_t integrator, const bev_trip *trip, int32_t first,
                              const double *heater_w, const double *brake_w, double *soc, double *temperature_c,
                              bev_means means);

/* As bev_run_heated from step `first` on; adds the energy from the cells [Wh] to `taken_wh` (null: not asked for). */
bev_status bev_run_heated_with_energy(const bev_vehicle *vehicle, const bev_trip *trip, int32_t first,
                                      const double *command_w, double *states, double *taken_wh);

/* As bev_keep_accounts for a run whose means are known and which was never clipped at the hottest temperature. */
bev_status bev_energies_of_means(const bev_vehicle *vehicle, const bev_trip *trip, const bev_run_of_powers *run,
                                 bev_means means, bev_energies *energies);

/* The run to check, and its limits on the terminal power [W], which are written. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  const double *soc;
  const double *temperature_c;
  const double *heater_w;
  double *least_w;
  double *most_w;
} bev_seen_run;

/* BEV_OK if a run keeps all limits of the battery from step `first` on, BEV_LIMITED if not. */
bev_status bev_keeps_limits(const bev_seen_run *run, int32_t first);

/*
 * BEV_OK, or BEV_CHEAPER_ELSEWHERE if heating in other steps than those of a run that is heated from one instant on
 * may save charge: bev_preheat.planning.one_interval.is_cheaper_elsewhere.
 */
bev_status bev_costs_least(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                           const double *temperature_c, const double *heater_w);

#endif /* BEV_PREHEAT_CORE_PARTS_OF_PLANS_H_ */
