/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a kelvin is worth, over temperature: bev_preheat.planning.value_curve, where the constants below and
 * the reasons for them stand.
 */
#include "value_curve.h"

#include "arithmetic.h"
#include "checks.h"
#include "sorted.h"

#define WIDEST_GAP_K 1.0
#define MOST_POINTS 32
#define CURVE_TOLERANCE_J 100.0
#define INDIFFERENCE_J 10.0
#define SLOPE_K 1.0
#define LEAST_GAIN_K 1e-9
#define LEAST_FAN_K 1e-6

void bev_append(bev_points *curve, double temperature_c, double energy_j) {
  curve->temperature_c[curve->count] = temperature_c;
  curve->energy_j[curve->count] = energy_j;
  curve->count++;
}

/* The curve before a stride: each point where it comes from, with what the stride takes. */
static void run_backward(const bev_points *after, const double *grid_c, const double *end_c,
                         const double *energy_j, int32_t grid, double joule_worth,
                         bev_points *before) {
  int32_t j = -1;
  before->count = after->count;
  for (int32_t n = 0; n < after->count; n++) {
    const double x = after->temperature_c[n];
    while (j + 1 < grid && end_c[j + 1] <= x) {
      j++;
    }
    before->temperature_c[n] =
        bev_at_point(end_c, grid_c, grid, j, x, grid_c[0], grid_c[grid - 1]);
    before->energy_j[n] = after->energy_j[n]
        + joule_worth * bev_at_point(end_c, energy_j, grid, j, x, energy_j[0], energy_j[grid - 1]);
  }
}

/* Whether a kelvin is worth more in piece n of the curve than the heater takes for it. */
static int pays(const bev_curves *work, int32_t n, double warmest_c) {
  const bev_points *after = &work->after;
  const double gained_k =
      work->unheated.temperature_c[n + 1] - work->heated.temperature_c[n + 1];
  const double asked = gained_k > LEAST_GAIN_K
      ? (work->heated.energy_j[n + 1] - work->unheated.energy_j[n + 1]) / gained_k
      : -INFINITY;
  return after->energy_j[n] - after->energy_j[n + 1]
          > asked * (after->temperature_c[n + 1] - after->temperature_c[n])
      && work->heated.temperature_c[n + 1] < warmest_c;
}

static void add_band(const bev_bands *bands, int32_t slot, double floor_c, double low_c,
                     double high_c) {
  if (slot < BEV_BANDS) {
    bands->floor_c[slot] = floor_c;
    bands->low_c[slot] = low_c;
    bands->high_c[slot] = high_c;
  }
}

/* Heated below the threshold, unheated above; heated in part between: a straight piece. */
static void split_at(bev_curves *work, int32_t split, const bev_bands *bands) {
  const double low_c = work->heated.temperature_c[split];
  const double high_c = work->unheated.temperature_c[split];
  const int32_t fan = high_c > low_c + LEAST_FAN_K ? split + 1 : split;
  work->next.count = 0;
  for (int32_t n = 0; n < fan; n++) {
    bev_append(&work->next, work->heated.temperature_c[n], work->heated.energy_j[n]);
  }
  for (int32_t n = split; n < work->unheated.count; n++) {
    bev_append(&work->next, work->unheated.temperature_c[n], work->unheated.energy_j[n]);
  }
  add_band(bands, 0, -INFINITY, low_c, bev_maximum(high_c, low_c + LEAST_GAIN_K));
}

