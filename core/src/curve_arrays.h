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

#endif /* BEV_PREHEAT_CORE_CURVE_ARRAYS_H_ */
