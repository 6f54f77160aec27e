/* SPDX-License-Identifier: Apache-2.0 */
/* Start of the last heating interval of a plan: the first decision of bev_preheat.planning.uncertainty_margin. */
#ifndef BEV_PREHEAT_CORE_EARLY_START_H_
#define BEV_PREHEAT_CORE_EARLY_START_H_

#include "bev_preheat_core/core.h"

/* Values of `change`: treatment of the last heating interval. */
enum { BEV_STAYS = 0, BEV_LEFT_OUT = 1, BEV_BEGINS_EARLY = 2 };

/* The planned heating: command in each step [W], and the instant after which heat would come too late [s]. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  const double *command_w;
  double latest_end_s;
} bev_planned_heating;

/*
 * Treatment of its last heating interval. `first` is its first heated step before the change. An interval that
 * begins early starts at `start_s` and ends at about `guess_s` [s].
 */
typedef struct {
  int32_t change;
  int32_t first;
  double start_s;
  double guess_s;
} bev_early_start;

bev_status bev_find_early_start(const bev_planned_heating *planned, const bev_uncertainty_margin *margin,
                                bev_early_start *start);

/* Approximate warming on arrival for each second of longer heating [K/s]. */
double bev_warmed_k_per_s(const bev_vehicle *vehicle, const bev_trip *trip, double end_s);

/* Write the mean heater power [W] of the steps from `from` on, at full power between two instants [s]. */
void bev_heat_between(const bev_trip *trip, int32_t from, double start_s, double end_s,
                      double *heater_w);

#endif /* BEV_PREHEAT_CORE_EARLY_START_H_ */
