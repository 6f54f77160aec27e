/* SPDX-License-Identifier: Apache-2.0 */
/* A trip in strides, and thresholds of its steps from those of the strides. */
#ifndef BEV_PREHEAT_CORE_TRIP_STRIDES_H_
#define BEV_PREHEAT_CORE_TRIP_STRIDES_H_

#include "trajectory.h"

/* Number of columns of bev_strides that have one value for each stride. */
#define BEV_STRIDE_COLUMNS 11

/* Room for a trip in strides: its columns, the first step of each, and whether limits matter. */
typedef struct {
  double *columns[BEV_STRIDE_COLUMNS];
  double *coldest_c;
  double *warmest_c;
  /* As doubles, so that one memory is enough; one more than there are strides, the last is the arrival. */
  double *first_step;
  uint8_t *is_limited;
} bev_stride_room;

/* Purpose of the strides: whether a first look, from which the run may differ greatly; the target [deg C]. */
typedef struct {
  int32_t is_first;
  double target_c;
} bev_look;

/* The strides of a trip along a run: bev_preheat.planning.strides.make_strides. */
bev_strides bev_make_strides(const bev_vehicle *vehicle, const bev_trip *trip,
                             const bev_watch *watch, const bev_trajectory *trajectory,
                             const bev_acceptance_loss *loss, const bev_look *look,
                             const bev_stride_room *room);

/* Thresholds of steps from those of strides, linearly interpolated: arrays of steps * BEV_BANDS. */
void bev_bands_in_steps(const bev_strides *strides, const bev_stride_room *room, int32_t steps,
                        const double *bands_c, double *floor_c, double *low_c, double *high_c);

#endif /* BEV_PREHEAT_CORE_TRIP_STRIDES_H_ */
