/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Value of a kelvin, over temperature: bev_preheat.planning.value_curve, which documents the constants below and
 * the reasons for them.
 */
#include "value_curve.h"

#include "bev_preheat_core_generated/constants.h"
#include <stdbool.h>

#include "arithmetic.h"
#include "checks.h"
#include "sorted.h"

/*
 * The curve before a stride: each point moved back to its origin, plus the energy of the stride. Interpolates as
 * numpy.interp does, cell by cell of the map; all points in a cell share its slopes.
 */
static void run_backward(const bev_points *after, const double *grid_c, const double *end_c,
                         const double *energy_j, int32_t grid, double joule_worth,
                         bev_points *before) {
  const double *from_c = after->temperature_c;
  const double *from_j = after->energy_j;
  double *start_c = before->temperature_c;
  double *start_j = before->energy_j;
  const int32_t count = after->count;
  int32_t n = 0;
  before->count = count;
  for (; n < count && from_c[n] < end_c[0]; n++) {
    start_c[n] = grid_c[0];
    start_j[n] = from_j[n] + joule_worth * energy_j[0];
  }
  for (int32_t j = 0; j + 1 < grid && n < count; j++) {
    if (from_c[n] < end_c[j + 1]) {
      const double wide_k = end_c[j + 1] - end_c[j];
      const double start_slope = (grid_c[j + 1] - grid_c[j]) / wide_k;
      const double energy_slope = (energy_j[j + 1] - energy_j[j]) / wide_k;
      do {
        const double above_k = from_c[n] - end_c[j];
        start_c[n] = start_slope * above_k + grid_c[j];
        start_j[n] = from_j[n] + joule_worth * (energy_slope * above_k + energy_j[j]);
        n++;
      } while (n < count && from_c[n] < end_c[j + 1]);
    }
  }
  for (; n < count; n++) {
    start_c[n] = grid_c[grid - 1];
    start_j[n] = from_j[n] + joule_worth * energy_j[grid - 1];
  }
}

static void add_band(const bev_bands *bands, int32_t slot, double floor_c, double low_c,
                     double high_c) {
  if (slot < BEV_BANDS) {
    bands->floor_c[slot] = floor_c;
    bands->low_c[slot] = low_c;
    bands->high_c[slot] = high_c;
  }
}

static void copy_numbers(double *to, const double *from, int32_t count) {
  for (int32_t n = 0; n < count; n++) {
    to[n] = from[n];
  }
}

/* Heated below the threshold, unheated above; heated in part between: a straight piece. */
static void split_at(bev_curves *work, int32_t split, const bev_bands *bands) {
  const double low_c = work->heated.temperature_c[split];
  const double high_c = work->unheated.temperature_c[split];
  const int32_t fan = high_c > low_c + BEV_LEAST_FAN_K ? split + 1 : split;
  const int32_t rest = work->unheated.count - split;
  work->next.count = fan + rest;
  copy_numbers(work->next.temperature_c, work->heated.temperature_c, fan);
  copy_numbers(work->next.energy_j, work->heated.energy_j, fan);
  copy_numbers(&work->next.temperature_c[fan], &work->unheated.temperature_c[split], rest);
  copy_numbers(&work->next.energy_j[fan], &work->unheated.energy_j[split], rest);
  add_band(bands, 0, -INFINITY, low_c, bev_maximum(high_c, low_c + BEV_LEAST_GAIN_K));
}

/* On the line from point j of a curve to the next one. */
static double on_line(const double *x_of, const double *y_of, int32_t j, double x) {
  const double slope = (y_of[j + 1] - y_of[j]) / (x_of[j + 1] - x_of[j]);
  return slope * (x - x_of[j]) + y_of[j];
}

/*
 * The energy of both curves at the temperatures of both, which is `meshed`; each curve ends with infinity.
 * Interpolates as numpy.interp does. If only one curve is known at a temperature, the other is left out.
 */
