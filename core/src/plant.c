/* SPDX-License-Identifier: Apache-2.0 */
/* The simulated vehicle: bev_preheat.simulation.vehicle_plant, in the order of its operations. */
#include "bev_preheat_core/plant.h"

#include "bev_preheat_core_generated/drives.h"
#include "checks.h"
#include "limited_step.h"
#include "steps_of_model.h"

/* What stays the same while the vehicle drives. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  double sensor_lag_s;
  double longest_step_s;
  double heater_power_w;
  int is_direct;
} drive;

/* Command heater and friction brake what cabin and battery leave them. */
static void keep_limits(const drive *of, bev_plant *plant) {
  const bev_vehicle *vehicle = of->vehicle;
  const bev_trip *trip = of->trip;
  const int32_t k = plant->segment;
  const double idle_w = trip->idle_power_w[k];
  double limits_w[2];
  bev_terminal_limits(vehicle, BEV_SATURATING, plant->soc, plant->temperature_c,
                      trip->power_variance_w2[k], limits_w);
  plant->command_w = bev_maximum(
      0.0, bev_minimum(bev_minimum(of->heater_power_w, trip->heater_limit_w[k]), limits_w[1] - idle_w));
  if (plant->temperature_c >= vehicle->highest_c) {
    plant->command_w = 0.0;
  }
  /* A heater that lags takes what it takes. */
  plant->heater_power_w = of->is_direct != 0 ? plant->command_w : plant->power_at_end_w;
  const double regenerated_w = bev_maximum(0.0, -trip->propulsion_power_w[k]);
  plant->brake_power_w = bev_minimum(
      regenerated_w, bev_maximum(0.0, limits_w[0] - idle_w - plant->heater_power_w));
}

/* The inputs of the model under a heater power and the present friction brake. */
static bev_inputs inputs_under(const drive *of, const bev_plant *plant, double heater_w,
                               double step_s) {
  const bev_vehicle *vehicle = of->vehicle;
  const bev_trip *trip = of->trip;
  const int32_t k = plant->segment;
  const bev_inputs inputs = {
      step_s, trip->idle_power_w[k] + heater_w + plant->brake_power_w, trip->power_variance_w2[k],
      bev_heat_under_w(vehicle, trip->idle_heat_w[k], heater_w, plant->brake_power_w),
      trip->leakage_w_per_k[k]};
  return inputs;
}

/* What the model's step does: charge, temperature, and the means of temperature and Joule heat. */
static void integrate(const drive *of, double step_s, bev_plant *plant, double result[4]) {
  const bev_vehicle *vehicle = of->vehicle;
  const bev_inputs inputs =
      inputs_under(of, plant, of->is_direct != 0 ? plant->heater_power_w : 0.0, step_s);
  if (of->is_direct != 0) {
    bev_integrate(vehicle, BEV_RUNGE_KUTTA_4, BEV_EXACT, plant->soc, plant->temperature_c, &inputs,
                  result);
    return;
  }
  const double states[4] = {plant->soc, plant->temperature_c, plant->power_at_end_w,
                            plant->coolant_c - plant->temperature_c};
  double heated[8];
  bev_integrate_heated(vehicle, BEV_EXACT, states, &inputs, plant->command_w, heated);
  plant->heater_power_w = heated[6];
  plant->power_at_end_w = heated[2];
  plant->coolant_c = heated[1] + heated[3];
  result[0] = heated[0];
  result[1] = heated[1];
  result[2] = heated[4];
  result[3] = heated[5];
}

