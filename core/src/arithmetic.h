/* SPDX-License-Identifier: Apache-2.0 */
/* Operations of the equations beyond + - * /, as in bev_preheat.numerics for floats. */
#ifndef BEV_PREHEAT_CORE_ARITHMETIC_H_
#define BEV_PREHEAT_CORE_ARITHMETIC_H_

#include <math.h>
#include <stdint.h>

/* Kinds of arithmetic, the values of `saturating`: as Python has them for floats and for arrays. */
enum { BEV_EXACT = 0, BEV_SATURATING = 1, BEV_AS_ARRAYS = 2 };

/* Of NaN and a number these return what Python's max and min do: the first unless the second is beyond. */
static inline double bev_maximum(double a, double b) { return b > a ? b : a; }

static inline double bev_minimum(double a, double b) { return b < a ? b : a; }

static inline double bev_root(double value, int32_t saturating) {
  return (saturating != 0 && !(value > 0.0)) ? 0.0 : sqrt(value);
}

static inline double bev_share(double value, int32_t saturating) {
  return saturating != 0 ? bev_minimum(bev_maximum(value, 0.0), 1.0) : value;
}

#endif /* BEV_PREHEAT_CORE_ARITHMETIC_H_ */
