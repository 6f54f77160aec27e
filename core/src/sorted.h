/* SPDX-License-Identifier: Apache-2.0 */
/* Arrays of rising values, and lines through points, computed as in NumPy. */
#ifndef BEV_PREHEAT_CORE_SORTED_H_
#define BEV_PREHEAT_CORE_SORTED_H_

#include <stdbool.h>
#include <stdint.h>

/* Last index at which a sorted array of `count` values is not above x; -1 if all values are above x. */
static inline int32_t bev_last_up_to(const double *values, int32_t count, double x) {
  int32_t low = 0;
  int32_t high = count;
  while (low < high) {
    const int32_t middle = low + (high - low) / 2;
    /* Selected without a branch, which would be mispredicted half of the time. */
    const bool is_up_to = x >= values[middle];
    low = is_up_to ? middle + 1 : low;
    high = is_up_to ? high : middle;
  }
  return low - 1;
}

/* Number of values of a sorted array below x. */
static inline int32_t bev_number_below(const double *values, int32_t count, double x) {
  int32_t low = 0;
  int32_t high = count;
  while (low < high) {
    const int32_t middle = low + (high - low) / 2;
    const bool is_below = values[middle] < x;
    low = is_below ? middle + 1 : low;
    high = is_below ? high : middle;
  }
  return low;
}

/* The value at x of a line through points whose last one up to x is j, computed as in numpy.interp. */
static inline double bev_at_point(const double *x_of, const double *y_of, int32_t count, int32_t j, double x,
                       double left, double right) {
  if (j < 0) {
    return left;
  }
  if (j >= count - 1) {
    return x > x_of[count - 1] ? right : y_of[count - 1];
  }
  if (x_of[j] == x) {
    return y_of[j];
  }
  const double slope = (y_of[j + 1] - y_of[j]) / (x_of[j + 1] - x_of[j]);
  return slope * (x - x_of[j]) + y_of[j];
}

static inline double bev_interpolated(const double *x_of, const double *y_of, int32_t count, double x) {
  return bev_at_point(x_of, y_of, count, bev_last_up_to(x_of, count, x), x, y_of[0], y_of[count - 1]);
}

static inline int bev_is_sorted(const double *values, int32_t count) {
  /* No early exit: without a branch the compiler checks several values at once. */
  int is_sorted = 1;
  for (int32_t n = 1; n < count; n++) {
    is_sorted = values[n] >= values[n - 1] ? is_sorted : 0;
  }
  return is_sorted;
}

#endif /* BEV_PREHEAT_CORE_SORTED_H_ */
