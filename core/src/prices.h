/* SPDX-License-Identifier: Apache-2.0 */
/* Cost of a kelvin on arrival in each step, with arguments already checked. */
#ifndef BEV_PREHEAT_CORE_PRICES_H_
#define BEV_PREHEAT_CORE_PRICES_H_

#include "bev_preheat_core/core.h"

/* Effect on arrival of a watt of the heater in a step: gain of warmth [K/W], loss of charge [1/W]. */
typedef struct {
  double warmth_k_per_w;
  double charge_per_w;
} bev_price;

/* Energy of the whole charge [Wh] at the voltage of a state. */
double bev_whole_charge_wh(const bev_vehicle *vehicle, double soc, double temperature_c);

/* As bev_find_prices. */
bev_status bev_prices_along(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                            const double *temperature_c, const double *heater_w,
                            double *warmth_k_per_w, double *charge_per_w);

/*
 * Upper bound of the charge that heating elsewhere can save, as far as the prices do not change. The run is heated
 * from one instant on; each cheaper step is compared with the dearest heated step.
 */
bev_status bev_most_saving(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                           const double *temperature_c, const double *heater_w, double *saving);

#endif /* BEV_PREHEAT_CORE_PRICES_H_ */
