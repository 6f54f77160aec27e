/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a kelvin is worth, run backward from arrival: bev_preheat.planning.value_curve and the loop of
 * bev_preheat.planning.thresholds, where the constants below and the reasons for them stand.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>

#include "bev_preheat_core/core.h"

#define WIDEST_GAP_K 1.0
#define MOST_POINTS 64
#define CURVE_TOLERANCE_J 100.0
#define INDIFFERENCE_J 10.0
#define SLOPE_K 1.0
#define LEAST_GAIN_K 1e-9
#define LEAST_FAN_K 1e-6

/* Points of a value curve: temperatures that do not fall, and energies. */
typedef struct {
  int32_t count;
  double *temperature_c;
  double *energy_j;
} points;

/* The curves of one stride, and room for the next one. */
typedef struct {
  points after;
  points heated;
  points unheated;
  points next;
  double *mesh_c;
  double *heated_j;
  double *unheated_j;
} workspace;

static double greater(double a, double b) { return b > a ? b : a; }

static double lesser(double a, double b) { return b < a ? b : a; }

/* Where a sorted array of `count` values is not above x for the last time; -1 where it always is. */
static int32_t last_up_to(const double *values, int32_t count, double x) {
  int32_t low = 0;
  int32_t high = count;
  while (low < high) {
    const int32_t middle = low + (high - low) / 2;
    if (x >= values[middle]) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  return low - 1;
}

/* How many values of a sorted array are below x. */
static int32_t number_below(const double *values, int32_t count, double x) {
  int32_t low = 0;
  int32_t high = count;
  while (low < high) {
    const int32_t middle = low + (high - low) / 2;
    if (values[middle] < x) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  return low;
}

/* The value at x of a line through points whose last one up to x is j, as numpy.interp works it out. */
static double at_point(const double *x_of, const double *y_of, int32_t count, int32_t j, double x,
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

static double interpolated(const double *x_of, const double *y_of, int32_t count, double x) {
  return at_point(x_of, y_of, count, last_up_to(x_of, count, x), x, y_of[0], y_of[count - 1]);
}

static int is_sorted(const double *values, int32_t count) {
  for (int32_t n = 1; n < count; n++) {
    if (!(values[n] >= values[n - 1])) {
      return 0;
    }
  }
  return 1;
}

static int are_finite(const double *values, int32_t count) {
  for (int32_t n = 0; n < count; n++) {
    if (!isfinite(values[n])) {
      return 0;
    }
  }
  return 1;
}

static void append(points *curve, double temperature_c, double energy_j) {
  curve->temperature_c[curve->count] = temperature_c;
  curve->energy_j[curve->count] = energy_j;
  curve->count++;
}

/* The curve before a stride: each point where it comes from, with what the stride takes. */
static void run_backward(const points *after, const double *grid_c, const double *end_c,
                         const double *energy_j, int32_t grid, double joule_worth,
                         points *before) {
  int32_t j = -1;
  before->count = after->count;
  for (int32_t n = 0; n < after->count; n++) {
    const double x = after->temperature_c[n];
    while (j + 1 < grid && end_c[j + 1] <= x) {
      j++;
    }
    before->temperature_c[n] =
        at_point(end_c, grid_c, grid, j, x, grid_c[0], grid_c[grid - 1]);
    before->energy_j[n] = after->energy_j[n]
        + joule_worth * at_point(end_c, energy_j, grid, j, x, energy_j[0], energy_j[grid - 1]);
  }
}

/* Whether a kelvin is worth more in piece n of the curve than the heater takes for it. */
static int pays(const workspace *work, int32_t n, double warmest_c) {
  const points *after = &work->after;
  const double gained_k =
      work->unheated.temperature_c[n + 1] - work->heated.temperature_c[n + 1];
  const double asked = gained_k > LEAST_GAIN_K
      ? (work->heated.energy_j[n + 1] - work->unheated.energy_j[n + 1]) / gained_k
      : -INFINITY;
  return after->energy_j[n] - after->energy_j[n + 1]
          > asked * (after->temperature_c[n + 1] - after->temperature_c[n])
      && work->heated.temperature_c[n + 1] < warmest_c;
}

static void add_band(const bev_strides *strides, int32_t m, int32_t slot, double floor_c,
                     double low_c, double high_c, double *bands_c) {
  if (slot < BEV_BANDS) {
    const int32_t size = strides->strides * BEV_BANDS;
    const int32_t at = m * BEV_BANDS + slot;
    bands_c[at] = floor_c;
    bands_c[size + at] = low_c;
    bands_c[2 * size + at] = high_c;
  }
}

/* Heated below the threshold, unheated above; heated in part between: a straight piece. */
static void split_at(const bev_strides *strides, int32_t m, workspace *work, int32_t split,
                     double *bands_c) {
  const double low_c = work->heated.temperature_c[split];
  const double high_c = work->unheated.temperature_c[split];
  const int32_t fan = high_c > low_c + LEAST_FAN_K ? split + 1 : split;
  work->next.count = 0;
  for (int32_t n = 0; n < fan; n++) {
    append(&work->next, work->heated.temperature_c[n], work->heated.energy_j[n]);
  }
  for (int32_t n = split; n < work->unheated.count; n++) {
    append(&work->next, work->unheated.temperature_c[n], work->unheated.energy_j[n]);
  }
  add_band(strides, m, 0, -INFINITY, low_c, greater(high_c, low_c + LEAST_GAIN_K), bands_c);
}

/* The lower of the two curves, at the points of both. */
static bev_status take_lower(const bev_strides *strides, int32_t m, workspace *work,
                             double *bands_c) {
  const points *heated = &work->heated;
  const points *unheated = &work->unheated;
  const int32_t count = heated->count;
  const int32_t meshed = 2 * count;
  double *mesh_c = work->mesh_c;
  if (meshed > BEV_CURVE_POINTS || !is_sorted(heated->temperature_c, count)
      || !is_sorted(unheated->temperature_c, count)) {
    return BEV_NOT_SETTLED;
  }
  int32_t h = 0;
  int32_t u = 0;
  for (int32_t n = 0; n < meshed; n++) {
    if (u >= count || (h < count && heated->temperature_c[h] <= unheated->temperature_c[u])) {
      mesh_c[n] = heated->temperature_c[h];
      h++;
    } else {
      mesh_c[n] = unheated->temperature_c[u];
      u++;
    }
  }
  h = -1;
  u = -1;
  for (int32_t n = 0; n < meshed; n++) {
    while (h + 1 < count && heated->temperature_c[h + 1] <= mesh_c[n]) {
      h++;
    }
    while (u + 1 < count && unheated->temperature_c[u + 1] <= mesh_c[n]) {
      u++;
    }
    work->heated_j[n] = at_point(heated->temperature_c, heated->energy_j, count, h, mesh_c[n],
                                 heated->energy_j[0], INFINITY);
    work->unheated_j[n] = at_point(unheated->temperature_c, unheated->energy_j, count, u,
                                   mesh_c[n], INFINITY, unheated->energy_j[count - 1]);
  }
  /* Warmest band first. A point between low and high of a band is left out. */
  int32_t slot = 0;
  work->next.count = 0;
  double left_out[2 * BEV_MOST_LOWER_BANDS];
  for (int32_t last = meshed - 1; last >= 0; last--) {
    const int is_heated = work->heated_j[last] <= work->unheated_j[last] + INDIFFERENCE_J;
    const int is_next_heated = last + 1 < meshed
        && work->heated_j[last + 1] <= work->unheated_j[last + 1] + INDIFFERENCE_J;
    if (is_heated && !is_next_heated) {
      if (slot >= BEV_MOST_LOWER_BANDS) {
        return BEV_NOT_SETTLED;
      }
      int32_t colder = last - 1;
      while (colder >= 0
             && work->heated_j[colder] <= work->unheated_j[colder] + INDIFFERENCE_J) {
        colder--;
      }
      const double low_c = mesh_c[last];
      const double high_c = greater(
          interpolated(heated->temperature_c, unheated->temperature_c, count, low_c),
          low_c + LEAST_GAIN_K);
      add_band(strides, m, slot, colder >= 0 ? mesh_c[colder] : -INFINITY, low_c, high_c,
               bands_c);
      left_out[2 * slot] = low_c;
      left_out[2 * slot + 1] = high_c;
      slot++;
    }
  }
  for (int32_t n = 0; n < meshed; n++) {
    int is_kept = 1;
    for (int32_t band = 0; band < slot; band++) {
      if (mesh_c[n] > left_out[2 * band] && mesh_c[n] < left_out[2 * band + 1]) {
        is_kept = 0;
      }
    }
    if (is_kept) {
      append(&work->next, mesh_c[n], lesser(work->heated_j[n], work->unheated_j[n]));
    }
  }
  return BEV_OK;
}

static void take(points *to, const points *from) {
  to->count = 0;
  for (int32_t n = 0; n < from->count; n++) {
    append(to, from->temperature_c[n], from->energy_j[n]);
  }
}

/* The cheaper of the two branches of the curve before stride m goes into work->next. */
static bev_status take_cheaper(const bev_strides *strides, int32_t m, workspace *work,
                               double *bands_c) {
  const double warmest_c = strides->grid_c[strides->grid_points - 1];
  const int32_t pieces = work->after.count - 1;
  int32_t splits = 0;
  int32_t split = 0;
  int pays_first = 0;
  int paid_before = 0;
  for (int32_t n = 0; n < pieces; n++) {
    const int is_paid = pays(work, n, warmest_c);
    if (n == 0) {
      pays_first = is_paid;
    }
    if (paid_before && !is_paid) {
      splits++;
      split = n;
    }
    paid_before = is_paid;
  }
  if (paid_before) {
    splits++;
    split = pieces;
  }
  if (splits == 0) {
    take(&work->next, &work->unheated);
    return BEV_OK;
  }
  if (pays_first && splits == 1) {
    split_at(strides, m, work, split, bands_c);
    return BEV_OK;
  }
  return take_lower(strides, m, work, bands_c);
}

static bev_status add_point(points *curve, double temperature_c, double energy_j) {
  if (curve->count >= BEV_CURVE_POINTS) {
    return BEV_NOT_SETTLED;
  }
  const int32_t at = number_below(curve->temperature_c, curve->count, temperature_c);
  for (int32_t n = curve->count; n > at; n--) {
    curve->temperature_c[n] = curve->temperature_c[n - 1];
    curve->energy_j[n] = curve->energy_j[n - 1];
  }
  curve->temperature_c[at] = temperature_c;
  curve->energy_j[at] = energy_j;
  curve->count++;
  return BEV_OK;
}

/* The part of a curve that the trip can reach, its points dense enough and few enough. */
static bev_status within(const points *curve, double coldest_c, double warmest_c, points *part) {
  const int32_t below = number_below(curve->temperature_c, curve->count, coldest_c) - 1;
  const int32_t first = below > 0 ? below : 0;
  int32_t last = number_below(curve->temperature_c, curve->count, warmest_c) + 1;
  last = last < curve->count ? last : curve->count;
  part->count = 0;
  double here_c = curve->temperature_c[first];
  for (int32_t n = first; n < last; n++) {
    /* Of points at the same temperature the last one is left. */
    here_c = greater(here_c, curve->temperature_c[n]);
    if (n + 1 < last && !(curve->temperature_c[n + 1] > here_c)) {
      continue;
    }
    const double here_j = curve->energy_j[n];
    if (part->count > 0 && here_c - part->temperature_c[part->count - 1] > WIDEST_GAP_K) {
      if (part->count >= BEV_CURVE_POINTS) {
        return BEV_NOT_SETTLED;
      }
      append(part, 0.5 * (here_c + part->temperature_c[part->count - 1]),
             0.5 * (here_j + part->energy_j[part->count - 1]));
    }
    if (part->count >= BEV_CURVE_POINTS) {
      return BEV_NOT_SETTLED;
    }
    append(part, here_c, here_j);
  }
  if (part->count <= MOST_POINTS) {
    return BEV_OK;
  }
  const int32_t count = part->count;
  const double *temperature_c = part->temperature_c;
  const double *energy_j = part->energy_j;
  int32_t kept = 0;
  /* The point before each one that is looked at, as it was. */
  double before_c = temperature_c[0];
  double before_j = energy_j[0];
  for (int32_t n = 0; n < count; n++) {
    here_c = temperature_c[n];
    const double here_j = energy_j[n];
    int is_kept = 1;
    if (n % 2 == 1 && n < count - 1) {
      const double slope = (energy_j[n + 1] - before_j) / (temperature_c[n + 1] - before_c);
      const double line_j = slope * (here_c - before_c) + before_j;
      is_kept = fabs(here_j - line_j) > CURVE_TOLERANCE_J
          || temperature_c[n + 1] - before_c > WIDEST_GAP_K;
    }
    if (is_kept) {
      part->temperature_c[kept] = here_c;
      part->energy_j[kept] = here_j;
      kept++;
    }
    before_c = here_c;
    before_j = here_j;
  }
  part->count = kept;
  return BEV_OK;
}

/* What a joule in the battery is worth before stride m, of what it is worth after it [J/J]. */
static double joule_worth_before(const bev_strides *strides, int32_t m, const points *after,
                                 double k_per_joule, double joule_worth) {
  double worth = joule_worth - joule_worth * strides->loss_to_brake[m];
  if (strides->loss_to_heater[m] > 0.0) {
    const double end_c = strides->end_c[m];
    const double cooler_j = interpolated(after->temperature_c, after->energy_j, after->count,
                                         end_c - 0.5 * SLOPE_K);
    const double warmer_j = interpolated(after->temperature_c, after->energy_j, after->count,
                                         end_c + 0.5 * SLOPE_K);
    const double heat_worth = k_per_joule * (greater(cooler_j - warmer_j, 0.0) / SLOPE_K);
    worth = worth - strides->loss_to_heater[m] * greater(worth - heat_worth, 0.0);
  }
  return worth;
}

/* The curve before stride m, out of all that is known after it, goes into work->next. */
static bev_status before_stride(const bev_strides *strides, int32_t m, double joule_worth,
                                workspace *work, double *bands_c) {
  const int32_t grid = strides->grid_points;
  const int32_t row = m * grid;
  const double *unheated_end_c = &strides->unheated_end_c[row];
  const double *unheated_j = &strides->unheated_energy_j[row];
  const double *heated_end_c = &strides->heated_end_c[row];
  const double *heated_j = &strides->heated_energy_j[row];
  if (!is_sorted(unheated_end_c, grid) || !is_sorted(heated_end_c, grid)) {
    return BEV_NOT_SETTLED;
  }
  run_backward(&work->after, strides->grid_c, heated_end_c, heated_j, grid, joule_worth,
               &work->heated);
  run_backward(&work->after, strides->grid_c, unheated_end_c, unheated_j, grid, joule_worth,
               &work->unheated);
  if (!are_finite(work->heated.temperature_c, work->heated.count)
      || !are_finite(work->heated.energy_j, work->heated.count)
      || !are_finite(work->unheated.temperature_c, work->unheated.count)
      || !are_finite(work->unheated.energy_j, work->unheated.count)) {
    return BEV_NOT_FINITE;
  }
  bev_status status = take_cheaper(strides, m, work, bands_c);
  const double needed_c = strides->needed_c[m];
  if (status == BEV_OK && needed_c > work->next.temperature_c[0]) {
    const points *after = &work->after;
    const double end_c = interpolated(strides->grid_c, unheated_end_c, grid, needed_c);
    const double taken_j = interpolated(strides->grid_c, unheated_j, grid, needed_c);
    status = add_point(
        &work->next, needed_c,
        interpolated(after->temperature_c, after->energy_j, after->count, end_c)
            + joule_worth * taken_j);
  }
  return status;
}

bev_status bev_find_bands(const bev_strides *strides, int32_t count, const double *temperature_c,
                          const double *energy_j, double k_per_joule, double coldest_c,
                          double warmest_c, double *memory, double *bands_c) {
  if (strides == NULL || temperature_c == NULL || energy_j == NULL || memory == NULL
      || bands_c == NULL || strides->strides < 0 || strides->strides > BEV_MOST_STEPS
      || strides->grid_points < 2 || strides->grid_points > BEV_MOST_AXIS || count < 1
      || count > BEV_CURVE_POINTS / 2 || strides->grid_c == NULL
      || strides->unheated_end_c == NULL || strides->unheated_energy_j == NULL
      || strides->heated_end_c == NULL || strides->heated_energy_j == NULL
      || strides->needed_c == NULL || strides->end_c == NULL || strides->loss_to_brake == NULL
      || strides->loss_to_heater == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  if (!isfinite(k_per_joule) || !isfinite(coldest_c) || !isfinite(warmest_c)
      || !is_sorted(strides->grid_c, strides->grid_points)
      || !are_finite(strides->grid_c, strides->grid_points) || !is_sorted(temperature_c, count)
      || !are_finite(temperature_c, count) || !are_finite(energy_j, count)) {
    return BEV_BAD_INPUT;
  }
  double *room[11];
  for (int32_t n = 0; n < 11; n++) {
    room[n] = &memory[n * BEV_CURVE_POINTS];
  }
  workspace work = {{0, room[0], room[1]}, {0, room[2], room[3]}, {0, room[4], room[5]},
                    {0, room[6], room[7]}, room[8], room[9], room[10]};
  for (int32_t n = 0; n < count; n++) {
    append(&work.after, temperature_c[n], energy_j[n]);
  }
  double joule_worth = 1.0;
  for (int32_t m = strides->strides - 1; m >= 0; m--) {
    if (work.after.count > BEV_CURVE_POINTS / 2) {
      return BEV_NOT_SETTLED;
    }
    bev_status status = before_stride(strides, m, joule_worth, &work, bands_c);
    if (status != BEV_OK) {
      return status;
    }
    joule_worth = joule_worth_before(strides, m, &work.after, k_per_joule, joule_worth);
    status = within(&work.next, coldest_c, warmest_c, &work.after);
    if (status != BEV_OK) {
      return status;
    }
  }
  return BEV_OK;
}
