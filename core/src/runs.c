/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Steps and runs of the model, ignoring limits.
 *
 * A run is first driven without saturation, because a negative discriminant is detected at no cost: it
 * leaves NaN. Only then is the run driven again with powers that saturate, from its beginning, as in
 * bev_preheat.planning.dynamics.
 */
#include "bev_preheat_core_generated/constants.h"
#include "checks.h"
#include "parts_of_plans.h"
#include "steps_of_model.h"

static bev_status run(const bev_vehicle *vehicle, int32_t integrator, int32_t saturating, const bev_trip *trip,
                      int32_t first, const double *heater_w, const double *brake_w, double *soc,
                      double *temperature_c, bev_means means) {
  double result[4];
  for (int32_t k = first; k < trip->steps; k++) {
    const bev_inputs inputs = bev_inputs_of(vehicle, trip, k, heater_w, brake_w);
    if (!bev_are_finite(&inputs)) {
      return BEV_BAD_INPUT;
    }
    bev_integrate(vehicle, integrator, saturating, soc[k], temperature_c[k], &inputs, result);
    const bev_status status = bev_kind_of(result[0], result[1]);
    if (status != BEV_OK) {
      return status;
    }
    soc[k + 1] = result[0];
    temperature_c[k + 1] = result[1];
    if (means.temperature_c != NULL) {
      means.temperature_c[k] = result[2];
      means.joule_w[k] = result[3];
    }
  }
  return BEV_OK;
}

/* Of the second attempt, which saturates: its own failure, else that it was needed. */
static bev_status of_second(bev_status status) {
  if (status == BEV_OK) {
    return BEV_SATURATED;
  }
  return status == BEV_SATURATED ? BEV_NOT_FINITE : status;
}

bev_status bev_run_with_means(const bev_vehicle *vehicle, int32_t integrator, const bev_trip *trip, int32_t first,
                              const double *heater_w, const double *brake_w, double *soc, double *temperature_c,
                              bev_means means) {
  bev_status status = bev_checked(vehicle, trip, first);
  if (status != BEV_OK) {
    return status;
  }
  if (soc == NULL || temperature_c == NULL || !bev_is_integrator(integrator)) {
    return BEV_BAD_ARGUMENT;
  }
  if (!isfinite(soc[first]) || !isfinite(temperature_c[first])) {
    return BEV_BAD_INPUT;
  }
  status = run(vehicle, integrator, 0, trip, first, heater_w, brake_w, soc, temperature_c, means);
  if (status == BEV_SATURATED) {
    status = of_second(
        run(vehicle, integrator, 1, trip, first, heater_w, brake_w, soc, temperature_c, means));
  }
  return status;
}

bev_status bev_run(const bev_vehicle *vehicle, int32_t integrator, const bev_trip *trip, int32_t first,
                   const double *heater_w, const double *brake_w, double *soc, double *temperature_c) {
  const bev_means none = {NULL, NULL};
  return bev_run_with_means(vehicle, integrator, trip, first, heater_w, brake_w, soc,
                            temperature_c, none);
}

/*
 * Mean power from the cells in a step whose result is known [W], as in bev_keep_accounts: with the charge clipped
 * to 0 ... 1. A step that may leave that range is computed again.
 */
static double battery_power_w(const bev_vehicle *vehicle, int32_t saturating, const double states[4],
                              const bev_inputs *inputs, double command_w, const double result[8]) {
  const double room = 2.0 * fabs(result[0] - states[0]);
  const double low = bev_minimum(states[0], result[0]);
  const double high = bev_maximum(states[0], result[0]);
  if (saturating == BEV_EXACT && low - room >= 0.0 && high + room <= 1.0) {
    return inputs->power_w + result[6] + result[5];
  }
  double held[8];
  bev_integrate_heated(vehicle, BEV_AS_ARRAYS, states, inputs, command_w, held);
  return inputs->power_w + held[6] + held[5];
}

static bev_status run_heated(const bev_vehicle *vehicle, int32_t saturating, const bev_trip *trip, int32_t first,
                             const double *command_w, double *const run_of[4], double *taken_wh) {
  double states[4];
  double result[8];
  for (int32_t n = 0; n < 4; n++) {
    states[n] = run_of[n][first];
  }
  for (int32_t k = first; k < trip->steps; k++) {
    const bev_inputs inputs = bev_inputs_of(vehicle, trip, k, NULL, NULL);
    if (!bev_are_finite(&inputs) || !isfinite(command_w[k])) {
      return BEV_BAD_INPUT;
    }
    bev_integrate_heated(vehicle, saturating, states, &inputs, command_w[k], result);
    bev_status status = bev_kind_of(result[0], result[1]);
    if (status == BEV_OK && bev_kind_of(result[2], result[3]) != BEV_OK) {
      status = BEV_NOT_FINITE;
    }
    if (status != BEV_OK) {
      return status;
    }
    if (taken_wh != NULL) {
      *taken_wh += inputs.duration_s / BEV_JOULES_PER_WH
          * battery_power_w(vehicle, saturating, states, &inputs, command_w[k], result);
    }
    for (int32_t n = 0; n < 4; n++) {
      states[n] = result[n];
      run_of[n][k + 1] = result[n];
    }
  }
  return BEV_OK;
}

