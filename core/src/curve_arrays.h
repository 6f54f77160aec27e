/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Curves over many states at once, bit-identical to bev_at for each state. The kind of curve and the position of a
 * charge in a table are looked up once.
 */
#ifndef BEV_PREHEAT_CORE_CURVE_ARRAYS_H_
#define BEV_PREHEAT_CORE_CURVE_ARRAYS_H_

#include "curves.h"

/* The factors of a curve on its values, one after the other. */
static inline void bev_apply_factors(const bev_curve *curve, int32_t count, double *values) {
  for (int32_t factor = 0; factor < curve->factor_count; factor++) {
    for (int32_t n = 0; n < count; n++) {
      values[n] = curve->factor[factor] * values[n];
    }
  }
}

/* A curve over `count` states. */
static inline void bev_curve_over(const bev_curve *curve, int32_t count, const double *soc,
                                  const double *temperature_c, double *values) {
  bev_axis_walk along_soc = bev_walk_along(curve->soc, curve->soc_count);
  bev_axis_walk along_temperature = bev_walk_along(curve->temperature_c, curve->temperature_count);
  switch (curve->kind) {
    case BEV_POLYNOMIAL:
      for (int32_t n = 0; n < count; n++) {
        values[n] = bev_polynomial(curve, BEV_AS_ARRAYS, soc[n], temperature_c[n]);
      }
      break;
    case BEV_POLYNOMIAL_AND_LOGARITHM:
      for (int32_t n = 0; n < count; n++) {
        values[n] = bev_polynomial_and_logarithm(curve, BEV_AS_ARRAYS, soc[n], temperature_c[n]);
      }
      break;
    case BEV_INVERSE_TEMPERATURE:
      for (int32_t n = 0; n < count; n++) {
        values[n] = bev_inverse_temperature(curve, BEV_AS_ARRAYS, soc[n], temperature_c[n]);
      }
      break;
    default:
      for (int32_t n = 0; n < count; n++) {
        values[n] = bev_table_along(curve, &along_soc, &along_temperature, soc[n], temperature_c[n]);
      }
      break;
  }
  bev_apply_factors(curve, count, values);
}

/* A table at one charge over temperatures that do not fall: bev_table_as_arrays of each, cell by cell. */
static inline void bev_table_at_charge(const bev_curve *curve, double soc, int32_t count,
                                       const double *temperature_c, double *values) {
  const double *axis = curve->temperature_c;
  const int32_t columns = curve->temperature_count;
  if (columns == 1 || isnan(soc)) {
    for (int32_t n = 0; n < count; n++) {
      values[n] = bev_table_as_arrays(curve, soc, temperature_c[n]);
    }
    return;
  }
  int32_t i;
  int32_t next_i;
  bev_axis_walk along_soc = bev_walk_along(curve->soc, curve->soc_count);
  const double a = bev_place(&along_soc, soc, &i, &next_i);
  const double *low = &curve->values[i * columns];
  const double *high = &curve->values[next_i * columns];
  int32_t cell = 0;
  double per_k = 1.0 / (axis[1] - axis[0]);
  const double last = (double)columns - 1.0;
  for (int32_t n = 0; n < count; n++) {
    const double x = temperature_c[n];
    /* As in bev_place: beyond either end the position is that end. */
    double position = 0.0;
    if (x >= axis[columns - 1]) {
      position = last;
    } else if (x > axis[0]) {
      if (x >= axis[cell + 1]) {
        while (x >= axis[cell + 1]) {
          cell++;
        }
        per_k = 1.0 / (axis[cell + 1] - axis[cell]);
      }
      position = per_k * (x - axis[cell]) + (double)cell;
    } else {
      /* The first point. */
    }
    const int32_t reached = (int32_t)position;
    const int32_t j = reached < columns - 2 ? reached : columns - 2;
    const double b = position - (double)j;
    const double at_low = low[j] + b * (low[j + 1] - low[j]);
    const double at_high = high[j] + b * (high[j + 1] - high[j]);
    values[n] = at_low + a * (at_high - at_low);
  }
}

/* A curve at one charge over `count` temperatures, numbers that do not fall. */
static inline void bev_curve_at_charge(const bev_curve *curve, double soc, int32_t count,
                                       const double *temperature_c, double *values) {
  double value = 0.0;
  switch (curve->kind) {
    case BEV_POLYNOMIAL:
    case BEV_POLYNOMIAL_AND_LOGARITHM:
      /* The same at all temperatures. */
      value = curve->kind == (int32_t)BEV_POLYNOMIAL
          ? bev_polynomial(curve, BEV_AS_ARRAYS, soc, temperature_c[0])
          : bev_polynomial_and_logarithm(curve, BEV_AS_ARRAYS, soc, temperature_c[0]);
      for (int32_t n = 0; n < count; n++) {
        values[n] = value;
      }
      break;
    case BEV_INVERSE_TEMPERATURE:
      for (int32_t n = 0; n < count; n++) {
        values[n] = bev_inverse_temperature(curve, BEV_AS_ARRAYS, soc, temperature_c[n]);
      }
      break;
    default:
      bev_table_at_charge(curve, soc, count, temperature_c, values);
      break;
  }
  bev_apply_factors(curve, count, values);
}

#endif /* BEV_PREHEAT_CORE_CURVE_ARRAYS_H_ */
