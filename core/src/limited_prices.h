/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Effect of a joule of heat in each step along a run within limits, for a vehicle without a heat path:
 * bev_preheat.planning.limited_prices.
 */
#ifndef BEV_PREHEAT_CORE_LIMITED_PRICES_H_
#define BEV_PREHEAT_CORE_LIMITED_PRICES_H_

#include <stdbool.h>

#include "bev_preheat_core_generated/constants.h"
#include "threshold_search.h"

/* The target, each climb, and the lowest charge. */
#define BEV_MOST_NEEDS (2 + BEV_MOST_CLIMBS)
/* Number of values in the slopes of a step. */
#define BEV_SLOPES 10

/* A run within limits, and the limits of its steps on the terminal power [W]. */
typedef struct {
  double *soc;
  double *temperature_c;
  double *heater_w;
  double *brake_w;
  double *least_w;
  double *most_w;
} bev_limited_trajectory;

/* Lower bounds of a run: arrival temperature, power in each step, power in climbs, and lowest charge. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  double arrival_c;
  double *power_w;
  double lowest_soc;
  int32_t climb_count;
  bev_requirement climbs[BEV_MOST_CLIMBS];
} bev_needs;

/*
 * Effects of heating a step more or less: `count` changes; the first `more` changes heat more. `step` is the step of
 * each change (a double, so that all arrays share one memory), `most_j` its maximum [J]. For a joule:
 * `charge_per_j` is the change of the charge on arrival, `needs_per_j` that of each of `needs`, one array after the
 * other: the temperature on arrival [K], the available power in the `worst` step of each climb [W], and the charge
 * at the instant `lowest`, if that is not -1.
 */
typedef struct {
  int32_t count;
  int32_t more;
  double *step;
  double *most_j;
  double *charge_per_j;
  double *needs_per_j;
  int32_t needs;
  int32_t worst[BEV_MOST_CLIMBS];
  int32_t lowest;
  /* Room for BEV_SLOPES numbers of each step, and for one more. */
  double *slopes;
  double *per_w;
} bev_changes;

/* The limits of the steps of a run. */
bev_status bev_look_at_limits(const bev_vehicle *vehicle, const bev_trip *trip,
                              const bev_limited_trajectory *run);

/* Find the needs of a run whose limits are known; vehicle, trip and room are set already. */
bev_status bev_find_needs(const bev_limited_trajectory *run, const bev_settling *goal,
                          bev_needs *needs);

/* Whether a run that does not strand meets all needs, except for rounding. */
bool bev_are_met(const bev_needs *needs, const bev_limited_trajectory *run);

/* Margin of a run over each need [K, W, ..., 1], less the margin aimed at. */
void bev_spare_of(const bev_needs *needs, const bev_changes *changes, const bev_limited_trajectory *run,
                  double spare[BEV_MOST_NEEDS]);

/* The surplus that goes to the heater in a step of a run anyway [W]. */
double bev_free_heat_w(const bev_trip *trip, const bev_limited_trajectory *run, int32_t k);

/* The changes that can be made to a run. */
bev_status bev_find_changes(const bev_needs *needs, const bev_limited_trajectory *run,
                            bev_changes *changes);

#endif /* BEV_PREHEAT_CORE_LIMITED_PRICES_H_ */
