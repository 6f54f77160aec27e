/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The value of a temperature at each instant, backward, and the plan from it, forward:
 * bev_preheat.planning.value_function.
 */
#include <string.h>

#include "bev_preheat_core_generated/constants.h"
#include "checks.h"
#include "limited_step.h"

/* The ends of a step: heater off, with the surplus, at full power. */
#define MOST_ENDS 3
#define PASSES 5

/* How far the temperatures of a pass lie apart, and how far they reach to both sides of the path; 0: everywhere. */
static const double STEPS_K[PASSES] = {BEV_FIRST_STEP_K, BEV_WIDE_STEP_K, BEV_WIDE_STEP_K,
                                       BEV_NARROW_STEP_K, BEV_LAST_STEP_K};
static const double HALF_WIDTHS_K[PASSES] = {0.0, BEV_WIDE_K, BEV_WIDE_K, BEV_NARROW_K,
                                             BEV_LAST_K};

/* Values at one instant: `points` temperatures from `least_c` on; heater off or on in the step before. */
typedef struct {
  double least_c;
  double step_k;
  int32_t points;
  double *off_j;
  double *on_j;
} layer;

typedef struct {
  double states[4];
  double powers_w[4];
  /* Battery energy, with the penalties of the step [J]. */
  double cost_j;
  /* The temperature that the battery comes to from the heat already in heater and coolant. */
  double settled_c;
  double wanted_w;
  int32_t takes_surplus;
} step_end;

/* A mixture of an end and the next one: `share` of the next one. */
typedef struct {
  double value_j;
  double share;
  int32_t end;
  int32_t is_heating;
} mixture;

typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  const bev_value_goal *goal;
  /* Without and with surplus: as the vehicle is driven, and as the recursion sees it, with heat at once. */
  bev_limited_run driven[2];
  bev_limited_run at_once[2];
  /* Where a limit may matter: on any run, and within the layers. */
  uint8_t *overcharge;
  uint8_t *overdraw;
  uint8_t *layers_overcharge;
  uint8_t *layers_overdraw;
  double joules_per_k;
  double lag_s;
  double coolant_lag_s;
  /* Time to go [s]; of a step's heat in the battery, and of its heat from the heater, the share there at the end. */
  double *left_s;
  double *kept_share;
  double *arriving_share;
  /* The path before: charge, settled temperature, heat under way [K]; the worth of charge beyond its energy [J]. */
  double *soc;
  double *path_c;
  double *under_way_k;
  double *price_j;
  double *commands_w;
  double *tried_w;
  double *values_j;
  /* The best run so far: states, powers. */
  double *kept;
  /* Cost of a joule that the battery cannot deliver. */
  double lack_price;
  int32_t halvings;
  int32_t has_prices;
} recursion;

static double voltage_v(const recursion *of, double soc, double temperature_c) {
  return bev_at(&of->vehicle->open_circuit_voltage, 0, soc, temperature_c);
}

static double joules_of_charge(const recursion *of, double voltage) {
  return of->vehicle->capacity_ah * 3600.0 * voltage;
}

/* The layer at instant k around the path; in the first pass over all temperatures. */
static layer layer_at(const recursion *of, int32_t k, int32_t number, const double range_c[2]) {
  const double half_k = HALF_WIDTHS_K[number];
  const double low_c = number == 0 ? range_c[0] : of->path_c[k] - half_k;
  const double high_c = number == 0 ? range_c[1] : of->path_c[k] + half_k;
  layer at = {low_c, STEPS_K[number], 0, &of->values_j[(size_t)k * 2u * BEV_VALUE_POINTS], NULL};
  const double points = (high_c - low_c) / at.step_k + 2.0;
  if (points > (double)BEV_VALUE_POINTS) {
    at.points = BEV_VALUE_POINTS;
    at.step_k = (high_c - low_c) / (double)(BEV_VALUE_POINTS - 1);
  } else {
    at.points = (int32_t)points;
  }
  at.on_j = &at.off_j[BEV_VALUE_POINTS];
  return at;
}

