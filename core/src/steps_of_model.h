/* SPDX-License-Identifier: Apache-2.0 */
/* The steps of bev_preheat.vehicle.model and heat_path, generated; chosen by integrator and by heat path. */
#ifndef BEV_PREHEAT_CORE_STEPS_OF_MODEL_H_
#define BEV_PREHEAT_CORE_STEPS_OF_MODEL_H_

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#include "bev_preheat_core_generated/constants.h"
#include "bev_preheat_core_generated/steps.h"

/* Inputs of one step of the model, as in bev_preheat.planning.trip. */
typedef struct {
  double duration_s;
  double power_w;
  double variance_w2;
  double heat_w;
  double leakage_w_per_k;
} bev_inputs;

/* The inputs of step k of a trip under heater and brake powers; null: no power. */
static inline bev_inputs bev_inputs_of(const bev_vehicle *vehicle, const bev_trip *trip, int32_t k,
                                       const double *heater_w, const double *brake_w) {
  bev_inputs inputs = {trip->duration_s[k], trip->idle_power_w[k], trip->power_variance_w2[k],
                       trip->idle_heat_w[k], trip->leakage_w_per_k[k]};
  if (heater_w != NULL) {
    inputs.power_w = inputs.power_w + heater_w[k];
    inputs.heat_w = bev_heat_with_heater_w(vehicle, inputs.heat_w, heater_w[k]);
  }
  if (brake_w != NULL) {
    inputs.power_w = inputs.power_w + brake_w[k];
    inputs.heat_w = bev_heat_with_brake_w(vehicle, inputs.heat_w, brake_w[k]);
  }
  return inputs;
}

/* The step of a trip in which an instant lies. */
static inline int32_t bev_step_at(const bev_trip *trip, double instant_s) {
  const int32_t before = bev_points_up_to(trip->time_s, trip->steps + 1, instant_s);
  const int32_t step = (before < trip->steps ? before : trip->steps) - 1;
  return step > 0 ? step : 0;
}

/* Whether a step of a trip is heated under heater powers [W]. */
static inline int bev_is_heated(const bev_trip *trip, const double *heater_w, int32_t k) {
  return heater_w[k] > BEV_HEATING_SHARE * trip->heater_limit_w[k];
}

static inline int bev_are_finite(const bev_inputs *inputs) {
  return isfinite(inputs->duration_s) && isfinite(inputs->power_w)
      && isfinite(inputs->variance_w2) && isfinite(inputs->heat_w)
      && isfinite(inputs->leakage_w_per_k);
}

/* Whether two states are numbers: BEV_OK. After a power deficit they are NaN: BEV_SATURATED. */
static inline bev_status bev_kind_of(double soc, double temperature_c) {
  if (isfinite(soc) && isfinite(temperature_c)) {
    return BEV_OK;
  }
  return isnan(soc) || isnan(temperature_c) ? BEV_SATURATED : BEV_NOT_FINITE;
}

static inline void bev_integrate(const bev_vehicle *vehicle, int32_t integrator, int32_t saturating, double soc,
                                 double temperature_c, const bev_inputs *inputs, double result[4]) {
  switch (integrator) {
    case BEV_EULER:
      bev_euler(vehicle, saturating, soc, temperature_c, inputs->duration_s, inputs->power_w,
                inputs->variance_w2, inputs->heat_w, inputs->leakage_w_per_k, result);
      break;
    case BEV_MIDPOINT:
      bev_midpoint(vehicle, saturating, soc, temperature_c, inputs->duration_s, inputs->power_w,
                   inputs->variance_w2, inputs->heat_w, inputs->leakage_w_per_k, result);
      break;
    default:
      bev_runge_kutta_4(vehicle, saturating, soc, temperature_c, inputs->duration_s,
                        inputs->power_w, inputs->variance_w2, inputs->heat_w,
                        inputs->leakage_w_per_k, result);
      break;
  }
}

static inline void bev_integrate_heated(const bev_vehicle *vehicle, int32_t saturating, const double states[4],
                                        const bev_inputs *inputs, double command_w, double result[8]) {
  if (vehicle->shell_share > 0.0) {
    if (vehicle->heater_lag_s > 0.0) {
      bev_heated_by_shell_with_lag(
          vehicle, saturating, states[0], states[1], states[2], states[3], inputs->duration_s,
          inputs->power_w, inputs->variance_w2, inputs->heat_w, inputs->leakage_w_per_k,
          command_w, result);
    } else {
      bev_heated_by_shell(
          vehicle, saturating, states[0], states[1], states[2], states[3], inputs->duration_s,
          inputs->power_w, inputs->variance_w2, inputs->heat_w, inputs->leakage_w_per_k,
          command_w, result);
    }
  } else if (vehicle->coolant_heat_capacity_j_per_k > 0.0) {
    if (vehicle->heater_lag_s > 0.0) {
      bev_heated_by_coolant_with_lag(
          vehicle, saturating, states[0], states[1], states[2], states[3], inputs->duration_s,
          inputs->power_w, inputs->variance_w2, inputs->heat_w, inputs->leakage_w_per_k,
          command_w, result);
    } else {
      bev_heated_by_coolant(
          vehicle, saturating, states[0], states[1], states[2], states[3], inputs->duration_s,
          inputs->power_w, inputs->variance_w2, inputs->heat_w, inputs->leakage_w_per_k,
          command_w, result);
    }
  } else if (vehicle->heater_lag_s > 0.0) {
    bev_heated_with_lag(
        vehicle, saturating, states[0], states[1], states[2], states[3], inputs->duration_s,
        inputs->power_w, inputs->variance_w2, inputs->heat_w, inputs->leakage_w_per_k, command_w,
        result);
  } else {
    bev_heated_at_once(
        vehicle, saturating, states[0], states[1], states[2], states[3], inputs->duration_s,
        inputs->power_w, inputs->variance_w2, inputs->heat_w, inputs->leakage_w_per_k, command_w,
        result);
  }
}

static inline int bev_is_integrator(int32_t integrator) {
  return integrator >= (int32_t)BEV_EULER && integrator <= (int32_t)BEV_RUNGE_KUTTA_4;
}

#endif /* BEV_PREHEAT_CORE_STEPS_OF_MODEL_H_ */
