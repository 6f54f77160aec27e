/* SPDX-License-Identifier: Apache-2.0 */
/* Check whether a run that ignores limits keeps them, and the resulting entries of a plan. */
#ifndef BEV_PREHEAT_CORE_LIMITS_OF_RUN_H_
#define BEV_PREHEAT_CORE_LIMITS_OF_RUN_H_

#include "bev_preheat_core/core.h"

/* The run to check, and its limits on the terminal power [W], which are written. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  const double *soc;
  const double *temperature_c;
  const double *heater_w;
  double *least_w;
  double *most_w;
} bev_seen_run;

/* BEV_OK if a run keeps all limits of the battery from step `first` on, BEV_LIMITED if not. */
bev_status bev_keeps_limits(const bev_seen_run *run, int32_t first);

/* Write the least charge of a run whose limits are known, which of its steps are heated, and what for. */
bev_status bev_describe_run(const bev_seen_run *run, bev_switch_plan *plan);

#endif /* BEV_PREHEAT_CORE_LIMITS_OF_RUN_H_ */
