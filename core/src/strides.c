/* SPDX-License-Identifier: Apache-2.0 */
/* The map of each stride of a trip, from start to end temperatures: bev_preheat.planning.strides. */
#include "strides.h"

#include "bev_preheat_core_generated/constants.h"
#include <stdbool.h>

#include "checks.h"
#include "curve_arrays.h"
#include "sorted.h"
#include "steps_of_model.h"

/* Number of temperatures computed side by side. */
#define BLOCK BEV_BLOCK

/*
 * One stride and its start: temperatures, with the circuit and its limits there; then its middle: temperatures,
 * powers and circuit.
 */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_strides *inputs;
  int32_t m;
  double penalty;
  int32_t count;
  double start_c[BLOCK];
  double voltage_v[BLOCK];
  double resistance_ohm[BLOCK];
  double surplus_w[BLOCK];
  double deficit_w[BLOCK];
  double room_w[BLOCK];
  double terminal_w[BLOCK];
  double heat_w[BLOCK];
  double middle_soc[BLOCK];
  double middle_c[BLOCK];
  double middle_v[BLOCK];
  double middle_ohm[BLOCK];
} stride_block;

static void find_margins(stride_block *block) {
  const bev_vehicle *vehicle = block->vehicle;
  const bev_strides *inputs = block->inputs;
  const int32_t m = block->m;
  const double limit_w = inputs->heater_limit_w[m];
  if (inputs->is_limited[m] == 0u) {
    for (int32_t n = 0; n < block->count; n++) {
      block->surplus_w[n] = 0.0;
      block->deficit_w[n] = 0.0;
      block->room_w[n] = limit_w;
    }
    return;
  }
  const double power_w = inputs->idle_power_w[m];
  const double variance_w2 = inputs->power_variance_w2[m];
  const double regenerated_w = bev_maximum(-inputs->propulsion_w[m], 0.0);
  double charge_w[BLOCK];
  double discharge_w[BLOCK];
  bev_curve_at_charge(&vehicle->charge_power_limit, inputs->soc[m], block->count, block->start_c,
                      charge_w);
  bev_curve_at_charge(&vehicle->discharge_power_limit, inputs->soc[m], block->count,
                      block->start_c, discharge_w);
  for (int32_t n = 0; n < block->count; n++) {
    double limits_w[2];
    bev_terminal_limits_of_circuit(vehicle, BEV_AS_ARRAYS, block->voltage_v[n],
                                   block->resistance_ohm[n], charge_w[n], discharge_w[n],
                                   variance_w2, limits_w);
    block->surplus_w[n] = bev_minimum(bev_maximum(limits_w[0] - power_w, 0.0), regenerated_w);
    block->deficit_w[n] = bev_maximum(power_w - limits_w[1], 0.0);
    block->room_w[n] = bev_minimum(bev_maximum(limits_w[1] - power_w, 0.0), limit_w);
  }
}

/*
 * The ends of a stride [deg C] and the energy it takes [J] under heater powers [W]: bit-identical to steps of
 * bev_midpoint; the circuit at their beginning is known.
 */
static bev_status drive_stride(stride_block *block, const double *heater_w, double *end_c,
                               double *energy_j) {
  const bev_vehicle *vehicle = block->vehicle;
  const bev_strides *inputs = block->inputs;
  const int32_t m = block->m;
  const int32_t count = block->count;
  const double duration_s = inputs->duration_s[m];
  const double half_s = 0.5 * duration_s;
  const double idle_power_w = inputs->idle_power_w[m];
  const double variance_w2 = inputs->power_variance_w2[m];
  const double idle_heat_w = inputs->idle_heat_w[m];
  const double leakage_w_per_k = inputs->leakage_w_per_k[m];
  const double soc = inputs->soc[m];
  for (int32_t n = 0; n < count; n++) {
    double rates[3];
    const double brake_w = block->surplus_w[n] - bev_minimum(heater_w[n], block->surplus_w[n]);
    block->terminal_w[n] = idle_power_w + heater_w[n] + brake_w;
    block->heat_w[n] = bev_heat_under_w(vehicle, idle_heat_w, heater_w[n], brake_w);
    bev_rates_of_circuit(vehicle, BEV_AS_ARRAYS, block->voltage_v[n], block->resistance_ohm[n],
                         block->start_c[n], block->terminal_w[n], variance_w2, block->heat_w[n],
                         leakage_w_per_k, rates);
    block->middle_soc[n] = soc + half_s * rates[0];
    block->middle_c[n] = block->start_c[n] + half_s * rates[1];
  }
  bev_curve_over(&vehicle->open_circuit_voltage, count, block->middle_soc, block->middle_c,
                 block->middle_v);
  bev_curve_over(&vehicle->resistance, count, block->middle_soc, block->middle_c,
                 block->middle_ohm);
  for (int32_t n = 0; n < count; n++) {
    double rates[3];
    bev_rates_of_circuit(vehicle, BEV_AS_ARRAYS, block->middle_v[n], block->middle_ohm[n],
                         block->middle_c[n], block->terminal_w[n], variance_w2, block->heat_w[n],
                         leakage_w_per_k, rates);
    end_c[n] = block->start_c[n] + duration_s * rates[1];
    energy_j[n] =
        duration_s * (block->terminal_w[n] + rates[2] + block->penalty * block->deficit_w[n]);
  }
  return bev_are_numbers(end_c, count) && bev_are_numbers(energy_j, count) ? BEV_OK
                                                                          : BEV_NOT_FINITE;
}

