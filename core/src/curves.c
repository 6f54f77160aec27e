/* SPDX-License-Identifier: Apache-2.0 */
#include <stddef.h>

#include "curves.h"

/* Piecewise linear over one axis, level beyond its ends; `stride` from one value to the next. */
static double bev_line(const double *axis, int32_t count, const double *values, double x) {
  if (x <= axis[0]) {
    return values[0];
  }
  if (x >= axis[count - 1]) {
    return values[count - 1];
  }
  if (isnan(x) != 0) {
    return x;
  }
  const int32_t i = bev_points_up_to(axis, count, x) - 1;
  const double slope = (values[i + 1] - values[i]) / (axis[i + 1] - axis[i]);
  return values[i] + slope * (x - axis[i]);
}

static double bev_held(const double *axis, int32_t count, double x) {
  const double low = axis[0];
  const double high = axis[count - 1];
  return x < low ? low : (x > high ? high : x);
}

static int32_t bev_cell(const double *axis, int32_t count, double x) {
  const int32_t below = bev_points_up_to(axis, count, x) - 1;
  return below < count - 2 ? below : count - 2;
}

/* Bilinear, in the order of operations of curves.Table for floats. */
static double bev_table(const bev_curve *curve, double soc, double temperature_c) {
  const int32_t rows = curve->soc_count;
  const int32_t columns = curve->temperature_count;
  if (rows == 1 && columns == 1) {
    return curve->values[0];
  }
  if (columns == 1) {
    return bev_line(curve->soc, rows, curve->values, soc);
  }
  if (rows == 1) {
    return bev_line(curve->temperature_c, columns, curve->values, temperature_c);
  }
  if (isnan(soc) || isnan(temperature_c)) {
    return soc + temperature_c;
  }
  const double s = bev_held(curve->soc, rows, soc);
  const double t = bev_held(curve->temperature_c, columns, temperature_c);
  const int32_t i = bev_cell(curve->soc, rows, s);
  const int32_t j = bev_cell(curve->temperature_c, columns, t);
  const double a = (s - curve->soc[i]) / (curve->soc[i + 1] - curve->soc[i]);
  const double b = (t - curve->temperature_c[j])
      / (curve->temperature_c[j + 1] - curve->temperature_c[j]);
  const double *low = &curve->values[i * columns + j];
  const double *high = &low[columns];
  const double at_low = low[0] + b * (low[1] - low[0]);
  return at_low + a * (high[0] + b * (high[1] - high[0]) - at_low);
}

double bev_table_value(const bev_curve *curve, int32_t saturating, double soc, double temperature_c) {
  return saturating == BEV_AS_ARRAYS ? bev_table_as_arrays(curve, soc, temperature_c)
                                     : bev_table(curve, soc, temperature_c);
}
