/* SPDX-License-Identifier: Apache-2.0 */
/* Curves over state of charge and temperature: the formulas are generated, tables are read here. */
#ifndef BEV_PREHEAT_CORE_CURVES_H_
#define BEV_PREHEAT_CORE_CURVES_H_

#include "arithmetic.h"
#include "bev_preheat_core/core.h"
#include "bev_preheat_core_generated/formulas.h"

/* How many of the rising axis' points are not above x. */
static inline int32_t bev_points_up_to(const double *axis, int32_t count, double x) {
  /* Without a branch, which would be mispredicted half of the time: `left` points are undecided. */
  int32_t low = 0;
  int32_t left = count;
  while (left > 0) {
    const int32_t half = (left + 1) / 2;
    low = x < axis[low + half - 1] ? low : low + half;
    left = left - half;
  }
  return low;
}

/* An axis, and the cell of the last value along it: the next value is mostly in the same cell. */
typedef struct {
  const double *axis;
  int32_t count;
  /* Below 0: none yet. */
  int32_t cell;
  double per_unit;
} bev_axis_walk;

static inline bev_axis_walk bev_walk_along(const double *axis, int32_t count) {
  const bev_axis_walk walk = {axis, count, -1, 0.0};
  return walk;
}

/* Where x is along the axis: the point below, the one above, and how far it is between them. */
static inline double bev_place(bev_axis_walk *walk, double x, int32_t *below, int32_t *above) {
  const double *axis = walk->axis;
  const int32_t count = walk->count;
  *below = 0;
  *above = 0;
  if (count == 1) {
    return 0.0;
  }
  double position = 0.0;
  if (x >= axis[count - 1]) {
    position = (double)count - 1.0;
  } else if (x > axis[0]) {
    if (walk->cell < 0 || x < axis[walk->cell] || x >= axis[walk->cell + 1]) {
      walk->cell = bev_points_up_to(axis, count, x) - 1;
      walk->per_unit = 1.0 / (axis[walk->cell + 1] - axis[walk->cell]);
    }
    position = walk->per_unit * (x - axis[walk->cell]) + (double)walk->cell;
  } else {
    /* At the first point, or below. */
  }
  const int32_t cell = (int32_t)position;
  *below = cell < count - 2 ? cell : count - 2;
  *above = *below + 1;
  return position - (double)*below;
}

/* Bilinear, in the order of operations of curves.Table for arrays, state after state. */
static inline double bev_table_along(const bev_curve *curve, bev_axis_walk *along_soc,
                                     bev_axis_walk *along_temperature, double soc, double temperature_c) {
  if (isnan(soc) || isnan(temperature_c)) {
    return soc + temperature_c;
  }
  int32_t i;
  int32_t next_i;
  int32_t j;
  int32_t next_j;
  const double a = bev_place(along_soc, soc, &i, &next_i);
  const double b = bev_place(along_temperature, temperature_c, &j, &next_j);
  const double *low = &curve->values[i * curve->temperature_count];
  const double *high = &curve->values[next_i * curve->temperature_count];
  const double at_low = low[j] + b * (low[next_j] - low[j]);
  const double at_high = high[j] + b * (high[next_j] - high[j]);
  return at_low + a * (at_high - at_low);
}

/* The same of one state. */
static inline double bev_table_as_arrays(const bev_curve *curve, double soc, double temperature_c) {
  bev_axis_walk along_soc = bev_walk_along(curve->soc, curve->soc_count);
  bev_axis_walk along_temperature = bev_walk_along(curve->temperature_c, curve->temperature_count);
  return bev_table_along(curve, &along_soc, &along_temperature, soc, temperature_c);
}

/* The value of a table; not inline, so that the formulas are inlined where bev_at is called. */
double bev_table_value(const bev_curve *curve, int32_t saturating, double soc, double temperature_c);

static inline double bev_at(const bev_curve *curve, int32_t saturating, double soc, double temperature_c) {
  double value;
  switch (curve->kind) {
    case BEV_POLYNOMIAL:
      value = bev_polynomial(curve, saturating, soc, temperature_c);
      break;
    case BEV_POLYNOMIAL_AND_LOGARITHM:
      value = bev_polynomial_and_logarithm(curve, saturating, soc, temperature_c);
      break;
    case BEV_INVERSE_TEMPERATURE:
      value = bev_inverse_temperature(curve, saturating, soc, temperature_c);
      break;
    default:
      value = bev_table_value(curve, saturating, soc, temperature_c);
      break;
  }
  for (int32_t n = 0; n < curve->factor_count; n++) {
    value = curve->factor[n] * value;
  }
  return value;
}

/* Values of the battery circuit's curves at a state; they do not depend on the power. */
typedef struct {
  double voltage_v;
  double resistance_ohm;
  double temperature_c;
} bev_circuit;

static inline bev_circuit bev_circuit_at(const bev_vehicle *vehicle, double soc, double temperature_c) {
  const bev_circuit circuit = {
      bev_at(&vehicle->open_circuit_voltage, BEV_AS_ARRAYS, soc, temperature_c),
      bev_at(&vehicle->resistance, BEV_AS_ARRAYS, soc, temperature_c), temperature_c};
  return circuit;
}

#endif /* BEV_PREHEAT_CORE_CURVES_H_ */
