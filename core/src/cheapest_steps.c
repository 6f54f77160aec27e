/* SPDX-License-Identifier: Apache-2.0 */
/* Heating in the steps in which a kelvin on arrival costs the least: bev_preheat.planning.cheapest_steps. */
#include "bev_preheat_core_generated/constants.h"
#include "bracketing.h"
#include "checks.h"
#include "prices.h"
#include "steps_of_model.h"

/* The heated steps, in their order, and the memory of each trial. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  double target_c;
  int32_t count;
  int32_t *order;
  double *per_k;
  double *warmth_k_per_w;
  double *charge_per_w;
  double *soc;
  double *temperature_c;
  double *heater_w;
} filling;

/* Whether one step takes precedence over another: it costs less, or the same and comes later. */
static int is_cheaper(const filling *of, int32_t one, int32_t other) {
  return of->per_k[one] < of->per_k[other]
      || (of->per_k[one] == of->per_k[other] && one > other);
}

/* Lets the step at a place of the heap sink until none below it is dearer. */
static void sink(filling *of, int32_t at, int32_t count) {
  int32_t *const order = of->order;
  int32_t here = at;
  while (here < count / 2) {
    int32_t below = 2 * here + 1;
    if (below + 1 < count && is_cheaper(of, order[below], order[below + 1])) {
      below = below + 1;
    }
    if (!is_cheaper(of, order[here], order[below])) {
      return;
    }
    const int32_t cheaper = order[here];
    order[here] = order[below];
    order[below] = cheaper;
    here = below;
  }
}

/* The steps in which heating warms, the cheapest first: a heap whose dearest step goes to its end. */
static void put_in_order(filling *of) {
  of->count = 0;
  for (int32_t k = 0; k < of->trip->steps; k++) {
    if (of->warmth_k_per_w[k] > 0.0) {
      of->per_k[k] = of->charge_per_w[k] / of->warmth_k_per_w[k];
      of->order[of->count] = k;
      of->count++;
    }
  }
  for (int32_t at = of->count / 2 - 1; at >= 0; at--) {
    sink(of, at, of->count);
  }
  for (int32_t last = of->count - 1; last > 0; last--) {
    const int32_t dearest = of->order[0];
    of->order[0] = of->order[last];
    of->order[last] = dearest;
    sink(of, 0, last);
  }
}

/* Heat in steps of the order until their sum, `per_w` for each watt, reaches the wanted value. */
static void fill(const filling *of, const double *per_w, double wanted) {
  for (int32_t k = 0; k < of->trip->steps; k++) {
    of->heater_w[k] = 0.0;
  }
  double given = 0.0;
  for (int32_t n = 0; n < of->count; n++) {
    const int32_t k = of->order[n];
    const double limit_w = of->trip->heater_limit_w[k];
    const double most = limit_w * per_w[k];
    of->heater_w[k] =
        limit_w * bev_minimum(bev_maximum((wanted - given) / most, 0.0), 1.0);
    given += most;
  }
}

/* Sum of `per_w` times the heater powers over the steps of the order. */
static double given_by(const filling *of, const double *heater_w, const double *per_w) {
  double given = 0.0;
  for (int32_t n = 0; n < of->count; n++) {
    given += heater_w[of->order[n]] * per_w[of->order[n]];
  }
  return given;
}

/* The run heated with a number of joules; its excess over the target on arrival. */
static bev_status heat_with(void *filled, double heat_j, double *above_k) {
  const filling *of = (const filling *)filled;
  fill(of, of->trip->duration_s, heat_j);
  const bev_status status =
      bev_run(of->vehicle, BEV_RUNGE_KUTTA_4, of->trip, 0, of->heater_w, NULL, of->soc,
              of->temperature_c);
  *above_k = of->temperature_c[of->trip->steps] - of->target_c;
  return status;
}