bev_status bev_run_heated_with_energy(const bev_vehicle *vehicle, const bev_trip *trip, int32_t first,
                                      const double *command_w, double *states, double *taken_wh) {
  bev_status status = bev_checked(vehicle, trip, first);
  if (status != BEV_OK) {
    return status;
  }
  if (command_w == NULL || states == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  const int32_t instants = trip->steps + 1;
  double *const run_of[4] = {states, &states[instants], &states[2 * instants],
                             &states[3 * instants]};
  for (int32_t n = 0; n < 4; n++) {
    if (!isfinite(run_of[n][first])) {
      return BEV_BAD_INPUT;
    }
  }
  const double taken_before_wh = taken_wh == NULL ? 0.0 : *taken_wh;
  status = run_heated(vehicle, 0, trip, first, command_w, run_of, taken_wh);
  if (status == BEV_SATURATED) {
    if (taken_wh != NULL) {
      *taken_wh = taken_before_wh;
    }
    status = of_second(run_heated(vehicle, 1, trip, first, command_w, run_of, taken_wh));
  }
  return status;
}

bev_status bev_run_heated(const bev_vehicle *vehicle, const bev_trip *trip, const double *command_w,
                          double *states, double *heat_w) {
  const bev_status status =
      bev_run_heated_with_energy(vehicle, trip, 0, command_w, states, NULL);
  if (status < BEV_OK || heat_w == NULL) {
    return status;
  }
  const bev_status along = bev_heat_along(vehicle, trip, states, command_w, heat_w);
  return along == BEV_OK ? status : along;
}

bev_status bev_heat_along(const bev_vehicle *vehicle, const bev_trip *trip, const double *states,
                          const double *command_w, double *heat_w) {
  const bev_status status = bev_checked(vehicle, trip, 0);
  if (status != BEV_OK) {
    return status;
  }
  if (states == NULL || command_w == NULL || heat_w == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  const int32_t instants = trip->steps + 1;
  for (int32_t k = 0; k < trip->steps; k++) {
    const bev_inputs inputs = bev_inputs_of(vehicle, trip, k, NULL, NULL);
    const double start[4] = {states[k], states[instants + k], states[2 * instants + k],
                             states[3 * instants + k]};
    if (!bev_are_finite(&inputs) || !isfinite(command_w[k]) || !isfinite(start[0])
        || !isfinite(start[1]) || !isfinite(start[2]) || !isfinite(start[3])) {
      return BEV_BAD_INPUT;
    }
    double result[8];
    bev_integrate_heated(vehicle, BEV_AS_ARRAYS, start, &inputs, command_w[k], result);
    heat_w[k] = result[6];
    heat_w[trip->steps + k] = result[7];
    if (!isfinite(result[6]) || !isfinite(result[7])) {
      return BEV_NOT_FINITE;
    }
  }
  return BEV_OK;
}

static bev_status find_crossing(const bev_vehicle *vehicle, int32_t integrator, int32_t saturating,
                                const bev_trip *trip, double target_c, double terminal_soc, double lost_k,
                                const double *idle_temperature_c, double *instant_s) {
  double soc = terminal_soc;
  double temperature_c = target_c;
  double above_k = target_c - idle_temperature_c[trip->steps];
  double result[4];
  for (int32_t k = trip->steps - 1; k >= 0; k--) {
    bev_inputs inputs = bev_inputs_of(vehicle, trip, k, trip->heater_limit_w, NULL);
    const double duration_s = inputs.duration_s;
    if (!bev_are_finite(&inputs) || !isfinite(idle_temperature_c[k])) {
      return BEV_BAD_INPUT;
    }
    inputs.duration_s = -duration_s;
    bev_integrate(vehicle, integrator, saturating, soc, temperature_c, &inputs, result);
    const bev_status status = bev_kind_of(result[0], result[1]);
    if (status != BEV_OK) {
      return status;
    }
    soc = result[0];
    temperature_c = result[1];
    const double above_before_k = above_k;
    above_k = temperature_c - idle_temperature_c[k];
    if (above_k <= 0.0) {
      *instant_s = trip->time_s[k + 1]
          - duration_s * above_before_k / (above_before_k - above_k);
      return BEV_OK;
    }
    if (temperature_c > target_c + lost_k) {
      return BEV_NO_CROSSING;
    }
  }
  return BEV_NO_CROSSING;
}

bev_status bev_find_crossing(const bev_vehicle *vehicle, int32_t integrator, const bev_trip *trip, double target_c,
                             double terminal_soc, double lost_k, const double *idle_temperature_c,
                             double *instant_s) {
  bev_status status = bev_checked(vehicle, trip, 0);
  if (status != BEV_OK) {
    return status;
  }
  if (idle_temperature_c == NULL || instant_s == NULL || !bev_is_integrator(integrator)) {
    return BEV_BAD_ARGUMENT;
  }
  if (!isfinite(target_c) || !isfinite(terminal_soc) || !isfinite(lost_k)
      || !isfinite(idle_temperature_c[trip->steps])) {
    return BEV_BAD_INPUT;
  }
  status = find_crossing(vehicle, integrator, 0, trip, target_c, terminal_soc, lost_k,
                         idle_temperature_c, instant_s);
  if (status == BEV_SATURATED) {
    status = find_crossing(vehicle, integrator, 1, trip, target_c, terminal_soc, lost_k,
                           idle_temperature_c, instant_s);
    status = status == BEV_SATURATED ? BEV_NOT_FINITE : status;
  }
  return status;
}
