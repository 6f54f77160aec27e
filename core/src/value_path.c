/* SPDX-License-Identifier: Apache-2.0 */
/* The path of the pass before, and prices of what departs from it: bev_preheat.planning.value_path. */
#include "values.h"

/* Drive step k, heated as it is best on the path, from two starts beside it; none is `found` if that empties. */
static bev_status drive_beside(const recursion *of, int32_t k, const layer *next, const double starts[2][4],
                               step_end beside[2], int32_t *found) {
  const double start[4] = {of->soc[k], of->path_c[k] - of->under_way_k[k], 0.0, 0.0};
  step_end ends[MOST_ENDS];
  int32_t count = 0;
  *found = 0;
  bev_status status = bev_ends_of_step(of, k, start, of->path_c[k], ends, &count);
  if (status != BEV_OK || count == 0) {
    return status == BEV_EMPTY ? BEV_OK : status;
  }
  const choice choices = bev_best_of(of, ends, count, next);
  const mixture best = bev_better_of(of, &choices, ANY_DIRECTION);
  for (int32_t n = 0; status == BEV_OK && n < 2; n++) {
    beside[n] = ends[best.end];
    if (best.share > 0.0) {
      const step_end *high = &ends[best.end + 1];
      beside[n].wanted_w = beside[n].powers_w[0]
          + best.share * (high->powers_w[0] - beside[n].powers_w[0]);
      beside[n].takes_surplus = beside[n].wanted_w > 0.0 ? 1 : 0;
    }
    status = bev_drive_step(of, k, starts[n], 1, &beside[n]);
    beside[n].settled_c = bev_seen_ahead_c(of, k, of->path_c[k], starts[n], &beside[n]);
    beside[n].cost_j += of->price_j[k + 1] * beside[n].states[0];
  }
  *found = status == BEV_OK ? 1 : 0;
  return status == BEV_EMPTY ? BEV_OK : status;
}

static double between(double value, double most) {
  return bev_maximum(bev_minimum(value, most), -most);
}

/* How much more the second end is worth than the first [J]; heat repairs a difference, at the price of heat. */
static double warmth_between(const recursion *of, const layer *next, const step_end beside[2]) {
  return between(
      worth_j(of, next, beside[1].settled_c, 1) - worth_j(of, next, beside[0].settled_c, 1),
      of->joules_per_k * fabs(beside[1].settled_c - beside[0].settled_c));
}

/* The highest power of step k that keeps the limit at both ends of the path, with more charge or warmth there [W]. */
static double most_beside_w(const recursion *of, int32_t k, double more_soc, double more_k) {
  const double variance_w2 = of->trip->power_variance_w2[k];
  double most_w = INFINITY;
  for (int32_t n = k; n <= k + 1; n++) {
    double limits_w[2];
    const double soc = bev_maximum(bev_minimum(of->soc[n] + more_soc, 1.0), BEV_PRICED_SOC);
    bev_terminal_limits(of->vehicle, 0, soc, of->path_c[n] - of->under_way_k[n] + more_k,
                        variance_w2, limits_w);
    most_w = bev_minimum(most_w, limits_w[1]);
  }
  return most_w;
}

/*
 * The worth of charge for the power of step k [J]: the cost of the missing power without it, at most the heat that
 * would replace it: if heat can, because it costs charge.
 */
static double worth_for_power(const recursion *of, int32_t k) {
  const double idle_w = of->trip->idle_power_w[k];
  const double less_w = most_beside_w(of, k, -BEV_PRICED_SOC, 0.0);
  const double more_w = most_beside_w(of, k, BEV_PRICED_SOC, 0.0);
  if (!(idle_w > less_w) || !(more_w > less_w)) {
    return 0.0;
  }
  const double lacking_j = of->lack_price * of->trip->duration_s[k]
      * (idle_w - less_w - bev_maximum(idle_w - more_w, 0.0));
  const double soc_per_k = of->joules_per_k / joules_of_charge(of, voltage_v(of, of->soc[k], of->path_c[k]));
  const double per_k_w = (most_beside_w(of, k, 0.0, BEV_PRICED_K)
                          - most_beside_w(of, k, 0.0, -BEV_PRICED_K)) / (2.0 * BEV_PRICED_K)
      - soc_per_k * (more_w - less_w) / (2.0 * BEV_PRICED_SOC);
  const double repaired_j =
      per_k_w > 0.0 ? of->joules_per_k * (more_w - less_w) / per_k_w : INFINITY;
  return bev_minimum(lacking_j, repaired_j) / (2.0 * BEV_PRICED_SOC);
}

bev_status bev_price_of_charge(recursion *of, int32_t k, const layer *next) {
  const double least_soc = bev_maximum(of->soc[k] - BEV_PRICED_SOC, BEV_PRICED_SOC);
  const double most_soc = bev_minimum(of->soc[k] + BEV_PRICED_SOC, 1.0);
  const double start_c = of->path_c[k] - of->under_way_k[k];
  const double starts[2][4] = {{least_soc, start_c, 0.0, 0.0}, {most_soc, start_c, 0.0, 0.0}};
  const double lack_price = of->lack_price;
  step_end beside[2];
  int32_t found = 0;
  if (!(most_soc > least_soc)) {
    return BEV_OK;
  }
  of->lack_price = 0.0;
  const bev_status status = drive_beside(of, k, next, starts, beside, &found);
  of->lack_price = lack_price;
  if (found != 0) {
    of->price_j[k] =
        ((beside[1].cost_j - beside[0].cost_j) + warmth_between(of, next, beside))
        / (most_soc - least_soc);
  }
  if (of->layers_overdraw[k] != 0u && of->lack_price > 0.0) {
    /* Charge that is worth so much for a later step is there for this one, too. */
    const double for_power_j = worth_for_power(of, k);
    of->price_j[k] -= bev_maximum(for_power_j - of->for_power_j, 0.0);
    of->for_power_j = bev_maximum(for_power_j, of->for_power_j);
  }
  return status;
}