/* The lower of the two curves, at the points of both. */
static bev_status take_lower(bev_curves *work, const bev_bands *bands) {
  const bev_points *heated = &work->heated;
  const bev_points *unheated = &work->unheated;
  const int32_t count = heated->count;
  const int32_t meshed = 2 * count;
  double *mesh_c = work->mesh_c;
  if (meshed > BEV_CURVE_POINTS || !bev_is_sorted(heated->temperature_c, count)
      || !bev_is_sorted(unheated->temperature_c, count)) {
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
    work->heated_j[n] = bev_at_point(heated->temperature_c, heated->energy_j, count, h, mesh_c[n],
                                 heated->energy_j[0], INFINITY);
    work->unheated_j[n] = bev_at_point(unheated->temperature_c, unheated->energy_j, count, u,
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
      const double high_c = bev_maximum(
          bev_interpolated(heated->temperature_c, unheated->temperature_c, count, low_c),
          low_c + LEAST_GAIN_K);
      add_band(bands, slot, colder >= 0 ? mesh_c[colder] : -INFINITY, low_c, high_c);
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
      bev_append(&work->next, mesh_c[n], bev_minimum(work->heated_j[n], work->unheated_j[n]));
    }
  }
  return BEV_OK;
}

static void take(bev_points *to, const bev_points *from) {
  to->count = 0;
  for (int32_t n = 0; n < from->count; n++) {
    bev_append(to, from->temperature_c[n], from->energy_j[n]);
  }
}

/* The cheaper of the two branches of the curve before the stride goes into work->next. */
static bev_status take_cheaper(bev_curves *work, const bev_bands *bands) {
  const double warmest_c = work->map.start_c[work->map.count - 1];
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

/* The part of a curve that the trip can reach, its points dense enough and few enough. */
bev_status bev_part_of_curve(const bev_points *curve, double coldest_c, double warmest_c, bev_points *part) {
  const int32_t below = bev_number_below(curve->temperature_c, curve->count, coldest_c) - 1;
  const int32_t first = below > 0 ? below : 0;
  int32_t last = bev_number_below(curve->temperature_c, curve->count, warmest_c) + 1;
  last = last < curve->count ? last : curve->count;
  part->count = 0;
  double here_c = curve->temperature_c[first];
  for (int32_t n = first; n < last; n++) {
    /* Of points at the same temperature the last one is left. */
    here_c = bev_maximum(here_c, curve->temperature_c[n]);
    if (n + 1 < last && !(curve->temperature_c[n + 1] > here_c)) {
      continue;
    }
    const double here_j = curve->energy_j[n];
    if (part->count > 0 && here_c - part->temperature_c[part->count - 1] > WIDEST_GAP_K) {
      if (part->count >= BEV_CURVE_POINTS) {
        return BEV_NOT_SETTLED;
      }
      bev_append(part, 0.5 * (here_c + part->temperature_c[part->count - 1]),
             0.5 * (here_j + part->energy_j[part->count - 1]));
    }
    if (part->count >= BEV_CURVE_POINTS) {
      return BEV_NOT_SETTLED;
    }
    bev_append(part, here_c, here_j);
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

double bev_worth_j_per_k(const bev_points *curve, double temperature_c) {
  const double cooler_j = bev_interpolated(curve->temperature_c, curve->energy_j, curve->count,
                                           temperature_c - 0.5 * SLOPE_K);
  const double warmer_j = bev_interpolated(curve->temperature_c, curve->energy_j, curve->count,
                                           temperature_c + 0.5 * SLOPE_K);
  return bev_maximum(cooler_j - warmer_j, 0.0) / SLOPE_K;
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
  if (!bev_are_numbers(curves->heated.temperature_c, curves->heated.count)
      || !bev_are_numbers(curves->heated.energy_j, curves->heated.count)
      || !bev_are_numbers(curves->unheated.temperature_c, curves->unheated.count)
      || !bev_are_numbers(curves->unheated.energy_j, curves->unheated.count)) {
    return BEV_NOT_FINITE;
  }
  bev_status status = take_cheaper(curves, bands);
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
  double *room[16];
  for (int32_t n = 0; n < 16; n++) {
    room[n] = &memory[n * BEV_CURVE_POINTS];
  }
  const bev_curves curves = {
      {0, room[0], room[1]}, {0, room[2], room[3]}, {0, room[4], room[5]}, {0, room[6], room[7]},
      room[8], room[9], room[10], {0, room[11], room[12], room[13], room[14], room[15], -INFINITY}};
  return curves;
}
