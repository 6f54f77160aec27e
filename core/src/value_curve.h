/* SPDX-License-Identifier: Apache-2.0 */
/* Value of a kelvin, over temperature: bev_preheat.planning.value_curve. */
#ifndef BEV_PREHEAT_CORE_VALUE_CURVE_H_
#define BEV_PREHEAT_CORE_VALUE_CURVE_H_

#include "strides.h"

/* Points of a value curve: temperatures that do not fall, and energies. */
typedef struct {
  int32_t count;
  double *temperature_c;
  double *energy_j;
} bev_points;

/* The curves before and after one stride, its map, and room for the next curve. */
typedef struct {
  bev_points after;
  bev_points heated;
  bev_points unheated;
  bev_points next;
  double *mesh_c;
  double *heated_j;
  double *unheated_j;
  bev_stride_map map;
} bev_curves;

/* Bands of one stride: arrays of BEV_BANDS [deg C]. */
typedef struct {
  double *floor_c;
  double *low_c;
  double *high_c;
} bev_bands;

/* Curves without points, in BEV_CURVE_MEMORY doubles. */
bev_curves bev_curves_in(double *memory);

static inline void bev_append(bev_points *curve, double temperature_c, double energy_j) {
  curve->temperature_c[curve->count] = temperature_c;
  curve->energy_j[curve->count] = energy_j;
  curve->count++;
}

/*
 * The curve before a stride, `curves->next`, from the curve after it and the stride's map; writes the bands found
 * to `bands`. `joule_worth` is the value on arrival of a joule in the battery [J/J].
 */
bev_status bev_curve_before(bev_curves *curves, double joule_worth, const bev_bands *bands);

/* The part of a curve between two temperatures, its points dense enough and few enough. */
bev_status bev_part_of_curve(const bev_points *curve, double coldest_c, double warmest_c,
                             bev_points *part);

/* Value of a kelvin near a temperature [J/K]. */
double bev_worth_j_per_k(const bev_points *curve, double temperature_c);

#endif /* BEV_PREHEAT_CORE_VALUE_CURVE_H_ */
