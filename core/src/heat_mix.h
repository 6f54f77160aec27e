/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The cheapest mix of a trip's heat sources: bev_preheat.planning.heat_mix. Heat is counted as the HVCH power that
 * gives it; without sources heat and electrical power are the same number. Heat below 0 is cooling.
 */
#ifndef BEV_PREHEAT_CORE_HEAT_MIX_H_
#define BEV_PREHEAT_CORE_HEAT_MIX_H_

#include <math.h>

#include "bev_preheat_core_generated/constants.h"
#include "bev_preheat_core/core.h"

/* Most heat and electrical power at one instant [W], by merit: of `heating` sources, then of those that cool. */
typedef struct {
  int32_t count;
  int32_t heating;
  double heats_w[BEV_MOST_SOURCES];
  double powers_w[BEV_MOST_SOURCES];
} bev_merit;

/* The merit in step k at a temperature of the battery [deg C]. */
static inline void bev_merit_at(const bev_trip *trip, int32_t k, double temperature_c, bev_merit *merit) {
  const bev_heat_sources *from = trip->sources;
  merit->count = from == NULL ? 0 : from->count;
  merit->heating = from == NULL ? 0 : from->heating_count;
  if (merit->count == 0) {
    return;
  }
  int32_t low = 0;
  while (low + 2 < from->temperature_count && temperature_c > from->temperature_c[low + 1]) {
    low++;
  }
  const double at = (temperature_c - from->temperature_c[low])
      / (from->temperature_c[low + 1] - from->temperature_c[low]);
  const double share = at > 0.0 ? (at < 1.0 ? at : 1.0) : 0.0;
  for (int32_t n = 0; n < merit->count; n++) {
    const int32_t place = (k * from->temperature_count + low) * merit->count + n;
    const double *power_w = &from->power_w[place];
    const double *watts = &from->hvch_watts[place];
    const double most_w = power_w[0] + share * (power_w[merit->count] - power_w[0])
        - from->taken_w[k * merit->count + n];
    const double *steps_w = &from->steps_w[n * from->step_count];
    double here_w = most_w > 0.0 && isinf(steps_w[0]) ? most_w : 0.0;
    for (int32_t step = 0; step < from->step_count && steps_w[step] <= most_w + BEV_ROUNDING_W; step++) {
      here_w = steps_w[step];
    }
    const double per_watt = watts[0] + share * (watts[merit->count] - watts[0]);
    /* Insertion by falling merit; equal ones stay in their order. A source without power goes to the end. */
    const int32_t first = n < merit->heating ? 0 : merit->heating;
    int32_t into = n;
    for (; into > first && here_w > 0.0 && (merit->powers_w[into - 1] == 0.0
               || fabs(per_watt) * merit->powers_w[into - 1] > fabs(merit->heats_w[into - 1])); into--) {
      merit->heats_w[into] = merit->heats_w[into - 1];
      merit->powers_w[into] = merit->powers_w[into - 1];
    }
    merit->heats_w[into] = here_w * per_watt;
    merit->powers_w[into] = here_w;
  }
}

/* The part of a value that a width of the same sign takes. */
static inline double bev_part_of(double value, double width) {
  const double most = value * width > 0.0 ? width : 0.0;
  return fabs(value) < fabs(most) ? value : most;
}

/* A value filled into widths one after the other, as the sum of the same shares of others. */
static inline double bev_along(double value, int32_t count, const double *widths, const double *others) {
  double left = value;
  double total = 0.0;
  for (int32_t n = 0; n < count; n++) {
    const double part = bev_part_of(left, widths[n]);
    total += part != 0.0 ? part / widths[n] * others[n] : 0.0;
    left -= part;
  }
  return total;
}

/* The least electrical power of a heat [W]. */
static inline double bev_electric_w(const bev_merit *merit, double heat_w) {
  return merit->count == 0 ? heat_w : bev_along(heat_w, merit->count, merit->heats_w, merit->powers_w);
}

/* The most heat of an electrical power [W]. */
static inline double bev_heat_of_w(const bev_merit *merit, double electric_w) {
  return merit->count == 0 ? electric_w : bev_along(electric_w, merit->heating, merit->powers_w, merit->heats_w);
}

/* The least heat of an electrical power [W], at most 0. */
static inline double bev_cold_of_w(const bev_merit *merit, double electric_w) {
  return bev_along(electric_w, merit->count - merit->heating, &merit->powers_w[merit->heating],
                   &merit->heats_w[merit->heating]);
}

/* The part of a heat that the sources give [W]; a source that would heat with next to nothing is left out. */
static inline double bev_capped_w(const bev_merit *merit, double heat_w) {
  if (merit->count == 0) {
    return heat_w;
  }
  double left = heat_w;
  double total = 0.0;
  for (int32_t n = 0; n < merit->count; n++) {
    const double part = bev_part_of(left, merit->heats_w[n]);
    total += fabs(part) >= BEV_LEAST_SOURCE_W ? part : 0.0;
    left -= part;
  }
  return total;
}

/* The most electrical power of a step at any temperature [W]. */
static inline double bev_drawing_limit_w(const bev_trip *trip, int32_t k) {
  return trip->sources == NULL ? trip->heater_limit_w[k] : trip->sources->drawing_limit_w[k];
}

/* Whether a source cools. */
static inline int bev_cools(const bev_trip *trip) {
  return trip->sources != NULL && trip->sources->heating_count < trip->sources->count;
}

#endif /* BEV_PREHEAT_CORE_HEAT_MIX_H_ */
