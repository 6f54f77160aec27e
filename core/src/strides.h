/* SPDX-License-Identifier: Apache-2.0 */
/* The map of one stride of a trip, from start to end temperatures: bev_preheat.planning.strides. */
#ifndef BEV_PREHEAT_CORE_STRIDES_H_
#define BEV_PREHEAT_CORE_STRIDES_H_

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#include "bev_preheat_core/core.h"
#include "bev_preheat_core_generated/constants.h"

/*
 * The `count` start temperatures of a stride, and for each the end temperature [deg C] and the energy taken [J], with
 * free heating only and with full heating. The stride's power is delivered unheated from `needed_c` on; -inf: always.
 */
typedef struct {
  int32_t count;
  double *start_c;
  double *unheated_end_c;
  double *unheated_j;
  double *heated_end_c;
  double *heated_j;
  double needed_c;
} bev_stride_map;

/* Compute stride m on the points of the grid that it needs; the grid has more than BEV_COARSE points. */
bev_status bev_map_stride(const bev_vehicle *vehicle, const bev_strides *inputs, int32_t m,
                          const bev_curve_range *range, bev_stride_map *map);

#endif /* BEV_PREHEAT_CORE_STRIDES_H_ */