/* The value of a temperature; outside its layer the path must come back. */
static double worth_j(const recursion *of, const layer *at, double temperature_c, int32_t is_on) {
  const double *values_j = is_on != 0 ? at->on_j : at->off_j;
  const double place = (temperature_c - at->least_c) / at->step_k;
  const int32_t last = at->points - 1;
  if (!(place > 0.0)) {
    return values_j[0] - place * at->step_k * 2.0 * BEV_SHORT_PRICE * of->joules_per_k;
  }
  if (place >= (double)last) {
    return values_j[last]
        + (place - (double)last) * at->step_k * BEV_BEYOND_PRICE * of->joules_per_k;
  }
  const int32_t n = (int32_t)place;
  return values_j[n] + (place - (double)n) * (values_j[n + 1] - values_j[n]);
}

/* Heat in heater and coolant that reaches the battery by the end of the trip, from instant k on [K]. */
static double under_way_k(const recursion *of, int32_t k, const double states[4]) {
  const bev_limited_run *run = &of->driven[0];
  if (run->is_direct != 0) {
    return 0.0;
  }
  const double heater = of->lag_s > 0.0 ? -expm1(-of->left_s[k] / of->lag_s) : 1.0;
  const double coolant =
      of->coolant_lag_s > 0.0 ? -expm1(-of->left_s[k] / of->coolant_lag_s) : 0.0;
  return heater * run->k_per_watt * states[2] + coolant * run->share_of_excess * states[3];
}

/* Power of a step beyond the discharge limit at either end [W]. */
static double lacking_w(const recursion *of, int32_t k, const double start[4],
                        const step_end *end, double terminal_w) {
  const double variance_w2 = of->trip->power_variance_w2[k];
  double at_start_w[2];
  double at_end_w[2];
  bev_terminal_limits(of->vehicle, 0, start[0], start[1], variance_w2, at_start_w);
  bev_terminal_limits(of->vehicle, 0, end->states[0], end->states[1], variance_w2, at_end_w);
  const double beyond_w = terminal_w - bev_minimum(at_start_w[1], at_end_w[1]);
  return beyond_w > BEV_LACK_TOLERANCE_W ? beyond_w : 0.0;
}

/* A step without an active limit, heated as wanted. */
static int is_free_step(const recursion *of, int32_t k, const double start[4], step_end *end) {
  if (of->layers_overcharge[k] != 0u || of->layers_overdraw[k] != 0u
      || start[1] >= of->vehicle->highest_c
      || (end->wanted_w > 0.0 && of->vehicle->heater_lag_s > 0.0)) {
    /* A heater with lag is switched off in time before other steps. */
    return 0;
  }
  double result[4];
  bev_inputs inputs = bev_inputs_of(of->vehicle, of->trip, k, NULL, NULL);
  inputs.power_w = inputs.power_w + end->wanted_w;
  inputs.heat_w = bev_heat_with_heater_w(of->vehicle, inputs.heat_w, end->wanted_w);
  bev_integrate(of->vehicle, BEV_RUNGE_KUTTA_4, 1, start[0], start[1], &inputs, result);
  if (!(result[0] > 0.0 && result[0] <= 1.0)
      || (end->wanted_w > 0.0 && !(result[1] <= of->vehicle->highest_c))) {
    return 0;
  }
  end->states[0] = result[0];
  end->states[1] = result[1];
  end->powers_w[0] = end->wanted_w;
  end->cost_j = (inputs.power_w + result[3]) * inputs.duration_s;
  return 1;
}

/* Drive step k to the end whose `wanted_w` and `takes_surplus` are given. */
static bev_status drive_step(const recursion *of, int32_t k, const double start[4],
                             int32_t is_ahead, step_end *end) {
  end->states[2] = 0.0;
  end->states[3] = 0.0;
  end->powers_w[1] = 0.0;
  if (is_ahead != 0 && is_free_step(of, k, start, end) != 0) {
    return BEV_OK;
  }
  const bev_limited_run *runs = is_ahead != 0 ? of->at_once : of->driven;
  const bev_limited_run *run = &runs[end->takes_surplus];
  const bev_status status =
      bev_drive_within_limits(run, k, start, end->wanted_w, end->states, end->powers_w);
  if (status != BEV_OK) {
    return status;
  }
  const double drawn_w = end->powers_w[run->is_direct != 0 ? 0 : 2];
  const double terminal_w = of->trip->idle_power_w[k] + drawn_w + end->powers_w[1];
  const double voltage = 0.5
      * (voltage_v(of, start[0], start[1]) + voltage_v(of, end->states[0], end->states[1]));
  end->cost_j = joules_of_charge(of, voltage) * (start[0] - end->states[0]);
  if (run->may_overdraw[k] != 0u && of->lack_price > 0.0) {
    end->cost_j += of->lack_price * of->trip->duration_s[k]
        * lacking_w(of, k, start, end, terminal_w);
  }
  return BEV_OK;
}

