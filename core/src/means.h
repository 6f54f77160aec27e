/* SPDX-License-Identifier: Apache-2.0 */
/* Runs that record the means over their steps, or the energy they take, and energies computed from the means. */
#ifndef BEV_PREHEAT_CORE_MEANS_H_
#define BEV_PREHEAT_CORE_MEANS_H_

#include "bev_preheat_core/core.h"

/* Means over each step of a run: arrays of `steps` values; null if not requested. */
typedef struct {
  double *temperature_c;
  double *joule_w;
} bev_means;

/* As bev_run, with the means of the steps from `first` on. */
bev_status bev_run_with_means(const bev_vehicle *vehicle, int32_t integrator, const bev_trip *trip,
                              int32_t first, const double *heater_w, const double *brake_w,
                              double *soc, double *temperature_c, bev_means means);

/* As bev_run_heated from step `first` on; adds the energy from the cells [Wh] to `taken_wh` (null: not asked for). */
bev_status bev_run_heated_with_energy(const bev_vehicle *vehicle, const bev_trip *trip,
                                      int32_t first, const double *command_w, double *states,
                                      double *taken_wh);

/* As bev_keep_accounts for a run whose means are known and which was never clipped at the hottest temperature. */
bev_status bev_energies_of_means(const bev_vehicle *vehicle, const bev_trip *trip,
                                 const bev_run_of_powers *run, bev_means means,
                                 bev_energies *energies);

#endif /* BEV_PREHEAT_CORE_MEANS_H_ */
