/* SPDX-License-Identifier: Apache-2.0 */
/* Heat a little earlier than a plan needs: bev_preheat.planning.uncertainty_margin, heat at once, no active limit. */
#ifndef BEV_PREHEAT_CORE_UNCERTAINTY_MARGIN_H_
#define BEV_PREHEAT_CORE_UNCERTAINTY_MARGIN_H_

#include <math.h>
#include <stddef.h>

#include "means.h"

/* A run heated from one instant on that arrives above its target; it is overwritten by the new run. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  double target_c;
  double *soc;
  double *temperature_c;
  double *heater_w;
  bev_means means;
} bev_heated_run;

/*
 * New heating of a run: the first step that changes (`steps`: no step does), and the instants between which it is
 * heated now [s]. `start_s` is NaN if it is not heated, `end_s` if the end is not within the trip.
 */
typedef struct {
  int32_t first;
  double start_s;
  double end_s;
} bev_early_interval;

/* Whether an uncertainty margin (null: no margin) has only finite numbers. */
static inline int bev_is_uncertainty_margin(const bev_uncertainty_margin *margin) {
  return margin == NULL
      || (isfinite(margin->lead_k) && isfinite(margin->least_pause_s)
          && isfinite(margin->least_heating_s));
}

/* The run with its last heating interval begun as early as `margin` asks, ended once it is enough. */
bev_status bev_switch_on_early(const bev_heated_run *run, const bev_uncertainty_margin *margin,
                               bev_early_interval *interval);

#endif /* BEV_PREHEAT_CORE_UNCERTAINTY_MARGIN_H_ */