/* Where the recursion sees the end of a step from a temperature on: heat counts as far as it arrives in time. */
static double seen_ahead_c(const recursion *of, int32_t k, double settled_c,
                           const double start[4], const step_end *end) {
  const double heater_k = of->vehicle->heater_efficiency * of->trip->duration_s[k]
      / of->vehicle->heat_capacity_j_per_k * end->powers_w[0];
  return settled_c + of->kept_share[k] * ((end->states[1] - start[1]) - heater_k)
      + of->arriving_share[k] * heater_k;
}

/* The ends of step k; `charge_j` is what charge is worth there. A step that empties the battery has none. */
static bev_status ends_of_step(const recursion *of, int32_t k, const double start[4],
                               double settled_c, int32_t is_ahead, step_end ends[MOST_ENDS],
                               int32_t *count) {
  const double full_w = of->trip->heater_limit_w[k];
  const uint8_t *overcharge = is_ahead != 0 ? of->layers_overcharge : of->overcharge;
  int32_t found = 0;
  *count = 0;
  for (int32_t kind = 0; kind < MOST_ENDS; kind++) {
    step_end *end = &ends[found];
    if ((kind == 1 && (overcharge[k] == 0u || !(ends[0].powers_w[1] > 0.0)))
        || (kind == 2 && !(full_w > BEV_LEAST_HEATING_W))) {
      continue;
    }
    end->wanted_w = kind == 2 ? full_w : 0.0;
    end->takes_surplus = kind == 0 ? 0 : 1;
    const bev_status status = drive_step(of, k, start, is_ahead, end);
    if (status == BEV_EMPTY && kind > 0) {
      break;
    }
    if (status != BEV_OK) {
      return status;
    }
    if (kind > 0 && !(end->powers_w[0] > ends[found - 1].powers_w[0] + BEV_SAME_END_W)) {
      continue;
    }
    if (is_ahead != 0) {
      end->settled_c = seen_ahead_c(of, k, settled_c, start, end);
    } else {
      end->settled_c = end->states[1] + under_way_k(of, k + 1, end->states);
      if (of->driven[0].is_direct == 0) {
        /* Power that the heater is going to draw is paid for with the command. */
        end->cost_j += (end->powers_w[0] - end->powers_w[2]) * of->trip->duration_s[k];
      }
    }
    end->cost_j += of->price_j[k + 1] * (end->states[0] - of->soc[k + 1]);
    found++;
  }
  *count = found;
  return BEV_OK;
}

/* Compare a mixture with the best one. */
static void try_mixture(const recursion *of, const step_end ends[MOST_ENDS], int32_t count,
                        const layer *next, int32_t was_on, int32_t end, double share,
                        mixture *best) {
  const step_end *low = &ends[end];
  const step_end *high = &ends[end + 1 < count ? end + 1 : end];
  const double power_w = low->powers_w[0] + share * (high->powers_w[0] - low->powers_w[0]);
  const double settled_c = low->settled_c + share * (high->settled_c - low->settled_c);
  const int32_t is_heating = power_w > BEV_LEAST_HEATING_W ? 1 : 0;
  const double value_j = low->cost_j + share * (high->cost_j - low->cost_j)
      + worth_j(of, next, settled_c, is_heating)
      + (is_heating != 0 && was_on == 0 ? BEV_SWITCH_ON_WH * BEV_JOULES_PER_WH : 0.0);
  if (value_j < best->value_j) {
    best->value_j = value_j;
    best->share = share;
    best->end = end;
    best->is_heating = is_heating;
  }
}

