/* SPDX-License-Identifier: Apache-2.0 */
/* Whether a plan heats with surplus that is of no use: bev_preheat.planning.free_heat. */
#ifndef BEV_PREHEAT_CORE_SURPLUS_CEILING_H_
#define BEV_PREHEAT_CORE_SURPLUS_CEILING_H_

#include <stdbool.h>

#include "trajectory.h"

/* Whether free heat, if there is any, leads beyond the target. */
bool bev_is_too_warm(const bev_trip *trip, double target_c, const bev_trajectory *trajectory);

/* Whether the heat that a run saves is worth its losses of charge, warmth and power against another run. */
bev_status bev_is_as_useful(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                            const bev_trajectory *bounded, const bev_trajectory *free_run, bool *is_so);

#endif /* BEV_PREHEAT_CORE_SURPLUS_CEILING_H_ */
