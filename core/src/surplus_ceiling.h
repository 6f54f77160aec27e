/* SPDX-License-Identifier: Apache-2.0 */
/* Whether a plan heats with surplus that is of no use: bev_preheat.planning.free_heat. */
#ifndef BEV_PREHEAT_CORE_SURPLUS_CEILING_H_
#define BEV_PREHEAT_CORE_SURPLUS_CEILING_H_

#include <stdbool.h>

#include "courses.h"

/* So many ceilings are tried. */
#define BEV_MOST_CEILINGS 3
/* The first one aims this far above the target; each next one higher by this factor of the miss. */
#define BEV_AIM_K 0.1
#define BEV_MORE_AIM 1.2
/* One that is nowhere higher than the one before by more than this is not tried. */
#define BEV_HIGHER_K 0.01

/* Whether free heat, if there is any, leads beyond the target. */
bool bev_is_too_warm(const bev_trip *trip, double target_c, const bev_course *course);

/* Whether the heat that a run saves is worth its losses of charge, warmth and power against another run. */
bev_status bev_is_as_useful(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                            const bev_course *bounded, const bev_course *free_run, bool *is_so);

#endif /* BEV_PREHEAT_CORE_SURPLUS_CEILING_H_ */