/* The best mixture of two neighbouring ends. */
static mixture best_of(const recursion *of, const step_end ends[MOST_ENDS], int32_t count,
                       const layer *next, int32_t was_on) {
  mixture best = {INFINITY, 0.0, 0, 0};
  for (int32_t end = 0; end < count; end++) {
    try_mixture(of, ends, count, next, was_on, end, 0.0, &best);
    if (end + 1 < count) {
      try_mixture(of, ends, count, next, was_on, end, 0.5, &best);
    }
  }
  double apart = 0.25;
  for (int32_t n = 0; n < of->halvings; n++) {
    const mixture middle = best;
    if (middle.end + 1 < count && middle.share + apart < 1.0) {
      try_mixture(of, ends, count, next, was_on, middle.end, middle.share + apart, &best);
    }
    if (middle.share - apart > 0.0) {
      try_mixture(of, ends, count, next, was_on, middle.end, middle.share - apart, &best);
    } else if (middle.share == 0.0 && middle.end > 0) {
      try_mixture(of, ends, count, next, was_on, middle.end - 1, 1.0 - apart, &best);
    } else {
      /* The neighbour is an end that has been tried. */
    }
    apart = 0.5 * apart;
  }
  return best;
}

/*
 * What charge at instant k is worth beyond its energy [J]: how the cost on the path changes with it, heated as it is
 * best there. That the battery delivers less with less charge is left out: heat repairs it, at the price of heat.
 */
static bev_status price_of_charge(recursion *of, int32_t k, const layer *next) {
  const double least_soc = bev_maximum(of->soc[k] - BEV_PRICED_SOC, BEV_PRICED_SOC);
  const double most_soc = bev_minimum(of->soc[k] + BEV_PRICED_SOC, 1.0);
  const double start_c = of->path_c[k] - of->under_way_k[k];
  const double lack_price = of->lack_price;
  double start[4] = {of->soc[k], start_c, 0.0, 0.0};
  step_end ends[MOST_ENDS];
  step_end moved[2];
  int32_t count = 0;
  of->price_j[k] = 0.0;
  if (!(most_soc > least_soc)) {
    return BEV_OK;
  }
  of->lack_price = 0.0;
  bev_status status = ends_of_step(of, k, start, of->path_c[k], 1, ends, &count);
  if (status == BEV_OK && count > 0) {
    const mixture best = best_of(of, ends, count, next, 1);
    for (int32_t n = 0; status == BEV_OK && n < 2; n++) {
      moved[n] = ends[best.end];
      if (best.share > 0.0) {
        const step_end *high = &ends[best.end + 1];
        moved[n].wanted_w = moved[n].powers_w[0]
            + best.share * (high->powers_w[0] - moved[n].powers_w[0]);
        moved[n].takes_surplus = 1;
      }
      start[0] = n == 0 ? least_soc : most_soc;
      status = drive_step(of, k, start, 1, &moved[n]);
      moved[n].settled_c = seen_ahead_c(of, k, of->path_c[k], start, &moved[n]);
    }
    if (status == BEV_OK) {
      const double most_j =
          of->joules_per_k * fabs(moved[1].settled_c - moved[0].settled_c);
      const double warmth_j = worth_j(of, next, moved[1].settled_c, 1)
          - worth_j(of, next, moved[0].settled_c, 1);
      const double charge_j =
          of->price_j[k + 1] * (moved[1].states[0] - moved[0].states[0]);
      of->price_j[k] = ((moved[1].cost_j - moved[0].cost_j) + charge_j
                        + bev_maximum(bev_minimum(warmth_j, most_j), -most_j))
          / (most_soc - least_soc);
    }
  }
  of->lack_price = lack_price;
  return status == BEV_EMPTY ? BEV_OK : status;
}

/* Where a limit may matter within the layers of two neighbouring instants. */
static void watch_step(const recursion *of, int32_t k, const layer layers[2]) {
  const bev_trip *trip = of->trip;
  const double idle_w = trip->idle_power_w[k];
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
    bev_terminal_limits(of->vehicle, 0, bev_maximum(soc - BEV_WATCHED_SOC, 0.0), temperature_c,
                        trip->power_variance_w2[k], limits_w);
    /* Not a number: it may. */
    overdraw = idle_w + trip->heater_limit_w[k] <= limits_w[1] ? overdraw : 1u;
    bev_terminal_limits(of->vehicle, 0, bev_minimum(soc + BEV_WATCHED_SOC, 1.0), temperature_c,
                        trip->power_variance_w2[k], limits_w);
    overcharge = idle_w >= limits_w[0] ? overcharge : 1u;
  }
  of->layers_overcharge[k] = trip->propulsion_power_w[k] < 0.0 ? overcharge : 0u;
  of->layers_overdraw[k] = overdraw;
}

