/* SPDX-License-Identifier: Apache-2.0 */
/* Cost of a kelvin on arrival in each step: bev_preheat.planning.prices. */
#include "prices.h"

#include "checks.h"
#include "slopes.h"

/* Value on arrival of charge and warmth at the end of a step, in warmth and in charge. */
typedef struct {
  bev_charge_warmth warmth;
  bev_charge_warmth charge;
} worths;

static const worths ON_ARRIVAL = {{0.0, 1.0}, {1.0, 0.0}};

/* Effect on arrival of a watt in step k. `worth`: value of charge and warmth after the step, then before it. */
static bev_status price_of_step(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                                const double *temperature_c, double heater_w, int32_t k,
                                worths *worth, bev_price *price) {
  const bev_middle middle = bev_middle_of(vehicle, trip, soc, temperature_c, heater_w, 0.0, k);
  if (!bev_is_middle(&middle)) {
    return BEV_BAD_INPUT;
  }
  const bev_slopes slopes = bev_slopes_of_model(&middle);
  const worths earlier = {bev_worth_before(worth->warmth, &slopes),
                          bev_worth_before(worth->charge, &slopes)};
  price->warmth_k_per_w = bev_effect(worth->warmth, earlier.warmth, slopes.by_power);
  price->charge_per_w = -bev_effect(worth->charge, earlier.charge, slopes.by_power);
  *worth = earlier;
  return BEV_OK;
}

bev_status bev_prices_along(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                            const double *temperature_c, const double *heater_w,
                            double *warmth_k_per_w, double *charge_per_w) {
  worths worth = ON_ARRIVAL;
  for (int32_t k = trip->steps - 1; k >= 0; k--) {
    bev_price price;
    const bev_status status =
        price_of_step(vehicle, trip, soc, temperature_c, heater_w[k], k, &worth, &price);
    if (status != BEV_OK) {
      return status;
    }
    warmth_k_per_w[k] = price.warmth_k_per_w;
    charge_per_w[k] = price.charge_per_w;
  }
  return BEV_OK;
}

double bev_whole_charge_wh(const bev_vehicle *vehicle, double soc, double temperature_c) {
  return vehicle->capacity_ah
      * bev_at(&vehicle->open_circuit_voltage, BEV_EXACT, soc, temperature_c);
}

bev_status bev_most_saving(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                           const double *temperature_c, const double *heater_w, double *saving) {
  worths worth = ON_ARRIVAL;
  double dearest_per_k = -INFINITY;
  *saving = 0.0;
  for (int32_t k = trip->steps - 1; k >= 0; k--) {
    bev_price price;
    const bev_status status =
        price_of_step(vehicle, trip, soc, temperature_c, heater_w[k], k, &worth, &price);
    if (status != BEV_OK) {
      return status;
    }
    if (price.warmth_k_per_w > 0.0) {
      const double per_k = price.charge_per_w / price.warmth_k_per_w;
      const double unheated_w = trip->heater_limit_w[k] - heater_w[k];
      if (unheated_w > 0.0 && per_k < dearest_per_k) {
        *saving += (dearest_per_k - per_k) * price.warmth_k_per_w * unheated_w;
      }
      if (heater_w[k] > 0.0) {
        dearest_per_k = bev_maximum(dearest_per_k, per_k);
      }
    }
  }
  return BEV_OK;
}

bev_status bev_find_prices(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                           const double *temperature_c, const double *heater_w,
                           double *warmth_k_per_w, double *charge_per_w) {
  const bev_status status = bev_checked(vehicle, trip, 0);
  if (status != BEV_OK) {
    return status;
  }
  if (soc == NULL || temperature_c == NULL || heater_w == NULL || warmth_k_per_w == NULL
      || charge_per_w == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  return bev_prices_along(vehicle, trip, soc, temperature_c, heater_w, warmth_k_per_w,
                          charge_per_w);
}
