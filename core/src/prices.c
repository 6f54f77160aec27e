/* SPDX-License-Identifier: Apache-2.0 */
/* What a kelvin on arrival costs in each step: bev_preheat.planning.prices. */
#include "prices.h"

#include "checks.h"
#include "steps_of_model.h"

/* Slopes of the model's rates are taken over these differences. */
#define SOC_DIFFERENCE 1e-4
#define TEMPERATURE_DIFFERENCE_K 0.1

/* A number for the charge and one for the warmth: rates, slopes, or what they are worth on arrival. */
typedef struct {
  double charge;
  double warmth;
} charge_warmth;

/* The rates in a step under a heater power. */
static charge_warmth rates_at(const bev_vehicle *vehicle, const bev_inputs *idle, double soc,
                              double temperature_c, double heater_w) {
  double result[3];
  bev_rates(vehicle, BEV_AS_ARRAYS, soc, temperature_c, idle->power_w + heater_w,
            idle->variance_w2, idle->heat_w + vehicle->heater_efficiency * heater_w,
            idle->leakage_w_per_k, result);
  const charge_warmth rates = {result[0], result[1]};
  return rates;
}

/* By how much a step ends otherwise, for each unit of a difference in what it starts with. */
static charge_warmth slope_of(charge_warmth here, charge_warmth there, double difference,
                              double duration_s) {
  const charge_warmth slope = {(there.charge - here.charge) / difference * duration_s,
                               (there.warmth - here.warmth) / difference * duration_s};
  return slope;
}

/* What charge and warmth before a step are worth, from what they are after it. */
static charge_warmth before(charge_warmth worth, charge_warmth by_charge, charge_warmth by_warmth) {
  const charge_warmth first = {
      worth.charge * by_charge.charge + worth.warmth * by_charge.warmth,
      worth.charge * by_warmth.charge + worth.warmth * by_warmth.warmth};
  const charge_warmth second = {
      first.charge * by_charge.charge + first.warmth * by_charge.warmth,
      first.charge * by_warmth.charge + first.warmth * by_warmth.warmth};
  const charge_warmth changed = {worth.charge + first.charge + 0.5 * second.charge,
                                 worth.warmth + first.warmth + 0.5 * second.warmth};
  return changed;
}

/* What a difference in the middle of a step makes on arrival, from what it is worth at both ends. */
static double in_the_middle(charge_warmth after, charge_warmth earlier, charge_warmth by_power) {
  return 0.5 * (after.charge + earlier.charge) * by_power.charge
      + 0.5 * (after.warmth + earlier.warmth) * by_power.warmth;
}

/* What charge and warmth are worth on arrival, in warmth and in charge, at the end of a step. */
typedef struct {
  charge_warmth warmth;
  charge_warmth charge;
} worths;

static const worths ON_ARRIVAL = {{0.0, 1.0}, {1.0, 0.0}};

/* What a watt in step k makes on arrival, from what charge and warmth after it are worth there; then before it. */
static bev_status price_of_step(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                                const double *temperature_c, double heater_w, int32_t k,
                                worths *worth, bev_price *price) {
  const bev_inputs idle = bev_inputs_of(vehicle, trip, k, NULL, NULL);
  const double duration_s = idle.duration_s;
  const double limit_w = trip->heater_limit_w[k];
  const double middle_soc = 0.5 * (soc[k] + soc[k + 1]);
  const double middle_c = 0.5 * (temperature_c[k] + temperature_c[k + 1]);
  if (!bev_are_finite(&idle) || !isfinite(limit_w) || !isfinite(heater_w) || !isfinite(middle_soc)
      || !isfinite(middle_c)) {
    return BEV_BAD_INPUT;
  }
  const charge_warmth here = rates_at(vehicle, &idle, middle_soc, middle_c, heater_w);
  const charge_warmth by_charge =
      slope_of(here, rates_at(vehicle, &idle, middle_soc + SOC_DIFFERENCE, middle_c, heater_w),
               SOC_DIFFERENCE, duration_s);
  const charge_warmth by_warmth = slope_of(
      here, rates_at(vehicle, &idle, middle_soc, middle_c + TEMPERATURE_DIFFERENCE_K, heater_w),
      TEMPERATURE_DIFFERENCE_K, duration_s);
  /* From no heating to all there is: a step is heated or not. */
  const charge_warmth by_power = slope_of(
      rates_at(vehicle, &idle, middle_soc, middle_c, 0.0),
      rates_at(vehicle, &idle, middle_soc, middle_c, limit_w), limit_w > 0.0 ? limit_w : 1.0,
      duration_s);
  const worths earlier = {before(worth->warmth, by_charge, by_warmth),
                          before(worth->charge, by_charge, by_warmth)};
  price->warmth_k_per_w = in_the_middle(worth->warmth, earlier.warmth, by_power);
  price->charge_per_w = -in_the_middle(worth->charge, earlier.charge, by_power);
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