/* Warming on arrival per joule more in the last heated step [K/J]. */
static double last_slope(const filling *of) {
  for (int32_t n = of->count - 1; n >= 0; n--) {
    const int32_t k = of->order[n];
    if (of->heater_w[k] != 0.0) {
      return of->warmth_k_per_w[k] / of->trip->duration_s[k];
    }
  }
  return NAN;
}

/* The run that is heated in the cheapest steps until it arrives at the target. */
static bev_status fill_until_warm(filling *of) {
  const double guess_j = given_by(of, of->heater_w, of->trip->duration_s);
  double whole_j = 0.0;
  for (int32_t n = 0; n < of->count; n++) {
    whole_j += of->trip->heater_limit_w[of->order[n]] * of->trip->duration_s[of->order[n]];
  }
  double above_k = 0.0;
  double heat_j = bev_minimum(guess_j, whole_j);
  const bev_status status = heat_with(of, heat_j, &above_k);
  if (status < BEV_OK) {
    return status;
  }
  const double slope = last_slope(of);
  if (!isfinite(slope)) {
    return BEV_NOT_FINITE;
  }
  const bev_ending ending = {BEV_ARRIVAL_TOLERANCE_K, 0.0, BEV_MOST_TRIALS};
  return bev_follow_slope(whole_j, 0.0, slope, &ending, heat_with, of, &heat_j, &above_k);
}

bev_status bev_heat_cheapest(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                             double *soc, double *temperature_c, double *heater_w, double *memory,
                             int32_t *order, int32_t *orders) {
  bev_status status = bev_checked(vehicle, trip, 0);
  if (status != BEV_OK) {
    return status;
  }
  if (trip->steps < 1 || soc == NULL || temperature_c == NULL || heater_w == NULL || memory == NULL
      || order == NULL || orders == NULL || vehicle->heater_lag_s > 0.0
      || vehicle->coolant_heat_capacity_j_per_k > 0.0) {
    return BEV_BAD_ARGUMENT;
  }
  if (!isfinite(target_c) || !isfinite(soc[0]) || !isfinite(temperature_c[0])) {
    return BEV_BAD_INPUT;
  }
  const int32_t steps = trip->steps;
  filling of = {vehicle,
                trip,
                target_c,
                0,
                order,
                memory,
                &memory[steps],
                &memory[2 * steps],
                &memory[3 * steps],
                &memory[4 * steps + 1],
                &memory[5 * steps + 2]};
  of.soc[0] = soc[0];
  of.temperature_c[0] = temperature_c[0];
  *orders = 0;
  for (int32_t n = 0; n < BEV_MOST_ORDERS; n++) {
    status = bev_prices_along(vehicle, trip, soc, temperature_c, heater_w, of.warmth_k_per_w,
                              of.charge_per_w);
    if (status != BEV_OK) {
      return status;
    }
    put_in_order(&of);
    fill(&of, of.warmth_k_per_w, given_by(&of, heater_w, of.warmth_k_per_w));
    const double saving = given_by(&of, heater_w, of.charge_per_w)
        - given_by(&of, of.heater_w, of.charge_per_w);
    const double whole_wh = bev_whole_charge_wh(vehicle, soc[steps], temperature_c[steps]);
    if (!(saving >= (n == 0 ? BEV_LEAST_SAVING_WH : BEV_LEAST_SAVING_THEN_WH) / whole_wh)) {
      return BEV_OK;
    }
    status = fill_until_warm(&of);
    if (status < BEV_OK) {
      return status;
    }
    if (!(of.soc[steps] > soc[steps])) {
      return BEV_OK;
    }
    for (int32_t k = 0; k <= steps; k++) {
      soc[k] = of.soc[k];
      temperature_c[k] = of.temperature_c[k];
    }
    for (int32_t k = 0; k < steps; k++) {
      heater_w[k] = of.heater_w[k];
    }
    *orders = n + 1;
  }
  return BEV_OK;
}