static void mesh_curves(bev_curves *work, int32_t meshed) {
  const double *heated_c = work->heated.temperature_c;
  const double *heated_j = work->heated.energy_j;
  const double *unheated_c = work->unheated.temperature_c;
  const double *unheated_j = work->unheated.energy_j;
  const int32_t last = work->heated.count - 1;
  /* The next point of each curve. */
  int32_t h = 0;
  int32_t u = 0;
  for (int32_t n = 0; n < meshed; n++) {
    /* Of points at the same temperature the last point counts. */
    if (heated_c[h] <= unheated_c[u]) {
      const double here_c = heated_c[h];
      int32_t at = h;
      int32_t below = u - 1;
      while (heated_c[at + 1] <= here_c) {
        at++;
      }
      while (unheated_c[below + 1] <= here_c) {
        below++;
      }
      work->mesh_c[n] = here_c;
      work->heated_j[n] = heated_j[at];
      work->unheated_j[n] = below < 0 ? INFINITY
          : below >= last             ? unheated_j[last]
                                      : on_line(unheated_c, unheated_j, below, here_c);
      h++;
    } else {
      const double here_c = unheated_c[u];
      int32_t at = u;
      const int32_t below = h - 1;
      while (unheated_c[at + 1] <= here_c) {
        at++;
      }
      work->mesh_c[n] = here_c;
      work->heated_j[n] = below < 0 ? heated_j[0]
          : below < last            ? on_line(heated_c, heated_j, below, here_c)
          : here_c > heated_c[last] ? INFINITY
                                    : heated_j[last];
      work->unheated_j[n] = unheated_j[at];
      u++;
    }
  }
}

/* The lower of the two curves, at the points of both. */
static bev_status take_lower(bev_curves *work, const bev_bands *bands) {
  const bev_points *heated = &work->heated;
  const bev_points *unheated = &work->unheated;
  const int32_t count = heated->count;
  const int32_t meshed = 2 * count;
  const double *mesh_c = work->mesh_c;
  if (meshed >= BEV_CURVE_POINTS || !bev_is_sorted(heated->temperature_c, count)
      || !bev_is_sorted(unheated->temperature_c, count)) {
    return BEV_NOT_SETTLED;
  }
  heated->temperature_c[count] = INFINITY;
  unheated->temperature_c[count] = INFINITY;
  mesh_curves(work, meshed);
  /* The ranges in which heating is no dearer: each from behind the last dearer point to a point that is not dearer. */
  int32_t ends[BEV_MOST_LOWER_BANDS];
  int32_t colder[BEV_MOST_LOWER_BANDS];
  int32_t found = 0;
  int32_t dearer = -1;
  for (int32_t n = 0; n < meshed; n++) {
    if (!(work->heated_j[n] <= work->unheated_j[n] + BEV_INDIFFERENCE_J)) {
      dearer = n;
    } else if (n + 1 == meshed
               || !(work->heated_j[n + 1] <= work->unheated_j[n + 1] + BEV_INDIFFERENCE_J)) {
      if (found >= BEV_MOST_LOWER_BANDS) {
        return BEV_NOT_SETTLED;
      }
      ends[found] = n;
      colder[found] = dearer;
      found++;
    } else {
      /* Between the ends of a band. */
    }
  }
  /* Warmest band first. A point between low and high of a band is left out. */
  double left_out[2 * BEV_MOST_LOWER_BANDS];
  for (int32_t slot = 0; slot < found; slot++) {
    const int32_t at = found - 1 - slot;
    const double low_c = mesh_c[ends[at]];
    const double high_c = bev_maximum(
        bev_interpolated(heated->temperature_c, unheated->temperature_c, count, low_c),
        low_c + BEV_LEAST_GAIN_K);
    add_band(bands, slot, colder[at] >= 0 ? mesh_c[colder[at]] : -INFINITY, low_c, high_c);
    left_out[2 * slot] = low_c;
    left_out[2 * slot + 1] = high_c;
  }
  int32_t kept = 0;
  for (int32_t n = 0; n < meshed; n++) {
    int32_t is_kept = 1;
    for (int32_t slot = 0; slot < found; slot++) {
      is_kept = mesh_c[n] > left_out[2 * slot] && mesh_c[n] < left_out[2 * slot + 1] ? 0 : is_kept;
    }
    work->next.temperature_c[kept] = mesh_c[n];
    work->next.energy_j[kept] = bev_minimum(work->heated_j[n], work->unheated_j[n]);
    kept += is_kept;
  }
  work->next.count = kept;
  return BEV_OK;
}

