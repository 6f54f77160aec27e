/* SPDX-License-Identifier: Apache-2.0 */
/* One switching instant within limits: bev_preheat.planning.limited_switch, which documents the reasons. */
#ifndef BEV_PREHEAT_CORE_LIMITED_SWITCH_H_
#define BEV_PREHEAT_CORE_LIMITED_SWITCH_H_

#include "trajectory.h"

/* Goal of one heating interval: the target [deg C], when it ends [s], a run within limits. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  double target_c;
  double off_s;
  const bev_trajectory *planned;
} bev_limited_interval;

/*
 * The run within limits that heats from one instant on and arrives at the target, written to `run`: the unheated run
 * if it reaches the target, and the run heated all the way if even that is not enough. `watched` is as of
 * bev_drive_as_planned; `memory` has 11 * steps + 4 doubles.
 */
bev_status bev_switch_within_limits(const bev_limited_interval *interval, bev_trajectory *run,
                                    uint8_t *watched, double *memory);

#endif /* BEV_PREHEAT_CORE_LIMITED_SWITCH_H_ */
