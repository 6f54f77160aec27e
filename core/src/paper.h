/* SPDX-License-Identifier: Apache-2.0 */
/* The paper's Algorithms 1 and 2: bev_preheat.planning.paper. */
#ifndef BEV_PREHEAT_CORE_PAPER_H_
#define BEV_PREHEAT_CORE_PAPER_H_

#include "bev_preheat_core/core.h"

/*
 * The run by Euler's method from soc[0] and temperature_c[0] on, heated from the instant [s] at which the
 * unheated run meets the backward run from the target; NaN if the target is met without heating. Writes the run,
 * the heater power in each step [W], and the instant.
 */
bev_status bev_run_paper(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                         double *soc, double *temperature_c, double *heater_w, double *instant_s);

/*
 * BEV_LIMITED if a run has a power deficit, or leaves the range of charge or temperature that the model describes:
 * bev_preheat.planning.no_regret does not accept such a run unchanged. Writes the limits along the run [W].
 */
bev_status bev_is_driven_as_planned(const bev_vehicle *vehicle, const bev_trip *trip,
                                    const double *soc, const double *temperature_c,
                                    const double *heater_w, double *least_w, double *most_w);

#endif /* BEV_PREHEAT_CORE_PAPER_H_ */
