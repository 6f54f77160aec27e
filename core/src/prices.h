/* SPDX-License-Identifier: Apache-2.0 */
/* What a kelvin on arrival costs in each step, of arguments that are checked. */
#ifndef BEV_PREHEAT_CORE_PRICES_H_
#define BEV_PREHEAT_CORE_PRICES_H_

#include "bev_preheat_core/core.h"

/* As bev_find_prices. */
bev_status bev_prices_along(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                            const double *temperature_c, const double *heater_w,
                            double *warmth_k_per_w, double *charge_per_w);

#endif /* BEV_PREHEAT_CORE_PRICES_H_ */
