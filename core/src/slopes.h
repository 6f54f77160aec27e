/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Sensitivities of the end of a step of a run, and their value on arrival: Slopes of bev_preheat.planning.one_interval.
 */
#ifndef BEV_PREHEAT_CORE_SLOPES_H_
#define BEV_PREHEAT_CORE_SLOPES_H_

#include "bev_preheat_core_generated/constants.h"
#include "steps_of_model.h"

/* A number for the charge and one for the warmth: rates, slopes, or values on arrival. */
typedef struct {
  double charge;
  double warmth;
} bev_charge_warmth;

/* For more charge and for a kelvin more at the start of a step, and for a watt of the heater in it. */
typedef struct {
  bev_charge_warmth by_charge;
  bev_charge_warmth by_warmth;
  bev_charge_warmth by_power;
} bev_slopes;

/* A step of a run: its inputs without heater and brake, its state in the middle, heater and brake [W]. */
typedef struct {
  const bev_vehicle *vehicle;
  bev_inputs idle;
  double limit_w;
  double soc;
  double temperature_c;
  double heater_w;
  double brake_w;
} bev_middle;

static inline bev_middle bev_middle_of(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                                       const double *temperature_c, double heater_w, double brake_w, int32_t k) {
  bev_middle middle;
  middle.vehicle = vehicle;
  middle.idle = bev_inputs_of(vehicle, trip, k, NULL, NULL);
  middle.limit_w = trip->heater_limit_w[k];
  middle.soc = 0.5 * (soc[k] + soc[k + 1]);
  middle.temperature_c = 0.5 * (temperature_c[k] + temperature_c[k + 1]);
  middle.heater_w = heater_w;
  middle.brake_w = brake_w;
  return middle;
}

static inline int bev_is_middle(const bev_middle *of) {
  return bev_are_finite(&of->idle) && isfinite(of->limit_w) && isfinite(of->heater_w)
      && isfinite(of->brake_w) && isfinite(of->soc) && isfinite(of->temperature_c);
}

/* The circuit in a step, with the charge raised by `fuller` and the temperature by `warmer_k`. */
static inline bev_circuit bev_circuit_in(const bev_middle *of, double fuller, double warmer_k) {
  return bev_circuit_at(of->vehicle, of->soc + fuller, of->temperature_c + warmer_k);
}

/* The rates in a step under a heater and a friction brake power. */
static inline bev_charge_warmth bev_rates_under(const bev_middle *of, const bev_circuit *circuit, double heater_w,
                                                double brake_w) {
  const bev_vehicle *vehicle = of->vehicle;
  double result[3];
  bev_rates_of_circuit(vehicle, BEV_AS_ARRAYS, circuit->voltage_v, circuit->resistance_ohm,
                       circuit->temperature_c, of->idle.power_w + heater_w + brake_w,
                       of->idle.variance_w2,
                       bev_heat_under_w(vehicle, of->idle.heat_w, heater_w, brake_w),
                       of->idle.leakage_w_per_k, result);
  const bev_charge_warmth rates = {result[0], result[1]};
  return rates;
}

/* The same with the charge raised by `fuller` and the temperature by `warmer_k`. */
static inline bev_charge_warmth bev_rates_at(const bev_middle *of, double heater_w, double brake_w, double fuller,
                                             double warmer_k) {
  const bev_circuit circuit = bev_circuit_in(of, fuller, warmer_k);
  return bev_rates_under(of, &circuit, heater_w, brake_w);
}

/* Change at the end of a step for each unit of a difference at its start. */
static inline bev_charge_warmth bev_slope_of(bev_charge_warmth here, bev_charge_warmth there, double difference,
                                             double duration_s) {
  const bev_charge_warmth slope = {(there.charge - here.charge) / difference * duration_s,
                                   (there.warmth - here.warmth) / difference * duration_s};
  return slope;
}

/* The slopes of a step whose heater and brake do not depend on the state. */
static inline bev_slopes bev_slopes_of_model(const bev_middle *of) {
  const double duration_s = of->idle.duration_s;
  const bev_circuit circuit = bev_circuit_in(of, 0.0, 0.0);
  const bev_charge_warmth here = bev_rates_under(of, &circuit, of->heater_w, of->brake_w);
  bev_slopes slopes;
  slopes.by_charge =
      bev_slope_of(here, bev_rates_at(of, of->heater_w, of->brake_w, BEV_SOC_DIFFERENCE, 0.0),
                   BEV_SOC_DIFFERENCE, duration_s);
  slopes.by_warmth = bev_slope_of(
      here, bev_rates_at(of, of->heater_w, of->brake_w, 0.0, BEV_TEMPERATURE_DIFFERENCE_K),
      BEV_TEMPERATURE_DIFFERENCE_K, duration_s);
  /* From no heating to full heating: a step is heated or not. */
  slopes.by_power = bev_slope_of(bev_rates_under(of, &circuit, 0.0, 0.0),
                                 bev_rates_under(of, &circuit, of->limit_w, 0.0),
                                 of->limit_w > 0.0 ? of->limit_w : 1.0, duration_s);
  return slopes;
}

/* Value of charge and warmth before a step, from their value after it. */
static inline bev_charge_warmth bev_worth_before(bev_charge_warmth worth, const bev_slopes *slopes) {
  const bev_charge_warmth by_charge = slopes->by_charge;
  const bev_charge_warmth by_warmth = slopes->by_warmth;
  const bev_charge_warmth first = {
      worth.charge * by_charge.charge + worth.warmth * by_charge.warmth,
      worth.charge * by_warmth.charge + worth.warmth * by_warmth.warmth};
  const bev_charge_warmth second = {
      first.charge * by_charge.charge + first.warmth * by_charge.warmth,
      first.charge * by_warmth.charge + first.warmth * by_warmth.warmth};
  const bev_charge_warmth changed = {worth.charge + first.charge + 0.5 * second.charge,
                                     worth.warmth + first.warmth + 0.5 * second.warmth};
  return changed;
}

/* Effect of a watt in a step on arrival, from the value of charge and warmth at both ends. */
static inline double bev_effect(bev_charge_warmth after, bev_charge_warmth earlier, bev_charge_warmth by_power) {
  return 0.5 * (after.charge + earlier.charge) * by_power.charge
      + 0.5 * (after.warmth + earlier.warmth) * by_power.warmth;
}

#endif /* BEV_PREHEAT_CORE_SLOPES_H_ */