bev_status bev_price_of_lateness(recursion *of, int32_t k, const layer *next) {
  const double start_c = of->path_c[k] - of->under_way_k[k];
  const double starts[2][4] = {{of->soc[k], start_c - BEV_PRICED_K, 0.0, 0.0},
                               {of->soc[k], start_c + BEV_PRICED_K, 0.0, 0.0}};
  step_end beside[2];
  int32_t found = 0;
  const bev_status status = drive_beside(of, k, next, starts, beside, &found);
  if (found != 0) {
    const double change_j = (beside[0].cost_j - beside[1].cost_j)
        - warmth_between(of, next, beside);
    const double left = exp(-of->trip->duration_s[k] / of->lag_s);
    /* Another kelvin of heat repairs it. */
    of->late_price_j[k] = between(
        0.5 * change_j / BEV_PRICED_K + left * of->late_price_j[k + 1], of->joules_per_k);
  }
  return status;
}

void bev_watch_step(const recursion *of, int32_t k, const layer layers[2]) {
  const bev_trip *trip = of->trip;
  const double idle_w = trip->idle_power_w[k];
  const double variance_w2 = trip->power_variance_w2[k];
  const int32_t may_charge = trip->propulsion_power_w[k] < 0.0 ? 1 : 0;
  uint8_t overcharge = 0u;
  uint8_t overdraw = 0u;
  for (int32_t n = 0; n < 4; n++) {
    const int32_t end = n % 2;
    const layer *at = &layers[end];
    const double soc = of->soc[k + end];
    const double settled_c = n < 2 ? at->least_c - BEV_WATCHED_BELOW_K
                                   : at->least_c + (double)at->points * at->step_k;
    const double temperature_c = settled_c - of->under_way_k[k + end];
    double limits_w[2];
    /* Not a number: it may. */
    if (overdraw == 0u) {
      bev_terminal_limits(of->vehicle, 0, bev_maximum(soc - BEV_WATCHED_SOC, 0.0), temperature_c,
                          variance_w2, limits_w);
      overdraw = idle_w + bev_drawing_limit_w(trip, k) <= limits_w[1] ? overdraw : 1u;
    }
    if (may_charge != 0 && overcharge == 0u) {
      bev_terminal_limits(of->vehicle, 0, bev_minimum(soc + BEV_WATCHED_SOC, 1.0), temperature_c,
                          variance_w2, limits_w);
      overcharge = idle_w >= limits_w[0] ? overcharge : 1u;
    }
  }
  of->layers_overcharge[k] = overcharge;
  of->layers_overdraw[k] = overdraw;
}

/* Of a joule that the heater is still to draw, the battery's part: surplus on the path covers the rest. */
static void price_what_is_due(const recursion *of) {
  const bev_trip *trip = of->trip;
  for (int32_t k = trip->steps - 1; k >= 0; k--) {
    const double left = exp(-trip->duration_s[k] / of->vehicle->heater_lag_s);
    double paid = 1.0;
    if (trip->propulsion_power_w[k] < 0.0 && trip->heater_limit_w[k] > 0.0) {
      double limits_w[2];
      bev_terminal_limits(of->vehicle, 0, of->soc[k], of->path_c[k] - of->under_way_k[k],
                          trip->power_variance_w2[k], limits_w);
      paid = 1.0 - bev_minimum(bev_maximum((limits_w[0] - trip->idle_power_w[k])
                                               / trip->heater_limit_w[k], 0.0), 1.0);
    }
    of->due_price[k] = (1.0 - left) * paid + left * of->due_price[k + 1];
  }
}

double bev_keep_path(const recursion *of, const double *states) {
  const int32_t steps = of->trip->steps;
  double moved_k = 0.0;
  for (int32_t k = 0; k <= steps; k++) {
    const double here[4] = {states[k], states[steps + 1 + k], states[2 * (steps + 1) + k],
                            states[3 * (steps + 1) + k]};
    of->soc[k] = here[0];
    of->under_way_k[k] = under_way_k(of, k, here);
    const double path_c = here[1] + of->under_way_k[k];
    moved_k = bev_maximum(moved_k, fabs(path_c - of->path_c[k]));
    of->path_c[k] = path_c;
  }
  if (of->vehicle->heater_lag_s > 0.0) {
    price_what_is_due(of);
  }
  return moved_k;
}

void bev_forget_prices(const recursion *of) {
  for (int32_t k = 0; k <= of->trip->steps; k++) {
    of->price_j[k] = 0.0;
    of->late_price_j[k] = 0.0;
    of->due_price[k] = 1.0;
  }
}
