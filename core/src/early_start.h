/* SPDX-License-Identifier: Apache-2.0 */
/* From when on the last interval of a plan's heating is heated: what bev_preheat.planning.uncertainty_margin decides first. */
#ifndef BEV_PREHEAT_CORE_EARLY_START_H_
#define BEV_PREHEAT_CORE_EARLY_START_H_

#include "bev_preheat_core/core.h"

/* What becomes of the last interval, values of `change`. */
enum { BEV_STAYS = 0, BEV_LEFT_OUT = 1, BEV_BEGINS_EARLY = 2 };

/* The heating that is planned: what is commanded in each step [W], from when on heat would come too late [s]. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  const double *command_w;
  double latest_end_s;
} bev_planned_heating;

/*
 * What becomes of its last interval. One that is left out has had `first` as its first heated step. One that begins
 * early does so at `start_s`, and ends about at `guess_s` [s].
 */
typedef struct {
  int32_t change;
  int32_t first;
  double start_s;
  double guess_s;
} bev_early_start;

bev_status bev_find_early_start(const bev_planned_heating *planned, const bev_uncertainty_margin *margin,
                                bev_early_start *start);

/* How much warmer the battery arrives for each second that heating lasts longer, about [K/s]. */
double bev_warmed_k_per_s(const bev_vehicle *vehicle, const bev_trip *trip, double end_s);

/* Write the mean heater power [W] of the steps from `from` on, at full power between two instants [s]. */
void bev_heat_between(const bev_trip *trip, int32_t from, double start_s, double end_s,
                      double *heater_w);

#endif /* BEV_PREHEAT_CORE_EARLY_START_H_ */