/* The points `first` ... of the map, from the temperatures of the block. */
static bev_status map_block(stride_block *block, int32_t first, bev_stride_map *map) {
  const double limit_w = block->inputs->heater_limit_w[block->m];
  double free_w[BLOCK];
  double all_w[BLOCK];
  bool is_heated = false;
  for (int32_t n = 0; n < block->count; n++) {
    free_w[n] = bev_minimum(limit_w, block->surplus_w[n]);
    all_w[n] = bev_maximum(block->room_w[n], free_w[n]);
    is_heated = is_heated || all_w[n] != free_w[n];
  }
  bev_status status =
      drive_stride(block, free_w, &map->unheated_end_c[first], &map->unheated_j[first]);
  if (status == BEV_OK && is_heated) {
    status = drive_stride(block, all_w, &map->heated_end_c[first], &map->heated_j[first]);
  } else {
    for (int32_t n = first; n < first + block->count; n++) {
      map->heated_end_c[n] = map->unheated_end_c[n];
      map->heated_j[n] = map->unheated_j[n];
    }
  }
  return status;
}

/* Make values rise: far beyond its limits a warmer battery may end colder, but a map must rise. */
static void make_rising(double *values, int32_t count) {
  for (int32_t n = 1; n < count; n++) {
    values[n] = bev_maximum(values[n], values[n - 1]);
  }
}

bev_status bev_map_stride(const bev_vehicle *vehicle, const bev_strides *inputs, int32_t m,
                          const bev_curve_range *range, bev_stride_map *map) {
  const int32_t grid_points = range->grid_points;
  const double *grid_c = range->grid_c;
  const int32_t every = inputs->is_limited[m] != 0u && range->is_first_look == 0 ? 1 : BEV_COARSE;
  const int32_t below = bev_number_below(grid_c, grid_points, inputs->coldest_c[m]) - 1;
  const int32_t latest = grid_points - 1 - every;
  const int32_t first = below > latest ? latest : (below > 0 ? below : 0);
  int32_t last = bev_number_below(grid_c, grid_points, inputs->warmest_c[m]) + 1;
  last = last < first + 2 ? first + 2 : (last > grid_points ? grid_points : last);
  const int32_t wanted = (last - 1 - first + every - 1) / every;
  const int32_t possible = (grid_points - 1 - first) / every;
  map->count = (wanted < possible ? wanted : possible) + 1;
  map->needed_c = -INFINITY;
  stride_block block;
  block.vehicle = vehicle;
  block.inputs = inputs;
  block.m = m;
  block.penalty = range->penalty;
  double before_w = 0.0;
  for (int32_t from = 0; from < map->count; from += BLOCK) {
    block.count = map->count - from < BLOCK ? map->count - from : BLOCK;
    for (int32_t n = 0; n < block.count; n++) {
      block.start_c[n] = grid_c[first + (from + n) * every];
      map->start_c[from + n] = block.start_c[n];
    }
    bev_curve_at_charge(&vehicle->open_circuit_voltage, inputs->soc[m], block.count, block.start_c,
                        block.voltage_v);
    bev_curve_at_charge(&vehicle->resistance, inputs->soc[m], block.count, block.start_c,
                        block.resistance_ohm);
    find_margins(&block);
    const bev_status status = map_block(&block, from, map);
    if (status != BEV_OK) {
      return status;
    }
    for (int32_t n = from; n < from + block.count; n++) {
      const double deficit_w = block.deficit_w[n - from];
      /* The last temperature with a deficit counts. */
      if (deficit_w > 0.0) {
        const int32_t before = n > 0 ? n - 1 : 0;
        const double fallen_w = (n > 0 ? before_w : deficit_w) - deficit_w;
        const double slope =
            fallen_w / bev_maximum(map->start_c[n] - map->start_c[before], BEV_LEAST_WIDTH_K);
        map->needed_c = map->start_c[n] + (slope > 0.0 ? deficit_w / slope : 0.0);
      }
      before_w = deficit_w;
    }
  }
  make_rising(map->unheated_end_c, map->count);
  make_rising(map->heated_end_c, map->count);
  return BEV_OK;
}