/* The backward pass: the values of all layers, from that of the arrival at `aim_c`. */
static bev_status find_values(recursion *of, int32_t number, const double range_c[2],
                              double aim_c) {
  const int32_t steps = of->trip->steps;
  layer layers[2];
  layers[1] = layer_at(of, steps, number, range_c);
  for (int32_t n = 0; n < layers[1].points; n++) {
    const double short_k =
        bev_maximum(aim_c - (layers[1].least_c + (double)n * layers[1].step_k), 0.0);
    layers[1].off_j[n] = short_k * of->joules_per_k * BEV_SHORT_PRICE;
    layers[1].on_j[n] = layers[1].off_j[n];
  }
  of->price_j[steps] = 0.0;
  for (int32_t k = steps - 1; k >= 0; k--) {
    layers[0] = layer_at(of, k, number, range_c);
    watch_step(of, k, layers);
    for (int32_t n = 0; n < layers[0].points; n++) {
      const double settled_c = layers[0].least_c + (double)n * layers[0].step_k;
      const double start[4] = {of->soc[k], settled_c - of->under_way_k[k], 0.0, 0.0};
      step_end ends[MOST_ENDS];
      int32_t count = 0;
      const bev_status status = ends_of_step(of, k, start, settled_c, 1, ends, &count);
      if (status != BEV_OK && status != BEV_EMPTY) {
        return status;
      }
      layers[0].off_j[n] =
          count == 0 ? BEV_EMPTY_J : best_of(of, ends, count, &layers[1], 0).value_j;
      layers[0].on_j[n] =
          count == 0 ? BEV_EMPTY_J : best_of(of, ends, count, &layers[1], 1).value_j;
    }
    of->price_j[k] = 0.0;
    if (of->has_prices != 0) {
      const bev_status status = price_of_charge(of, k, &layers[1]);
      if (status != BEV_OK) {
        return status;
      }
    }
    layers[1] = layers[0];
  }
  return BEV_OK;
}

/* Write the end of step k into the run. */
static void write_step(const recursion *of, int32_t k, const step_end *end, double *states,
                       double *powers_w) {
  const int32_t steps = of->trip->steps;
  for (int32_t n = 0; n < 4; n++) {
    states[n * (steps + 1) + k + 1] = end->states[n];
    powers_w[n * steps + k] = end->powers_w[n];
  }
}

/* The forward pass: in each step the best end. */
static bev_status find_path(const recursion *of, int32_t number, const double range_c[2],
                            double *states, double *powers_w) {
  const int32_t steps = of->trip->steps;
  int32_t is_on = of->goal->is_heating;
  for (int32_t k = 0; k < steps; k++) {
    const double start[4] = {states[k], states[steps + 1 + k], states[2 * (steps + 1) + k],
                             states[3 * (steps + 1) + k]};
    const layer next = layer_at(of, k + 1, number, range_c);
    step_end ends[MOST_ENDS];
    int32_t count = 0;
    bev_status status = ends_of_step(of, k, start, 0.0, 0, ends, &count);
    if (status != BEV_OK) {
      return status;
    }
    const mixture best = best_of(of, ends, count, &next, is_on);
    step_end *end = &ends[best.end];
    if (best.share > 0.0) {
      end->wanted_w =
          end->powers_w[0] + best.share * (ends[best.end + 1].powers_w[0] - end->powers_w[0]);
      end->takes_surplus = 0;
      status = drive_step(of, k, start, 0, end);
      if (status != BEV_OK) {
        return status;
      }
    }
    write_step(of, k, end, states, powers_w);
    is_on = best.is_heating;
  }
  return BEV_OK;
}

/* Drive the commands from step `first` on; null: only surplus heats. */
static bev_status drive_commands(const recursion *of, const double *commands_w, int32_t first,
                                 double *states, double *powers_w) {
  const int32_t steps = of->trip->steps;
  for (int32_t k = first; k < steps; k++) {
    const double start[4] = {states[k], states[steps + 1 + k], states[2 * (steps + 1) + k],
                             states[3 * (steps + 1) + k]};
    step_end end;
    end.wanted_w = commands_w == NULL ? 0.0 : commands_w[k];
    end.takes_surplus = commands_w == NULL ? 1 : 0;
    const bev_status status = drive_step(of, k, start, 0, &end);
    if (status != BEV_OK) {
      return status;
    }
    write_step(of, k, &end, states, powers_w);
  }
  return BEV_OK;
}

