/* SPDX-License-Identifier: Apache-2.0 */
/* Whether a kelvin on arrival costs less in other steps, with arguments already checked. */
#ifndef BEV_PREHEAT_CORE_PRICES_H_
#define BEV_PREHEAT_CORE_PRICES_H_

#include "bev_preheat_core/core.h"

/*
 * BEV_OK, or BEV_CHEAPER_ELSEWHERE if heating in other steps than those of a run that is heated from one instant on
 * may save charge: bev_preheat.planning.one_interval.is_cheaper_elsewhere.
 */
bev_status bev_costs_least(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                           const double *temperature_c, const double *heater_w);

#endif /* BEV_PREHEAT_CORE_PRICES_H_ */