/* Marks (not 0) the pieces of the curve in which a kelvin is worth more than the heater energy for it. */
static void find_where_it_pays(const bev_curves *work, double warmest_c, double *is_paid) {
  const double *after_c = work->after.temperature_c;
  const double *after_j = work->after.energy_j;
  const double *heated_c = work->heated.temperature_c;
  const double *heated_j = work->heated.energy_j;
  const double *unheated_c = work->unheated.temperature_c;
  const double *unheated_j = work->unheated.energy_j;
  /* Without a branch, so that several pieces are computed at once. */
  for (int32_t n = 0; n + 1 < work->after.count; n++) {
    const double gained_k = unheated_c[n + 1] - heated_c[n + 1];
    const double j_per_k = (heated_j[n + 1] - unheated_j[n + 1])
        / (gained_k > BEV_LEAST_GAIN_K ? gained_k : BEV_LEAST_GAIN_K);
    const double asked = gained_k > BEV_LEAST_GAIN_K ? j_per_k : -INFINITY;
    const double is_worth =
        after_j[n] - after_j[n + 1] > asked * (after_c[n + 1] - after_c[n]) ? 1.0 : 0.0;
    is_paid[n] = heated_c[n + 1] < warmest_c ? is_worth : 0.0;
  }
}

/* The cheaper of the two branches of the curve before the stride goes into work->next. */
static bev_status take_cheaper(bev_curves *work, const bev_bands *bands) {
  const int32_t pieces = work->after.count - 1;
  const double *is_paid = work->mesh_c;
  int32_t splits = 0;
  int32_t split = 0;
  find_where_it_pays(work, work->map.start_c[work->map.count - 1], work->mesh_c);
  for (int32_t n = 0; n < pieces; n++) {
    if (is_paid[n] != 0.0 && (n + 1 == pieces || is_paid[n + 1] == 0.0)) {
      splits++;
      split = n + 1;
    }
  }
  if (splits == 0) {
    const bev_points unheated = work->unheated;
    work->unheated = work->next;
    work->next = unheated;
    return BEV_OK;
  }
  if (is_paid[0] != 0.0 && splits == 1) {
    split_at(work, split, bands);
    return BEV_OK;
  }
  return take_lower(work, bands);
}

static bev_status add_point(bev_points *curve, double temperature_c, double energy_j) {
  if (curve->count >= BEV_CURVE_POINTS) {
    return BEV_NOT_SETTLED;
  }
  const int32_t at = bev_number_below(curve->temperature_c, curve->count, temperature_c);
  for (int32_t n = curve->count; n > at; n--) {
    curve->temperature_c[n] = curve->temperature_c[n - 1];
    curve->energy_j[n] = curve->energy_j[n - 1];
  }
  curve->temperature_c[at] = temperature_c;
  curve->energy_j[at] = energy_j;
  curve->count++;
  return BEV_OK;
}

/* If there are too many points, drop every other point that lies on the line of its neighbours. */
static void thin_out(bev_points *part) {
  const int32_t count = part->count;
  double *temperature_c = part->temperature_c;
  double *energy_j = part->energy_j;
  int32_t kept = 1;
  /* The last point that is always retained, with its original values. */
  double before_c = temperature_c[0];
  double before_j = energy_j[0];
  int32_t n = 1;
  for (; n + 1 < count; n += 2) {
    const double here_c = temperature_c[n];
    const double here_j = energy_j[n];
    const double after_c = temperature_c[n + 1];
    const double after_j = energy_j[n + 1];
    const double slope = (after_j - before_j) / (after_c - before_c);
    const double line_j = slope * (here_c - before_c) + before_j;
    temperature_c[kept] = here_c;
    energy_j[kept] = here_j;
    const bool says_much = fabs(here_j - line_j) > BEV_CURVE_TOLERANCE_J;
    const bool is_far = after_c - before_c > BEV_WIDEST_GAP_K;
    kept += says_much || is_far ? 1 : 0;
    temperature_c[kept] = after_c;
    energy_j[kept] = after_j;
    kept++;
    before_c = after_c;
    before_j = after_j;
  }
  if (n < count) {
    temperature_c[kept] = temperature_c[n];
    energy_j[kept] = energy_j[n];
    kept++;
  }
  part->count = kept;
}