/* The commands with more energy just before `start`, or less from it on [J]; the first step that is changed. */
static int32_t move_start(const recursion *of, int32_t start, double more_j) {
  const bev_trip *trip = of->trip;
  double left_j = fabs(more_j);
  int32_t k = start;
  memcpy(of->tried_w, of->commands_w, (size_t)trip->steps * sizeof(double));
  for (; k >= 0 && k < trip->steps && left_j > 0.0; k += more_j > 0.0 ? -1 : 1) {
    const double room_w =
        more_j > 0.0 ? trip->heater_limit_w[k] - of->tried_w[k] : of->tried_w[k];
    const double moved_j = bev_minimum(bev_maximum(room_w, 0.0) * trip->duration_s[k], left_j);
    of->tried_w[k] += (more_j > 0.0 ? moved_j : -moved_j) / trip->duration_s[k];
    left_j -= moved_j;
  }
  return more_j > 0.0 ? (k + 1 < start ? k + 1 : start) : start;
}

/* How much warmer than needed the battery arrives [K]: than the target, or than the reserve of charge allows. */
static double beyond_k(const recursion *of, const double *states, int32_t is_short_of_charge) {
  const int32_t steps = of->trip->steps;
  const double arrival_c = states[steps + 1 + steps];
  const double per_soc_k =
      joules_of_charge(of, voltage_v(of, states[steps], arrival_c)) / of->joules_per_k;
  return is_short_of_charge != 0 ? (of->goal->lowest_soc - states[steps]) * per_soc_k
                                 : arrival_c - of->goal->target_c;
}

/* Move the start of the last interval, so that the arrival is exact. */
static bev_status arrive_exactly(const recursion *of, double *states, double *powers_w) {
  const int32_t steps = of->trip->steps;
  const double *commands_w = powers_w;
  int32_t start = steps - 1;
  while (start >= 0
         && !(commands_w[start] > BEV_LEAST_HEATING_W && powers_w[steps + start] <= 1.0
              && (start == 0 || commands_w[start - 1] <= BEV_LEAST_HEATING_W))) {
    start--;
  }
  const double to_target_k = beyond_k(of, states, 0);
  const double to_reserve_k = beyond_k(of, states, 1);
  const int32_t is_short_of_charge = to_target_k < 0.0 && to_reserve_k > to_target_k ? 1 : 0;
  double excess_k = is_short_of_charge != 0 ? to_reserve_k : to_target_k;
  if (start < 0 || !(fabs(excess_k) <= BEV_MOVED_K)) {
    return BEV_OK;
  }
  double moved_j = 0.0;
  double next_j = -excess_k * of->joules_per_k;
  memcpy(of->commands_w, commands_w, (size_t)steps * sizeof(double));
  for (int32_t n = 0; n < BEV_MOST_TRIALS && fabs(excess_k) > BEV_ARRIVAL_TOLERANCE_K; n++) {
    const int32_t first = move_start(of, start, next_j);
    const bev_status status = drive_commands(of, of->tried_w, first, states, powers_w);
    if (status != BEV_OK) {
      return status;
    }
    const double found_k = beyond_k(of, states, is_short_of_charge);
    const double slope = (found_k - excess_k) / (next_j - moved_j);
    moved_j = next_j;
    excess_k = found_k;
    if (!isfinite(slope) || slope == 0.0) {
      break;
    }
    next_j = moved_j - excess_k / slope;
  }
  return BEV_OK;
}

/* Keep the run as the path for the next pass; how far it lies from the path before [K]. */
static double keep_path(const recursion *of, const double *states) {
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
  return moved_k;
}

