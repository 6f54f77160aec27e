/* SPDX-License-Identifier: Apache-2.0 */
/* The paper's Algorithms 1 and 2: bev_preheat.planning.paper. */
#ifndef BEV_PREHEAT_CORE_PAPER_H_
#define BEV_PREHEAT_CORE_PAPER_H_

#include "bev_preheat_core/core.h"

/*
 * The run by Euler's method from soc[0] and temperature_c[0] on, heated from the instant [s] at which the
 * unheated run meets the one backward from the target; NaN where the target is met without. Written are the
 * run, what the heater takes in each step [W], and the instant.
 */
bev_status bev_run_paper(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                         double *soc, double *temperature_c, double *heater_w, double *instant_s);

/*
 * BEV_LIMITED where a run lacks power, or leaves the charge or the heat that the model describes: what
 * bev_preheat.planning.no_regret does not take as it is. The limits along it are written [W].
 */
bev_status bev_is_driven_as_planned(const bev_vehicle *vehicle, const bev_trip *trip,
                                    const double *soc, const double *temperature_c,
                                    const double *heater_w, double *least_w, double *most_w);

#endif /* BEV_PREHEAT_CORE_PAPER_H_ */
