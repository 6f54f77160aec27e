/* SPDX-License-Identifier: Apache-2.0 */
/* The energies of a forward run: bev_preheat.planning.dynamics. */
#include "bev_preheat_core_generated/constants.h"
#include "checks.h"
#include "parts_of_plans.h"
#include "steps_of_model.h"

/* Power balance of one step of a run, means [W]. */
typedef struct {
  double joule_w;
  double leakage_w;
  double battery_w;
  double undeliverable_w;
} step_account;

static int is_run(const bev_run_of_powers *run) {
  return run != NULL && run->soc != NULL && run->temperature_c != NULL && run->heater_w != NULL;
}

static bev_inputs inputs_of(const bev_vehicle *vehicle, const bev_trip *trip, const bev_run_of_powers *run,
                            int32_t k) {
  if (run->arriving_heat_w == NULL) {
    return bev_inputs_of(vehicle, trip, k, run->heater_w, run->brake_w);
  }
  bev_inputs inputs = bev_inputs_of(vehicle, trip, k, NULL, run->brake_w);
  inputs.power_w = inputs.power_w + run->heater_w[k];
  inputs.heat_w = inputs.heat_w + run->arriving_heat_w[k];
  return inputs;
}

static double deliverable_w(const bev_vehicle *vehicle, double soc, double temperature_c) {
  return bev_deliverable_w(
      bev_at(&vehicle->open_circuit_voltage, BEV_AS_ARRAYS, soc, temperature_c),
      bev_at(&vehicle->resistance, BEV_AS_ARRAYS, soc, temperature_c));
}

/* The account of a step whose means are known; `end_c` is the end temperature by the model alone [deg C]. */
static step_account account_of(const bev_vehicle *vehicle, const bev_trip *trip, const bev_run_of_powers *run,
                               int32_t k, const bev_inputs *inputs, double end_c, double mean_c, double joule_w) {
  step_account account;
  const double held_c = run->temperature_c[k + 1];
  account.joule_w = joule_w;
  account.leakage_w =
      bev_leaked_w(trip->leakage_w_per_k[k], trip->ambient_temperature_c[k], mean_c);
  if (held_c >= vehicle->hottest_c) {
    account.leakage_w = account.leakage_w
        - (end_c - held_c) * vehicle->heat_capacity_j_per_k / inputs->duration_s;
  }
  account.undeliverable_w = run->is_deliverable != 0
      ? 0.0
      : bev_maximum(
            inputs->power_w - deliverable_w(vehicle, run->soc[k], run->temperature_c[k]), 0.0);
  account.battery_w = inputs->power_w - account.undeliverable_w + account.joule_w;
  return account;
}

static void add_step(const bev_vehicle *vehicle, const bev_trip *trip, const bev_run_of_powers *run, int32_t k,
                     const step_account *account, bev_energies *sum) {
  const double hours = trip->duration_s[k] / BEV_JOULES_PER_WH;
  const double brake_w = run->brake_w == NULL ? 0.0 : run->brake_w[k];
  sum->joule += hours * account->joule_w;
  sum->drivetrain_heat += hours * bev_heat_with_brake_w(vehicle, trip->drivetrain_heat_w[k], brake_w);
  sum->leakage += hours * account->leakage_w;
  sum->hvch_electric += hours * run->heater_w[k];
  sum->battery_total += hours * account->battery_w;
  if (run->arriving_heat_w != NULL) {
    sum->hvch_heat += hours * run->arriving_heat_w[k];
  }
}

static bev_status finished(const bev_vehicle *vehicle, const bev_run_of_powers *run, bev_energies *sum) {
  if (run->arriving_heat_w == NULL) {
    sum->hvch_heat = bev_heat_with_heater_w(vehicle, 0.0, sum->hvch_electric);
  }
  return isfinite(sum->joule) && isfinite(sum->drivetrain_heat) && isfinite(sum->hvch_heat)
          && isfinite(sum->leakage) && isfinite(sum->hvch_electric)
          && isfinite(sum->battery_total)
      ? BEV_OK
      : BEV_NOT_FINITE;
}

bev_status bev_energies_of_means(const bev_vehicle *vehicle, const bev_trip *trip, const bev_run_of_powers *run,
                                 bev_means means, bev_energies *energies) {
  const bev_energies zero = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
  *energies = zero;
  for (int32_t k = 0; k < trip->steps; k++) {
    const bev_inputs inputs = inputs_of(vehicle, trip, run, k);
    const step_account account =
        account_of(vehicle, trip, run, k, &inputs, run->temperature_c[k + 1],
                   means.temperature_c[k], means.joule_w[k]);
    add_step(vehicle, trip, run, k, &account, energies);
  }
  return finished(vehicle, run, energies);
}

bev_status bev_keep_accounts(const bev_vehicle *vehicle, int32_t integrator, const bev_trip *trip,
                             const bev_run_of_powers *run, double *columns, bev_energies *energies) {
  const bev_status status = bev_checked(vehicle, trip, 0);
  if (status != BEV_OK) {
    return status;
  }
  if (!is_run(run) || energies == NULL || !bev_is_integrator(integrator)) {
    return BEV_BAD_ARGUMENT;
  }
  const bev_energies zero = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
  const int32_t steps = trip->steps;
  *energies = zero;
  for (int32_t k = 0; k < steps; k++) {
    const bev_inputs inputs = inputs_of(vehicle, trip, run, k);
    if (!bev_are_finite(&inputs) || !isfinite(run->soc[k]) || !isfinite(run->temperature_c[k])) {
      return BEV_BAD_INPUT;
    }
    double result[4];
    bev_integrate(vehicle, integrator, BEV_AS_ARRAYS, run->soc[k], run->temperature_c[k], &inputs,
                  result);
    const step_account account =
        account_of(vehicle, trip, run, k, &inputs, result[1], result[2], result[3]);
    add_step(vehicle, trip, run, k, &account, energies);
    if (columns != NULL) {
      columns[k] = account.joule_w;
      columns[steps + k] = account.leakage_w;
      columns[2 * steps + k] = account.battery_w;
      columns[3 * steps + k] = account.undeliverable_w;
    }
  }
  return finished(vehicle, run, energies);
}