/* The cost of a run [J]: battery energy, power deficit, switching on, missed target and reserve. */
static double cost_of_run(const recursion *of, const double *states, const double *powers_w,
                          double aim_c) {
  const int32_t steps = of->trip->steps;
  const int32_t drawn = of->driven[0].is_direct != 0 ? 0 : 2;
  int32_t was_on = of->goal->is_heating;
  double cost_j = 0.0;
  double voltage = voltage_v(of, states[0], states[steps + 1]);
  for (int32_t k = 0; k < steps; k++) {
    const double start[4] = {states[k], states[steps + 1 + k], 0.0, 0.0};
    const step_end end = {{states[k + 1], states[steps + 2 + k], 0.0, 0.0}, {0.0}, 0.0, 0.0, 0.0, 0};
    const double next_voltage = voltage_v(of, end.states[0], end.states[1]);
    const double terminal_w =
        of->trip->idle_power_w[k] + powers_w[drawn * steps + k] + powers_w[steps + k];
    const int32_t is_on = powers_w[k] > BEV_LEAST_HEATING_W ? 1 : 0;
    cost_j += joules_of_charge(of, 0.5 * (voltage + next_voltage)) * (start[0] - end.states[0])
        + of->lack_price * of->trip->duration_s[k] * lacking_w(of, k, start, &end, terminal_w)
        + (is_on != 0 && was_on == 0 ? BEV_SWITCH_ON_WH * BEV_JOULES_PER_WH : 0.0);
    was_on = is_on;
    voltage = next_voltage;
  }
  const double short_k = bev_maximum(aim_c - states[steps + 1 + steps], 0.0)
      + bev_maximum(beyond_k(of, states, 1), 0.0);
  return cost_j + BEV_SHORT_PRICE * of->joules_per_k * short_k;
}

/* The temperatures of the first pass: those of the unheated run, target and warmer. */
static void range_of(const recursion *of, double range_c[2]) {
  const double target_c = of->goal->target_c;
  range_c[0] = bev_minimum(of->path_c[0], target_c);
  for (int32_t k = 1; k <= of->trip->steps; k++) {
    range_c[0] = bev_minimum(range_c[0], of->path_c[k]);
  }
  range_c[0] -= BEV_BELOW_K;
  range_c[1] = bev_minimum(bev_maximum(of->path_c[0], target_c) + BEV_ABOVE_K,
                           of->vehicle->highest_c + BEV_BELOW_K);
}

/* The run of all passes. */
static bev_status plan(recursion *of, double *states, double *powers_w) {
  const int32_t steps = of->trip->steps;
  const double target_c = of->goal->target_c;
  double range_c[2];
  double aim_c = target_c;
  const size_t rows = 4u * ((size_t)steps + 1u);
  int32_t looks = 0;
  int32_t is_priced = 1;
  bev_status status = drive_commands(of, NULL, 0, states, powers_w);
  if (status != BEV_OK) {
    return status;
  }
  (void)keep_path(of, states);
  range_of(of, range_c);
  for (int32_t number = 0; number < PASSES;) {
    of->halvings = number == 0 ? 0 : BEV_MIXTURE_HALVINGS;
    of->has_prices = number == 0 ? 0 : is_priced;
    status = find_values(of, number, range_c, aim_c);
    if (status == BEV_OK) {
      status = find_path(of, number, range_c, states, powers_w);
    }
    if (status != BEV_OK) {
      return status;
    }
    if (number > 0 && cost_of_run(of, states, powers_w, aim_c)
                          > cost_of_run(of, of->kept, &of->kept[rows], aim_c)) {
      /* No pass makes the plan worse: charge may be priced wrongly, as limits bend. */
      memcpy(states, of->kept, rows * sizeof(double));
      memcpy(powers_w, &of->kept[rows], 4u * (size_t)steps * sizeof(double));
      looks = is_priced != 0 ? looks : 0;
      number += is_priced != 0 ? 0 : 1;
      is_priced = is_priced != 0 ? 0 : 1;
      continue;
    }
    memcpy(of->kept, states, rows * sizeof(double));
    memcpy(&of->kept[rows], powers_w, 4u * (size_t)steps * sizeof(double));
    const double moved_k = keep_path(of, states);
    /* The reserve of charge allows this temperature. */
    const double spare_k = -beyond_k(of, states, 1);
    const double reached_c = states[steps + 1 + steps] + spare_k;
    const int32_t is_short = spare_k < 0.0 || aim_c < target_c ? 1 : 0;
    aim_c = is_short != 0 ? bev_minimum(target_c, reached_c) : aim_c;
    looks++;
    const int32_t is_found =
        number == 0 ? is_short == 0 || fabs(spare_k) < BEV_NEAR_RESERVE_K
                    : moved_k < BEV_EDGE_SHARE * HALF_WIDTHS_K[number];
    if (is_found != 0 || looks >= BEV_MOST_LOOKS) {
      number++;
      looks = 0;
      is_priced = 1;
    }
  }
  return arrive_exactly(of, states, powers_w);
}