/* One step; whether the battery gives all that is asked of it, and holds charge. */
static int step(const drive *of, double step_s, bev_plant *plant) {
  const bev_vehicle *vehicle = of->vehicle;
  const bev_trip *trip = of->trip;
  const int32_t k = plant->segment;
  const double started_c = plant->temperature_c;
  double result[4];
  keep_limits(of, plant);
  integrate(of, step_s, plant, result);
  if (!isfinite(result[0]) || !isfinite(result[1]) || !(result[0] > 0.0)) {
    return 0;
  }
  const double power_w = trip->idle_power_w[k] + plant->heater_power_w + plant->brake_power_w;
  /* Neither can a battery be emptier than empty, nor does a car let it get any hotter. */
  plant->soc = bev_minimum(result[0], 1.0);
  plant->temperature_c = bev_minimum(result[1], vehicle->hottest_c);
  if (!(vehicle->coolant_heat_capacity_j_per_k > 0.0)) {
    plant->coolant_c = plant->temperature_c;
  }
  plant->sensor_c = of->sensor_lag_s > 0.0
      ? bev_sensor_reading(vehicle, BEV_SATURATING, of->sensor_lag_s, plant->sensor_c, started_c,
                           plant->temperature_c, step_s)
      : plant->temperature_c;
  const double cooled_j = vehicle->heat_capacity_j_per_k * (result[1] - plant->temperature_c);
  plant->time_s += step_s;
  plant->joule_j += step_s * result[3];
  plant->drivetrain_j +=
      step_s * bev_heat_with_brake_w(vehicle, trip->drivetrain_heat_w[k], plant->brake_power_w);
  plant->heater_j += step_s * plant->heater_power_w;
  plant->leakage_j +=
      step_s * trip->leakage_w_per_k[k] * (trip->ambient_temperature_c[k] - result[2]) - cooled_j;
  plant->battery_j += step_s * (power_w + result[3]);
  plant->brake_j += step_s * plant->brake_power_w;
  return 1;
}

/* Drive on to an instant that lies in the segment, in equal steps; whether that can be done. */
static int drive_within_segment(const drive *of, double until_s, bev_plant *plant) {
  const double steps = ceil((until_s - plant->time_s) / of->longest_step_s);
  if (!(steps <= (double)BEV_MOST_PLANT_STEPS)) {
    return 0;
  }
  const double step_s = (until_s - plant->time_s) / steps;
  bev_plant driven = *plant;
  for (int32_t n = 0; n < (int32_t)steps; n++) {
    if (step(of, step_s, &driven) == 0) {
      return 0;
    }
  }
  /* Sums of steps do not end exactly where they should. */
  driven.time_s = until_s;
  *plant = driven;
  return 1;
}

static void look_at_terminals(const drive *of, bev_plant *plant) {
  const bev_vehicle *vehicle = of->vehicle;
  plant->current_a = 0.0;
  if (plant->segment < of->trip->steps) {
    const bev_inputs inputs = inputs_under(of, plant, plant->heater_power_w, 0.0);
    double rates[3];
    bev_rates(vehicle, BEV_SATURATING, plant->soc, plant->temperature_c, inputs.power_w,
              inputs.variance_w2, inputs.heat_w, inputs.leakage_w_per_k, rates);
    plant->current_a = -rates[0] * (3600.0 * vehicle->capacity_ah);
  }
  plant->voltage_v =
      bev_at(&vehicle->open_circuit_voltage, BEV_SATURATING, plant->soc, plant->temperature_c)
      - bev_at(&vehicle->resistance, BEV_SATURATING, plant->soc, plant->temperature_c)
          * plant->current_a;
}

bev_status bev_drive_plant(const bev_vehicle *vehicle, const bev_trip *trip, double sensor_lag_s,
                           double longest_step_s, double until_s, double heater_power_w,
                           bev_plant *plant) {
  if (plant == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  const bev_status checked = bev_checked(vehicle, trip, plant->segment);
  if (checked != BEV_OK) {
    return checked;
  }
  if (!isfinite(plant->time_s) || !isfinite(plant->soc) || !isfinite(plant->temperature_c)
      || !isfinite(plant->coolant_c) || !isfinite(plant->power_at_end_w) || !isfinite(until_s)
      || !isfinite(sensor_lag_s) || !isfinite(heater_power_w) || !(heater_power_w >= 0.0)
      || !(longest_step_s > 0.0)) {
    return BEV_BAD_INPUT;
  }
  const drive of = {vehicle, trip, sensor_lag_s, longest_step_s, heater_power_w,
                    bev_is_direct(vehicle)};
  while (plant->segment < trip->steps && plant->time_s < until_s) {
    const double end_s = trip->time_s[plant->segment + 1];
    if (drive_within_segment(&of, bev_minimum(until_s, end_s), plant) == 0) {
      return BEV_SATURATED;
    }
    if (plant->time_s == end_s) {
      plant->segment++;
    }
  }
  look_at_terminals(&of, plant);
  return BEV_OK;
}
