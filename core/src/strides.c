/* SPDX-License-Identifier: Apache-2.0 */
/* Where each stride of a trip leads from each temperature: bev_preheat.planning.strides. */
#include "strides.h"

#include "checks.h"
#include "sorted.h"
#include "steps_of_model.h"

#define LEAST_WIDTH_K 1e-9

/* One stride from one temperature: what its limits leave. */
typedef struct {
  double surplus_w;
  double lacking_w;
  double room_w;
} margins;

static margins margins_of(const bev_vehicle *vehicle, const bev_strides *inputs, int32_t m,
                          double start_c) {
  const double limit_w = inputs->heater_limit_w[m];
  margins found = {0.0, 0.0, limit_w};
  if (inputs->is_limited[m] != 0) {
    const double power_w = inputs->idle_power_w[m];
    double limits_w[2];
    bev_terminal_limits(vehicle, BEV_AS_ARRAYS, inputs->soc[m], start_c,
                        inputs->power_variance_w2[m], limits_w);
    found.surplus_w = bev_minimum(bev_maximum(limits_w[0] - power_w, 0.0),
                                  bev_maximum(-inputs->propulsion_w[m], 0.0));
    found.lacking_w = bev_maximum(power_w - limits_w[1], 0.0);
    found.room_w = bev_minimum(bev_maximum(limits_w[1] - power_w, 0.0), limit_w);
  }
  return found;
}

/* The end of a stride [deg C] and what it takes [J] under a heater power [W]. */
static bev_status drive(const bev_vehicle *vehicle, const bev_strides *inputs, int32_t m,
                        double start_c, const margins *margin, double heater_w, double penalty,
                        double *end_c, double *energy_j) {
  const double brake_w = margin->surplus_w - bev_minimum(heater_w, margin->surplus_w);
  const double duration_s = inputs->duration_s[m];
  const double terminal_w = inputs->idle_power_w[m] + heater_w + brake_w;
  double result[4];
  bev_midpoint(
      vehicle, BEV_AS_ARRAYS, inputs->soc[m], start_c, duration_s, terminal_w,
      inputs->power_variance_w2[m],
      inputs->idle_heat_w[m] + vehicle->heater_efficiency * heater_w
          - vehicle->heat_share * brake_w,
      inputs->leakage_w_per_k[m], result);
  *end_c = result[1];
  *energy_j = duration_s * (terminal_w + result[3] + penalty * margin->lacking_w);
  return isfinite(*end_c) && isfinite(*energy_j) ? BEV_OK : BEV_NOT_FINITE;
}

bev_status bev_map_stride(const bev_vehicle *vehicle, const bev_strides *inputs, int32_t m,
                          const bev_curve_range *range, bev_stride_map *map) {
  const int32_t grid_points = range->grid_points;
  const double *grid_c = range->grid_c;
  const double penalty = range->penalty;
  const double limit_w = inputs->heater_limit_w[m];
  const int32_t every = inputs->is_limited[m] != 0 && range->is_first_look == 0 ? 1 : BEV_COARSE;
  const int32_t below = bev_number_below(grid_c, grid_points, inputs->coldest_c[m]) - 1;
  const int32_t latest = grid_points - 1 - every;
  const int32_t first = below > latest ? latest : (below > 0 ? below : 0);
  int32_t last = bev_number_below(grid_c, grid_points, inputs->warmest_c[m]) + 1;
  last = last < first + 2 ? first + 2 : (last > grid_points ? grid_points : last);
  const int32_t wanted = (last - 1 - first + every - 1) / every;
  const int32_t possible = (grid_points - 1 - first) / every;
  double before_w = 0.0;
  map->count = (wanted < possible ? wanted : possible) + 1;
  map->needed_c = -INFINITY;
  for (int32_t n = 0; n < map->count; n++) {
    const double start_c = grid_c[first + n * every];
    map->start_c[n] = start_c;
    const margins margin = margins_of(vehicle, inputs, m, start_c);
    const double free_w = bev_minimum(limit_w, margin.surplus_w);
    const double all_w = bev_maximum(margin.room_w, free_w);
    bev_status status = drive(vehicle, inputs, m, start_c, &margin, free_w, penalty,
                              &map->unheated_end_c[n], &map->unheated_j[n]);
    map->heated_end_c[n] = map->unheated_end_c[n];
    map->heated_j[n] = map->unheated_j[n];
    if (status == BEV_OK && all_w != free_w) {
      status = drive(vehicle, inputs, m, start_c, &margin, all_w, penalty, &map->heated_end_c[n],
                     &map->heated_j[n]);
    }
    if (status != BEV_OK) {
      return status;
    }
    /* A battery far beyond its limits may end the colder the warmer it was; a map only rises. */
    if (n > 0) {
      map->unheated_end_c[n] =
          bev_maximum(map->unheated_end_c[n], map->unheated_end_c[n - 1]);
      map->heated_end_c[n] = bev_maximum(map->heated_end_c[n], map->heated_end_c[n - 1]);
    }
    /* Of the temperatures at which something is lacking the last one counts. */
    if (margin.lacking_w > 0.0) {
      const int32_t before = n > 0 ? n - 1 : 0;
      const double fallen_w = (n > 0 ? before_w : margin.lacking_w) - margin.lacking_w;
      const double slope =
          fallen_w / bev_maximum(start_c - map->start_c[before], LEAST_WIDTH_K);
      map->needed_c = start_c + (slope > 0.0 ? margin.lacking_w / slope : 0.0);
    }
    before_w = margin.lacking_w;
  }
  return BEV_OK;
}