/* What does not depend on the pass. */
static void prepare(recursion *of, double *memory, uint8_t *flags) {
  const bev_vehicle *vehicle = of->vehicle;
  const bev_trip *trip = of->trip;
  const size_t steps = (size_t)trip->steps;
  const int32_t is_direct = bev_is_direct(vehicle);
  const double battery_j_per_k = vehicle->heat_capacity_j_per_k;
  const double both_j_per_k = battery_j_per_k + vehicle->coolant_heat_capacity_j_per_k;
  of->overcharge = flags;
  of->overdraw = &flags[steps];
  of->layers_overcharge = &flags[2u * steps];
  of->layers_overdraw = &flags[3u * steps];
  of->left_s = memory;
  of->soc = &of->left_s[steps + 1u];
  of->path_c = &of->soc[steps + 1u];
  of->under_way_k = &of->path_c[steps + 1u];
  of->price_j = &of->under_way_k[steps + 1u];
  of->kept_share = &of->price_j[steps + 1u];
  of->arriving_share = &of->kept_share[steps];
  of->commands_w = &of->arriving_share[steps];
  of->tried_w = &of->commands_w[steps];
  of->kept = &of->tried_w[steps];
  of->values_j = &of->kept[8u * steps + 4u];
  of->joules_per_k = both_j_per_k / vehicle->heater_efficiency;
  of->coolant_lag_s = bev_heat_lag_s(vehicle) - vehicle->heater_lag_s;
  of->lag_s = bev_heat_lag_s(vehicle);
  for (int32_t n = 0; n < 2; n++) {
    of->driven[n] = bev_limited_run_of(vehicle, trip, of->overcharge, of->overdraw, n, is_direct);
    of->at_once[n] =
        bev_limited_run_of(vehicle, trip, of->layers_overcharge, of->layers_overdraw, n, 1);
    /* A heater with lag is switched off in time, and not on for a short surplus. */
    of->at_once[n].lag_s = vehicle->heater_lag_s;
  }
  of->left_s[steps] = 0.0;
  of->price_j[steps] = 0.0;
  for (int32_t k = trip->steps - 1; k >= 0; k--) {
    const double duration_s = trip->duration_s[k];
    const double after_s = of->left_s[k + 1];
    of->overcharge[k] = trip->propulsion_power_w[k] < 0.0 ? 1u : 0u;
    of->overdraw[k] = 1u;
    of->price_j[k] = 0.0;
    of->left_s[k] = after_s + duration_s;
    of->kept_share[k] = 1.0;
    of->arriving_share[k] = 1.0;
    if (of->coolant_lag_s > 0.0) {
      of->kept_share[k] += of->driven[0].share_of_excess
          * expm1(-(after_s + 0.5 * duration_s) / of->coolant_lag_s);
    }
    if (of->lag_s > 0.0) {
      const double mean_left = -expm1(-duration_s / of->lag_s) * of->lag_s / duration_s;
      of->arriving_share[k] =
          battery_j_per_k / both_j_per_k * (1.0 - exp(-after_s / of->lag_s) * mean_left);
    }
  }
}

bev_status bev_plan_by_values(const bev_vehicle *vehicle, const bev_trip *trip,
                              const bev_value_goal *goal, double *states, double *powers_w,
                              uint8_t *flags, double *memory) {
  const bev_status checked = bev_checked(vehicle, trip, 0);
  if (checked != BEV_OK) {
    return checked;
  }
  if (goal == NULL || states == NULL || powers_w == NULL || flags == NULL || memory == NULL
      || trip->steps < 1) {
    return BEV_BAD_ARGUMENT;
  }
  if (!isfinite(goal->target_c) || !isfinite(goal->lowest_soc) || !bev_is_time(trip)) {
    return BEV_BAD_INPUT;
  }
  const int32_t steps = trip->steps;
  recursion of;
  memset(&of, 0, sizeof(of));
  of.vehicle = vehicle;
  of.trip = trip;
  of.goal = goal;
  prepare(&of, memory, flags);
  of.lack_price = BEV_LACK_PRICE;
  bev_status status = plan(&of, states, powers_w);
  if (status == BEV_EMPTY
      || (status == BEV_OK && states[steps] < goal->lowest_soc - BEV_RESERVE_TOLERANCE)) {
    /* The reserve comes before the power of climbs. */
    of.lack_price = 0.0;
    status = plan(&of, states, powers_w);
  }
  return status;
}