/* The part of a curve that the trip can reach, its points dense enough and few enough. */
bev_status bev_part_of_curve(const bev_points *curve, double coldest_c, double warmest_c, bev_points *part) {
  const double *temperature_c = curve->temperature_c;
  const double *energy_j = curve->energy_j;
  const int32_t below = bev_number_below(temperature_c, curve->count, coldest_c) - 1;
  const int32_t first = below > 0 ? below : 0;
  int32_t last = bev_number_below(temperature_c, curve->count, warmest_c) + 1;
  last = last < curve->count ? last : curve->count;
  int32_t count = 0;
  double here_c = temperature_c[first];
  double before_c = INFINITY;
  double before_j = 0.0;
  for (int32_t n = first; n < last; n++) {
    /* Of points at the same temperature the last point remains. */
    here_c = bev_maximum(here_c, temperature_c[n]);
    if (n + 1 < last && !(temperature_c[n + 1] > here_c)) {
      continue;
    }
    if (count + 2 > BEV_CURVE_POINTS) {
      return BEV_NOT_SETTLED;
    }
    const double here_j = energy_j[n];
    if (here_c - before_c > BEV_WIDEST_GAP_K) {
      part->temperature_c[count] = 0.5 * (here_c + before_c);
      part->energy_j[count] = 0.5 * (here_j + before_j);
      count++;
    }
    part->temperature_c[count] = here_c;
    part->energy_j[count] = here_j;
    count++;
    before_c = here_c;
    before_j = here_j;
  }
  part->count = count;
  if (count > BEV_MOST_POINTS) {
    thin_out(part);
  }
  return BEV_OK;
}

double bev_worth_j_per_k(const bev_points *curve, double temperature_c) {
  const double cooler_j = bev_interpolated(curve->temperature_c, curve->energy_j, curve->count,
                                           temperature_c - 0.5 * BEV_SLOPE_K);
  const double warmer_j = bev_interpolated(curve->temperature_c, curve->energy_j, curve->count,
                                           temperature_c + 0.5 * BEV_SLOPE_K);
  return bev_maximum(cooler_j - warmer_j, 0.0) / BEV_SLOPE_K;
}

bev_status bev_curve_before(bev_curves *curves, double joule_worth, const bev_bands *bands) {
  const bev_stride_map *map = &curves->map;
  const bev_points *after = &curves->after;
  const int32_t grid = map->count;
  if (after->count < 1 || after->count > BEV_CURVE_POINTS / 2
      || !bev_is_sorted(map->unheated_end_c, grid) || !bev_is_sorted(map->heated_end_c, grid)) {
    return BEV_NOT_SETTLED;
  }
  run_backward(after, map->start_c, map->heated_end_c, map->heated_j, grid, joule_worth,
               &curves->heated);
  run_backward(after, map->start_c, map->unheated_end_c, map->unheated_j, grid, joule_worth,
               &curves->unheated);
  bev_status status = take_cheaper(curves, bands);
  if (status == BEV_OK
      && (!bev_are_numbers(curves->next.temperature_c, curves->next.count)
          || !bev_are_numbers(curves->next.energy_j, curves->next.count))) {
    return BEV_NOT_FINITE;
  }
  const double needed_c = map->needed_c;
  if (status == BEV_OK && needed_c > curves->next.temperature_c[0]) {
    const double end_c = bev_interpolated(map->start_c, map->unheated_end_c, grid, needed_c);
    const double taken_j = bev_interpolated(map->start_c, map->unheated_j, grid, needed_c);
    status = add_point(
        &curves->next, needed_c,
        bev_interpolated(after->temperature_c, after->energy_j, after->count, end_c)
            + joule_worth * taken_j);
  }
  return status;
}

bev_curves bev_curves_in(double *memory) {
  /* Curves are swapped, so each has the same room; a map has a point for each point of the grid. */
  double *room[16];
  for (int32_t n = 0; n < 16; n++) {
    room[n] = n < 11 ? &memory[n * BEV_CURVE_POINTS]
                     : &memory[11 * BEV_CURVE_POINTS + (n - 11) * BEV_MOST_GRID];
  }
  const bev_curves curves = {
      {0, room[0], room[1]}, {0, room[2], room[3]}, {0, room[4], room[5]}, {0, room[6], room[7]},
      room[8], room[9], room[10], {0, room[11], room[12], room[13], room[14], room[15], -INFINITY}};
  return curves;
}
