/* SPDX-License-Identifier: Apache-2.0 */
/* What a kelvin on arrival costs in each step, of arguments that are checked. */
#ifndef BEV_PREHEAT_CORE_PRICES_H_
#define BEV_PREHEAT_CORE_PRICES_H_

#include "bev_preheat_core/core.h"

/* What a watt of the heater in a step makes on arrival: how much more warmth [K/W], and less charge [1/W]. */
typedef struct {
  double warmth_k_per_w;
  double charge_per_w;
} bev_price;

/* What the whole charge holds [Wh] at the voltage of a state. */
double bev_whole_charge_wh(const bev_vehicle *vehicle, double soc, double temperature_c);

/* As bev_find_prices. */
bev_status bev_prices_along(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                            const double *temperature_c, const double *heater_w,
                            double *warmth_k_per_w, double *charge_per_w);

/*
 * More charge than heating elsewhere can save, as far as the prices stay what they are: of a run that is heated
 * from one instant on, to whose dearest heated step each cheaper one is compared.
 */
bev_status bev_most_saving(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                           const double *temperature_c, const double *heater_w, double *saving);

#endif /* BEV_PREHEAT_CORE_PRICES_H_ */
