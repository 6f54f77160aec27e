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

/* Limits that act in a step. */
#define LIMITED_COMMAND 1u
#define BRAKED 2u
#define LACKING 4u

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
  /* The limits that act: command, brake, missing power. */
  uint32_t regime;
} step_end;

/* The ends of a step from one temperature. */
typedef struct {
  step_end ends[MOST_ENDS];
  int32_t count;
} step_ends;

/* A mixture of an end and the next one: `share` of the next one. */
typedef struct {
  double value_j;
  double share;
  int32_t end;
  int32_t is_heating;
} mixture;

/* The best mixtures that do not heat, and that do: without the price of switching on. */
typedef struct {
  mixture unheated;
  mixture heated;
} choice;

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
  /* Of a step's heat from the heater, the share still under way at its end, and how that decays over a step. */
  double *late_share;
  /* The path before: charge, settled temperature, heat under way [K]; the worth of charge beyond its energy [J]. */
  double *soc;
  double *path_c;
  double *under_way_k;
  double *price_j;
  /* The cost of a kelvin that is still under way at an instant [J]. */
  double *late_price_j;
  /* Of a joule that the heater is still to draw at an instant, the battery's part; its share of a step's. */
  double *due_share;
  double *due_price;
  double *commands_w;
  double *tried_w;
  /* Where the layers lie: the first temperature of each, and what all have in common. */
  double *least_c;
  double step_k;
  int32_t points;
  /* Of what becomes known on the way, as far as the pass expects that. */
  double deviation_k;
  /* Every n-th layer is kept from the backward pass to the forward pass; the values of the layers. */
  int32_t kept_every;
  double *values_j;
  /* The best run so far: states, powers. */
  double *kept;
  /* Cost of a joule that the battery cannot deliver. */
  double lack_price;
  double switch_on_j;
  int32_t is_certain;
  int32_t has_prices;
  /* The largest power deficit of the unheated run [W]. */
  double unheated_lack_w;
} recursion;

static double voltage_v(const recursion *of, double soc, double temperature_c) {
  return bev_at(&of->vehicle->open_circuit_voltage, 0, soc, temperature_c);
}

/* The factor of battery energy in step k. */
static double price_in(const recursion *of, int32_t k) {
  return of->goal->price == NULL ? 1.0 : of->goal->price[k];
}

static double joules_of_charge(const recursion *of, double voltage) {
  return of->vehicle->capacity_ah * 3600.0 * voltage;
}

/*
 * Where the layer at instant k lies. Counted from the arrival, every `kept_every`-th has a place of its own; those in
 * between have the places that all blocks share.
 */
static double *values_at(const recursion *of, int32_t k) {
  const int32_t every = of->kept_every;
  const int32_t left = of->trip->steps - k;
  const int32_t place =
      left % every == 0 ? left / every : of->trip->steps / every + left % every;
  return &of->values_j[(size_t)place * 2u * BEV_VALUE_POINTS];
}

/* Place the layers of a pass around the path; those of the first pass at all temperatures of the range. */
static void place_layers(recursion *of, int32_t number, const double range_c[2]) {
  const double half_k =
      HALF_WIDTHS_K[number] + BEV_WIDER_DEVIATIONS * of->goal->deviation_k;
  const double wide_k = number == 0 ? range_c[1] - range_c[0] : 2.0 * half_k;
  const double points = wide_k / STEPS_K[number] + 2.0;
  const int32_t fits = points > (double)BEV_VALUE_POINTS ? 0 : 1;
  of->deviation_k = number == 0 ? 0.0 : of->goal->deviation_k;
  of->points = fits != 0 ? (int32_t)points : BEV_VALUE_POINTS;
  of->step_k = fits != 0 ? STEPS_K[number] : wide_k / (double)(BEV_VALUE_POINTS - 1);
  for (int32_t k = 0; k <= of->trip->steps; k++) {
    of->least_c[k] = number == 0 ? range_c[0] : of->path_c[k] - half_k;
  }
}

static layer layer_at(const recursion *of, int32_t k) {
  double *const values_j = values_at(of, k);
  const layer at = {of->least_c[k], of->step_k, of->points, values_j, &values_j[BEV_VALUE_POINTS]};
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
  end->cost_j = price_in(of, k) * (inputs.power_w + result[3]) * inputs.duration_s;
  return 1;
}

/* Drive step k to the end whose `wanted_w` and `takes_surplus` are given. */
static bev_status drive_step(const recursion *of, int32_t k, const double start[4],
                             int32_t is_ahead, step_end *end) {
  end->states[2] = 0.0;
  end->states[3] = 0.0;
  end->powers_w[1] = 0.0;
  end->regime = 0u;
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
  end->cost_j = price_in(of, k) * joules_of_charge(of, voltage) * (start[0] - end->states[0]);
  end->regime |= end->powers_w[0] != end->wanted_w ? LIMITED_COMMAND : 0u;
  end->regime |= end->powers_w[1] > 0.0 ? BRAKED : 0u;
  if (run->may_overdraw[k] != 0u && of->lack_price > 0.0) {
    const double lack_w = lacking_w(of, k, start, end, terminal_w);
    end->cost_j += of->lack_price * of->trip->duration_s[k] * lack_w;
    end->regime |= lack_w > 0.0 ? LACKING : 0u;
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

/*
 * The ends of step k from charge and temperature, heat under way left out, as the recursion sees them. A step that
 * empties the battery has none.
 */
static bev_status ends_of_step(const recursion *of, int32_t k, const double start[4],
                               double settled_c, step_end ends[MOST_ENDS], int32_t *count) {
  const double full_w = of->trip->heater_limit_w[k];
  int32_t found = 0;
  *count = 0;
  for (int32_t kind = 0; kind < MOST_ENDS; kind++) {
    step_end *end = &ends[found];
    if ((kind == 1 && (of->layers_overcharge[k] == 0u || !(ends[0].powers_w[1] > 0.0)))
        || (kind == 2 && !(full_w > BEV_LEAST_HEATING_W))) {
      continue;
    }
    end->wanted_w = kind == 2 ? full_w : 0.0;
    end->takes_surplus = kind == 0 ? 0 : 1;
    const bev_status status = drive_step(of, k, start, 1, end);
    if (status == BEV_EMPTY && kind > 0) {
      break;
    }
    if (status != BEV_OK) {
      return status;
    }
    if (kind > 0 && !(end->powers_w[0] > ends[found - 1].powers_w[0] + BEV_SAME_END_W)) {
      continue;
    }
    end->settled_c = seen_ahead_c(of, k, settled_c, start, end);
    end->cost_j += of->price_j[k + 1] * (end->states[0] - of->soc[k + 1]);
    found++;
  }
  *count = found;
  for (int32_t n = found - 1; n >= 0; n--) {
    /* Power that the heater draws later is paid for later; and late heat costs where limits miss it. */
    const double heater_j = ends[n].powers_w[0] * of->trip->duration_s[k];
    ends[n].cost_j += of->due_share[k]
            * (heater_j * of->due_price[k + 1] - (ends[n].cost_j - ends[0].cost_j))
        + of->late_price_j[k + 1] * of->late_share[k] * heater_j
            * of->vehicle->heater_efficiency / of->vehicle->heat_capacity_j_per_k
        + BEV_HEATING_PRICE * price_in(of, k) * heater_j;
  }
  return BEV_OK;
}

/* Compare a mixture with the best of its kind: heated or not. */
static void try_mixture(const recursion *of, const step_end ends[MOST_ENDS], const layer *next,
                        int32_t end, choice *best) {
  const int32_t is_heating = ends[end].powers_w[0] > BEV_LEAST_HEATING_W ? 1 : 0;
  const double value_j = ends[end].cost_j + worth_j(of, next, ends[end].settled_c, is_heating);
  mixture *const kind = is_heating != 0 ? &best->heated : &best->unheated;
  if (value_j < kind->value_j) {
    const mixture found = {value_j, 0.0, end, is_heating};
    *kind = found;
  }
}

/*
 * The best mixtures of an end and the next one, heated and not. Between the ends, the best lies at a temperature of
 * the next layer, as values are straight in between.
 */
static choice best_of(const recursion *of, const step_end ends[MOST_ENDS], int32_t count,
                      const layer *next) {
  choice best = {{INFINITY, 0.0, 0, 0}, {INFINITY, 0.0, 0, 1}};
  for (int32_t end = 0; end < count; end++) {
    try_mixture(of, ends, next, end, &best);
  }
  for (int32_t end = 0; of->is_certain != 0 && end + 1 < count; end++) {
    const step_end *low = &ends[end];
    const step_end *high = &ends[end + 1];
    const double wide_k = high->settled_c - low->settled_c;
    const double least_share =
        (bev_maximum(BEV_LEAST_HEATING_W, BEV_LEAST_SHARE * high->powers_w[0]) - low->powers_w[0])
        / (high->powers_w[0] - low->powers_w[0]);
    const double from =
        (low->settled_c + bev_maximum(least_share, 0.0) * wide_k - next->least_c) / next->step_k;
    const double to = (high->settled_c - next->least_c) / next->step_k;
    const double per_point_j = (high->cost_j - low->cost_j) / wide_k * next->step_k;
    if (!(wide_k > 0.0) || !(to > 0.0) || !(from < (double)(next->points - 1))) {
      continue;
    }
    const int32_t first = from < 0.0 ? 0 : (int32_t)from + 1;
    const int32_t last = to < (double)next->points ? (int32_t)to : next->points - 1;
    double least_j = INFINITY;
    int32_t found = first;
    for (int32_t n = first; n <= last; n++) {
      const double value_j = next->on_j[n] + (double)n * per_point_j;
      found = value_j < least_j ? n : found;
      least_j = bev_minimum(least_j, value_j);
    }
    const double low_place = (low->settled_c - next->least_c) / next->step_k;
    const double value_j = low->cost_j + least_j - low_place * per_point_j;
    if (value_j < best.heated.value_j) {
      best.heated.value_j = value_j;
      best.heated.share = ((double)found - low_place) / (to - low_place);
      best.heated.end = end;
    }
  }
  return best;
}

static double value_of(const recursion *of, const choice *best, int32_t was_on) {
  return bev_minimum(best->unheated.value_j,
                     best->heated.value_j + (was_on != 0 ? 0.0 : of->switch_on_j));
}

static mixture better_of(const recursion *of, const choice *best, int32_t was_on) {
  return best->unheated.value_j > value_of(of, best, was_on) ? best->heated : best->unheated;
}

/* Drive step k, heated as it is best on the path, from two starts beside it; none is `found` if that empties. */
static bev_status drive_beside(const recursion *of, int32_t k, const layer *next,
                               const double starts[2][4], step_end beside[2], int32_t *found) {
  const double start[4] = {of->soc[k], of->path_c[k] - of->under_way_k[k], 0.0, 0.0};
  step_end ends[MOST_ENDS];
  int32_t count = 0;
  *found = 0;
  bev_status status = ends_of_step(of, k, start, of->path_c[k], ends, &count);
  if (status != BEV_OK || count == 0) {
    return status == BEV_EMPTY ? BEV_OK : status;
  }
  const choice choices = best_of(of, ends, count, next);
  const mixture best = better_of(of, &choices, 1);
  for (int32_t n = 0; status == BEV_OK && n < 2; n++) {
    beside[n] = ends[best.end];
    if (best.share > 0.0) {
      const step_end *high = &ends[best.end + 1];
      beside[n].wanted_w = beside[n].powers_w[0]
          + best.share * (high->powers_w[0] - beside[n].powers_w[0]);
      beside[n].takes_surplus = 1;
    }
    status = drive_step(of, k, starts[n], 1, &beside[n]);
    beside[n].settled_c = seen_ahead_c(of, k, of->path_c[k], starts[n], &beside[n]);
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

/*
 * What charge at instant k is worth beyond its energy [J]: how the cost on the path changes with it, heated as it is
 * best there. That the battery delivers less with less charge is left out: heat repairs it, at the price of heat.
 */
static bev_status price_of_charge(recursion *of, int32_t k, const layer *next) {
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
  return status;
}

/* The cost of a kelvin that is still under way at instant k [J]: the battery is colder, and limits tighter. */
static bev_status price_of_lateness(recursion *of, int32_t k, const layer *next) {
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

/* Where a limit may matter within the layers of two neighbouring instants. */
static void watch_step(const recursion *of, int32_t k, const layer layers[2]) {
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
      overdraw = idle_w + trip->heater_limit_w[k] <= limits_w[1] ? overdraw : 1u;
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

/* The ends of step k from temperature n of a layer. */
static bev_status ends_from(const recursion *of, int32_t k, const layer *at, int32_t n,
                            step_ends *found) {
  const double settled_c = at->least_c + (double)n * at->step_k;
  const double start[4] = {of->soc[k], settled_c - of->under_way_k[k], 0.0, 0.0};
  const bev_status status =
      ends_of_step(of, k, start, settled_c, found->ends, &found->count);
  return status == BEV_EMPTY ? BEV_OK : status;
}

/* Write the values of temperature n of a layer. */
static void write_values(const recursion *of, const layer *at, int32_t n, const step_ends *from,
                         const layer *next) {
  const choice best = best_of(of, from->ends, from->count, next);
  at->off_j[n] = from->count == 0 ? BEV_EMPTY_J : value_of(of, &best, 0);
  at->on_j[n] = from->count == 0 ? BEV_EMPTY_J : value_of(of, &best, 1);
}

/* Whether the same limits act from two temperatures. */
static int are_alike(const step_ends *one, const step_ends *other) {
  int alike = one->count == other->count && one->count > 0;
  for (int32_t n = 0; n < one->count && alike; n++) {
    alike = one->ends[n].regime == other->ends[n].regime
        && one->ends[n].wanted_w == other->ends[n].wanted_w;
  }
  return alike;
}

/* The ends between three temperatures, from those of these with weights. */
static void ends_between(const step_ends nodes[3], const double weights[3], step_ends *found) {
  found->count = nodes[0].count;
  for (int32_t n = 0; n < found->count; n++) {
    const step_end *low = &nodes[0].ends[n];
    const step_end *middle = &nodes[1].ends[n];
    const step_end *high = &nodes[2].ends[n];
    step_end *end = &found->ends[n];
    end->cost_j = weights[0] * low->cost_j + weights[1] * middle->cost_j
        + weights[2] * high->cost_j;
    end->settled_c = weights[0] * low->settled_c + weights[1] * middle->settled_c
        + weights[2] * high->settled_c;
    end->powers_w[0] = weights[0] * low->powers_w[0] + weights[1] * middle->powers_w[0]
        + weights[2] * high->powers_w[0];
  }
}

/* The temperature in the middle of two, nearer to the second. */
static int32_t middle_of(int32_t first, int32_t last) {
  return first + (last - first + 1) / 2;
}

/* The ends from temperature n on the parabola through those of `first`, their middle and `last`. */
static void ends_on_parabola(int32_t first, int32_t last, int32_t n, const step_ends nodes[3],
                             step_ends *found) {
  const int32_t middle = middle_of(first, last);
  const double below = (double)(middle - first);
  const double above = (double)(last - middle);
  const double place = (double)(n - middle);
  const double weights[3] = {place * (place - above) / (below * (below + above)),
                             (place + below) * (above - place) / (below * above),
                             place * (place + below) / (above * (below + above))};
  ends_between(nodes, weights, found);
}

/* Whether the ends from a fourth temperature are on the parabola: no limit bends in between. */
static int is_on_parabola(const recursion *of, const step_ends *on, const step_ends *driven) {
  double most_j = 0.0;
  for (int32_t n = 0; n < driven->count; n++) {
    most_j = bev_maximum(
        most_j, fabs(driven->ends[n].cost_j - on->ends[n].cost_j)
            + of->joules_per_k * fabs(driven->ends[n].settled_c - on->ends[n].settled_c));
  }
  return most_j <= BEV_STRETCH_J ? 1 : 0;
}

/*
 * The values of one layer. The step is driven from three temperatures of a stretch, and from a fourth, which shows
 * whether the ends in between lie on a parabola; else the stretch is halved.
 */
static bev_status values_of_layer(const recursion *of, int32_t k, const layer *at,
                                  const layer *next) {
  const double longest = bev_maximum(BEV_STRETCH_K / at->step_k, 1.0);
  const int32_t end = at->points - 1;
  step_ends nodes[3];
  step_ends quarter;
  step_ends between;
  bev_status status = ends_from(of, k, at, 0, &nodes[0]);
  for (int32_t first = 0; first < end && status == BEV_OK;) {
    int32_t last = longest < (double)(end - first) ? first + (int32_t)longest : end;
    int32_t middle = middle_of(first, last);
    status = ends_from(of, k, at, last, &nodes[2]);
    nodes[1] = nodes[2];
    if (status == BEV_OK && middle < last) {
      status = ends_from(of, k, at, middle, &nodes[1]);
    }
    while (status == BEV_OK && last - first > 1) {
      const int32_t fourth = middle_of(first, middle);
      quarter = nodes[1];
      if (fourth < middle) {
        status = ends_from(of, k, at, fourth, &quarter);
      }
      if (status == BEV_OK && are_alike(&nodes[0], &nodes[1]) && are_alike(&nodes[0], &nodes[2])
          && are_alike(&nodes[0], &quarter)) {
        ends_on_parabola(first, last, fourth, nodes, &between);
        if (is_on_parabola(of, &between, &quarter) != 0) {
          break;
        }
      }
      last = middle;
      middle = fourth;
      nodes[2] = nodes[1];
      nodes[1] = quarter;
    }
    write_values(of, at, first, &nodes[0], next);
    for (int32_t n = first + 1; n < last && status == BEV_OK; n++) {
      ends_on_parabola(first, last, n, nodes, &between);
      write_values(of, at, n, &between, next);
    }
    nodes[0] = nodes[2];
    first = last;
  }
  write_values(of, at, end, &nodes[0], next);
  return status;
}

/* The values averaged over a deviation in temperature of this variance, as a share of the layer's step squared. */
static void spread(double *values_j, int32_t points, double share) {
  for (double left = share; left > 0.0; left -= BEV_MOST_SPREAD) {
    const double now = 0.5 * bev_minimum(left, BEV_MOST_SPREAD);
    double before_j = values_j[0];
    for (int32_t n = 1; n + 1 < points; n++) {
      const double here_j = values_j[n];
      values_j[n] = here_j + now * (before_j - 2.0 * here_j + values_j[n + 1]);
      before_j = here_j;
    }
  }
}

/* The values as expected before step k, in which a share of the arrival's uncertainty becomes known. */
static void expect_after(const recursion *of, int32_t k, const layer *next) {
  if (k < 0) {
    return;
  }
  const double deviation_k = of->deviation_k;
  const double *left_s = of->left_s;
  const double variance_k2 = deviation_k * deviation_k
      * (left_s[k] * left_s[k] - left_s[k + 1] * left_s[k + 1]) / (left_s[0] * left_s[0]);
  spread(next->off_j, next->points, variance_k2 / (next->step_k * next->step_k));
  spread(next->on_j, next->points, variance_k2 / (next->step_k * next->step_k));
}

/* The layer at instant k, from the next layer, as it is expected before step k - 1. */
static bev_status find_layer(const recursion *of, int32_t k, const layer *at, const layer *next) {
  const bev_status status = values_of_layer(of, k, at, next);
  expect_after(of, k - 1, at);
  return status;
}

/* The backward pass: the values of all layers, from that of the arrival at `aim_c`. */
static bev_status find_values(recursion *of, double aim_c) {
  const int32_t steps = of->trip->steps;
  layer layers[2];
  layers[1] = layer_at(of, steps);
  for (int32_t n = 0; n < layers[1].points; n++) {
    const double short_k =
        bev_maximum(aim_c - (layers[1].least_c + (double)n * layers[1].step_k), 0.0);
    const double near_k = of->is_certain != 0 ? 0.0 : bev_minimum(short_k, BEV_NEAR_K);
    layers[1].off_j[n] =
        (BEV_SHORT_PRICE * short_k - (BEV_SHORT_PRICE - BEV_NEAR_PRICE) * near_k) * of->joules_per_k;
    layers[1].on_j[n] = layers[1].off_j[n];
  }
  expect_after(of, steps - 1, &layers[1]);
  of->price_j[steps] = 0.0;
  for (int32_t k = steps - 1; k >= 0; k--) {
    layers[0] = layer_at(of, k);
    watch_step(of, k, layers);
    bev_status status = find_layer(of, k, &layers[0], &layers[1]);
    of->price_j[k] = 0.0;
    of->late_price_j[k] = 0.0;
    if (status == BEV_OK && of->has_prices != 0) {
      status = price_of_charge(of, k, &layers[1]);
      if (status == BEV_OK && of->lag_s > 0.0) {
        status = price_of_lateness(of, k, &layers[1]);
      }
    }
    if (status != BEV_OK) {
      return status;
    }
    layers[1] = layers[0];
  }
  return BEV_OK;
}

/*
 * If layer k has a place of its own, find again the layers between it and the next layer that has. Prices and limits of
 * each step are those of the backward pass, so the values are too. The layers of the first block, with which the
 * backward pass ended, are still there.
 */
static bev_status find_block_again(const recursion *of, int32_t k) {
  bev_status status = BEV_OK;
  if (k == 0 || (of->trip->steps - k) % of->kept_every != 0) {
    return status;
  }
  layer next = layer_at(of, k + of->kept_every);
  for (int32_t n = k + of->kept_every - 1; n > k && status == BEV_OK; n--) {
    const layer at = layer_at(of, n);
    status = find_layer(of, n, &at, &next);
    next = at;
  }
  return status;
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
static bev_status find_path(const recursion *of, double *states, double *powers_w) {
  const int32_t steps = of->trip->steps;
  int32_t is_on = of->goal->is_heating;
  for (int32_t k = 0; k < steps; k++) {
    const double start[4] = {states[k], states[steps + 1 + k], states[2 * (steps + 1) + k],
                             states[3 * (steps + 1) + k]};
    const layer next = layer_at(of, k + 1);
    step_end ends[MOST_ENDS];
    int32_t count = 0;
    const double at_once[4] = {start[0], start[1], 0.0, 0.0};
    bev_status status = find_block_again(of, k);
    if (status == BEV_OK) {
      status = ends_of_step(of, k, at_once, start[1] + under_way_k(of, k, start), ends, &count);
    }
    if (status != BEV_OK) {
      return status;
    }
    const choice choices = best_of(of, ends, count, &next);
    const mixture best = better_of(of, &choices, is_on);
    step_end *end = &ends[best.end];
    if (best.share > 0.0) {
      end->wanted_w =
          end->powers_w[0] + best.share * (ends[best.end + 1].powers_w[0] - end->powers_w[0]);
      end->takes_surplus = 0;
    }
    status = drive_step(of, k, start, 0, end);
    if (status != BEV_OK) {
      return status;
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

/*
 * The commands with more energy outside an interval that begins at `edge` (ends, if not certain), or less inside [J];
 * the first step that is changed. `moved_in` becomes the last one, seen from the edge.
 */
static int32_t move_edge(const recursion *of, int32_t edge, double more_j, int32_t *moved_in) {
  const bev_trip *trip = of->trip;
  const int32_t is_later = (more_j > 0.0 ? 1 : 0) != of->is_certain;
  double left_j = fabs(more_j);
  int32_t k = edge;
  memcpy(of->tried_w, of->commands_w, (size_t)trip->steps * sizeof(double));
  for (; k >= 0 && k < trip->steps && left_j > 0.0; k += is_later != 0 ? 1 : -1) {
    const double room_w =
        more_j > 0.0 ? trip->heater_limit_w[k] - of->tried_w[k] : of->tried_w[k];
    const double moved_j = bev_minimum(bev_maximum(room_w, 0.0) * trip->duration_s[k], left_j);
    *moved_in = moved_j > 0.0 ? k : *moved_in;
    of->tried_w[k] += (more_j > 0.0 ? moved_j : -moved_j) / trip->duration_s[k];
    left_j -= moved_j;
  }
  return is_later == 0 && k + 1 < edge ? k + 1 : edge;
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

static int is_heated(const recursion *of, const double *commands_w, int32_t k) {
  return k >= 0 && k < of->trip->steps && commands_w[k] > BEV_LEAST_HEATING_W;
}

/* The largest error on arrival that moving an edge corrects [K]. */
static double most_moved_k(const recursion *of, int32_t edge) {
  const bev_trip *trip = of->trip;
  const double step_j =
      of->is_certain != 0 ? 0.0 : trip->heater_limit_w[edge] * trip->duration_s[edge];
  return bev_maximum(BEV_MOVED_K, step_j / of->joules_per_k);
}

/*
 * Move the start of the last interval, or its end if not certain, so that the arrival is exact; `ends_in` becomes the
 * step in which it ends, if it was moved there.
 */
static bev_status arrive_exactly(const recursion *of, double *states, double *powers_w,
                                 int32_t *ends_in) {
  const int32_t steps = of->trip->steps;
  const int32_t outside = of->is_certain != 0 ? -1 : 1;
  const double *commands_w = powers_w;
  int32_t edge = steps - 1;
  while (edge >= 0
         && !(is_heated(of, commands_w, edge) && powers_w[steps + edge] <= 1.0
              && !is_heated(of, commands_w, edge + outside))) {
    edge--;
  }
  const double to_target_k = beyond_k(of, states, 0);
  const double to_reserve_k = beyond_k(of, states, 1);
  const int32_t is_short_of_charge = to_target_k < 0.0 && to_reserve_k > to_target_k ? 1 : 0;
  double excess_k = is_short_of_charge != 0 ? to_reserve_k : to_target_k;
  if (edge < 0 || !(fabs(excess_k) <= most_moved_k(of, edge))) {
    return BEV_OK;
  }
  double moved_j = 0.0;
  int32_t moved_in = edge;
  double next_j = -excess_k * of->joules_per_k;
  memcpy(of->commands_w, commands_w, (size_t)steps * sizeof(double));
  for (int32_t n = 0; n < BEV_MOST_TRIALS && fabs(excess_k) > BEV_ARRIVAL_TOLERANCE_K; n++) {
    const int32_t first = move_edge(of, edge, next_j, &moved_in);
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
  if (moved_j != 0.0 && of->is_certain == 0) {
    int32_t last = steps - 1;
    while (last > moved_in && !(commands_w[last] > 0.0)) {
      last--;
    }
    *ends_in = last == moved_in ? last : -1;
  }
  return BEV_OK;
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
  if (of->vehicle->heater_lag_s > 0.0) {
    price_what_is_due(of);
  }
  return moved_k;
}

/* The largest power deficit of a run [W]. */
static double most_lack_w(const recursion *of, const double *states, const double *powers_w) {
  double most_w = 0.0;
  const int32_t steps = of->trip->steps;
  const int32_t drawn = of->driven[0].is_direct != 0 ? 0 : 2;
  for (int32_t k = 0; k < steps; k++) {
    const double start[4] = {states[k], states[steps + 1 + k], 0.0, 0.0};
    const step_end end = {
        {states[k + 1], states[steps + 2 + k], 0.0, 0.0}, {0.0}, 0.0, 0.0, 0.0, 0, 0u};
    const double terminal_w =
        of->trip->idle_power_w[k] + powers_w[drawn * steps + k] + powers_w[steps + k];
    most_w = bev_maximum(most_w, lacking_w(of, k, start, &end, terminal_w));
  }
  return most_w;
}

/* The cost of a run [J]: battery, heater, power deficit, switching on, missed target and reserve. */
static double cost_of_run(const recursion *of, const double *states, const double *powers_w,
                          double aim_c) {
  const int32_t steps = of->trip->steps;
  const int32_t drawn = of->driven[0].is_direct != 0 ? 0 : 2;
  int32_t was_on = of->goal->is_heating;
  double cost_j = 0.0;
  double voltage = voltage_v(of, states[0], states[steps + 1]);
  for (int32_t k = 0; k < steps; k++) {
    const double start[4] = {states[k], states[steps + 1 + k], 0.0, 0.0};
    const step_end end = {
        {states[k + 1], states[steps + 2 + k], 0.0, 0.0}, {0.0}, 0.0, 0.0, 0.0, 0, 0u};
    const double next_voltage = voltage_v(of, end.states[0], end.states[1]);
    const double terminal_w =
        of->trip->idle_power_w[k] + powers_w[drawn * steps + k] + powers_w[steps + k];
    const int32_t is_on = powers_w[k] > BEV_LEAST_HEATING_W ? 1 : 0;
    cost_j += price_in(of, k) * joules_of_charge(of, 0.5 * (voltage + next_voltage))
            * (start[0] - end.states[0])
        + BEV_HEATING_PRICE * price_in(of, k) * of->trip->duration_s[k] * powers_w[k]
        + of->lack_price * of->trip->duration_s[k] * lacking_w(of, k, start, &end, terminal_w)
        + (is_on != 0 && was_on == 0 ? of->switch_on_j : 0.0);
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

/* Keep a run as the best one so far. */
static void keep_run(const recursion *of, const double *states, const double *powers_w) {
  const size_t rows = 4u * ((size_t)of->trip->steps + 1u);
  memcpy(of->kept, states, rows * sizeof(double));
  memcpy(&of->kept[rows], powers_w, 4u * (size_t)of->trip->steps * sizeof(double));
}

/* Take the best run so far. */
static void take_kept_run(const recursion *of, double *states, double *powers_w) {
  const size_t rows = 4u * ((size_t)of->trip->steps + 1u);
  memcpy(states, of->kept, rows * sizeof(double));
  memcpy(powers_w, &of->kept[rows], 4u * (size_t)of->trip->steps * sizeof(double));
}

/* Let a run arrive exactly, unless that costs more. */
static bev_status finish(const recursion *of, double aim_c, double *states, double *powers_w,
                         int32_t *ends_in) {
  const size_t rows = 4u * ((size_t)of->trip->steps + 1u);
  keep_run(of, states, powers_w);
  const bev_status status = arrive_exactly(of, states, powers_w, ends_in);
  if (status == BEV_OK
      && cost_of_run(of, states, powers_w, aim_c) > cost_of_run(of, of->kept, &of->kept[rows], aim_c)) {
    /* The heat beyond the target was for limits on the way. */
    take_kept_run(of, states, powers_w);
    *ends_in = -1;
  }
  return status;
}

/* The run of all passes. */
static bev_status plan(recursion *of, double *states, double *powers_w, int32_t *ends_in) {
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
  of->unheated_lack_w = most_lack_w(of, states, powers_w);
  range_of(of, range_c);
  keep_run(of, states, powers_w);
  for (int32_t number = 0; number < (of->is_certain != 0 ? PASSES : BEV_EXPECTED_PASSES);) {
    of->has_prices = number == 0 ? 0 : is_priced;
    place_layers(of, number, range_c);
    status = find_values(of, aim_c);
    if (status == BEV_OK) {
      status = find_path(of, states, powers_w);
    }
    if (status != BEV_OK && status != BEV_EMPTY) {
      return status;
    }
    double saved_j = status == BEV_EMPTY ? -INFINITY : 0.0;
    if (status == BEV_OK && number > 0 && of->is_certain != 0) {
      saved_j = cost_of_run(of, of->kept, &of->kept[rows], aim_c)
          - cost_of_run(of, states, powers_w, aim_c);
    }
    if (saved_j < 0.0) {
      /* No pass makes the plan worse: charge may be priced wrongly, as limits bend. */
      take_kept_run(of, states, powers_w);
      if (number == 0 && looks < BEV_MOST_LOOKS) {
        /* The charge does not carry so much heat. */
        aim_c = 0.5 * (aim_c + states[steps + 1 + steps]);
        looks++;
        continue;
      }
      looks = is_priced != 0 ? looks : 0;
      number += is_priced != 0 ? 0 : 1;
      is_priced = is_priced != 0 ? 0 : 1;
      continue;
    }
    keep_run(of, states, powers_w);
    const double moved_k = keep_path(of, states);
    /* The reserve of charge allows this temperature. */
    const double spare_k = -beyond_k(of, states, 1);
    const double reached_c = states[steps + 1 + steps] + spare_k;
    const int32_t is_short = spare_k < 0.0 || aim_c < target_c ? 1 : 0;
    const double aimed_c = aim_c;
    aim_c = is_short != 0 ? bev_minimum(target_c, reached_c) : aim_c;
    looks++;
    const int32_t is_found = number == 0
        ? fabs(aim_c - aimed_c) < BEV_NEAR_RESERVE_K
        : moved_k < BEV_EDGE_SHARE * HALF_WIDTHS_K[number]
            || saved_j < BEV_LOOK_WH * BEV_JOULES_PER_WH;
    if (is_found != 0 || looks >= BEV_MOST_LOOKS) {
      number++;
      looks = 0;
      is_priced = 1;
    }
  }
  return finish(of, aim_c, states, powers_w, ends_in);
}

/* Whether the layers lead from other states, too: they are wide, and neither charge nor power is short. */
static int is_to_be_followed(const recursion *of, bev_status status, const double *states) {
  return status == BEV_OK && of->is_certain == 0 && of->unheated_lack_w == 0.0
      && beyond_k(of, states, 1) <= 0.0;
}

/* Whether the run stays so far within the layers that what may become known on the way is in them, too. */
static int is_within_layers(const recursion *of, const double *states) {
  const int32_t steps = of->trip->steps;
  const double half_k = 0.5 * (double)(of->points - 1) * of->step_k;
  int is_within = 1;
  for (int32_t k = 0; k <= steps && is_within != 0; k++) {
    const double here[4] = {states[k], states[steps + 1 + k], states[2 * (steps + 1) + k],
                            states[3 * (steps + 1) + k]};
    const double settled_c = here[1] + under_way_k(of, k, here);
    is_within = fabs(settled_c - (of->least_c[k] + half_k)) <= BEV_WIDE_K ? 1 : 0;
  }
  return is_within;
}

/*
 * Divide the memory of a plan of `kept_steps` steps, of which the trip is the last part. It begins with what the layers
 * have in common: step_k, points, and the price of a joule that lacks; negative: they are not to be followed.
 */
static void divide_memory(recursion *of, int32_t kept_steps, uint8_t *flags, double *memory) {
  const size_t steps = (size_t)kept_steps;
  const size_t passed = (size_t)(kept_steps - of->trip->steps);
  of->overcharge = &flags[passed];
  of->overdraw = &of->overcharge[steps];
  of->layers_overcharge = &of->overdraw[steps];
  of->layers_overdraw = &of->layers_overcharge[steps];
  of->left_s = &memory[3u + passed];
  of->soc = &of->left_s[steps + 1u];
  of->path_c = &of->soc[steps + 1u];
  of->least_c = &of->path_c[steps + 1u];
  of->under_way_k = &of->least_c[steps + 1u];
  of->price_j = &of->under_way_k[steps + 1u];
  of->late_price_j = &of->price_j[steps + 1u];
  of->due_price = &of->late_price_j[steps + 1u];
  of->kept_share = &of->due_price[steps + 1u];
  of->arriving_share = &of->kept_share[steps];
  of->late_share = &of->arriving_share[steps];
  of->due_share = &of->late_share[steps];
  of->commands_w = &of->due_share[steps];
  of->tried_w = &of->commands_w[steps];
  of->kept = &of->tried_w[steps - passed];
  of->values_j = &of->kept[8u * steps + 4u];
}

/* What neither the passes nor the layers change. */
static void prepare(recursion *of) {
  const bev_vehicle *vehicle = of->vehicle;
  const bev_trip *trip = of->trip;
  const int32_t is_direct = bev_is_direct(vehicle);
  const double battery_j_per_k = vehicle->heat_capacity_j_per_k;
  const double both_j_per_k = battery_j_per_k + vehicle->coolant_heat_capacity_j_per_k;
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
  of->left_s[trip->steps] = 0.0;
  for (int32_t k = trip->steps - 1; k >= 0; k--) {
    const double duration_s = trip->duration_s[k];
    const double after_s = of->left_s[k + 1];
    of->overcharge[k] = trip->propulsion_power_w[k] < 0.0 ? 1u : 0u;
    of->overdraw[k] = 1u;
    of->late_share[k] = 0.0;
    of->due_share[k] = bev_mean_share_left(vehicle->heater_lag_s, duration_s);
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
      of->late_share[k] =
          battery_j_per_k / both_j_per_k * -expm1(-after_s / of->lag_s) * mean_left;
    }
  }
}

/* No prices of charge and of heat under way before the first pass. */
static void forget_prices(const recursion *of) {
  for (int32_t k = 0; k <= of->trip->steps; k++) {
    of->price_j[k] = 0.0;
    of->late_price_j[k] = 0.0;
    of->due_price[k] = 1.0;
  }
}

static int are_prices(const double *price, int32_t steps) {
  int are = 1;
  for (int32_t k = 0; k < steps; k++) {
    are = are && isfinite(price[k]) && price[k] >= 0.0;
  }
  return are;
}

/* Check what both plans take, and prepare the recursion. */
static bev_status begin(recursion *of, const bev_vehicle *vehicle, const bev_trip *trip,
                        const bev_value_goal *goal) {
  const bev_status checked = bev_checked(vehicle, trip, 0);
  if (checked != BEV_OK) {
    return checked;
  }
  if (goal == NULL || trip->steps < 1) {
    return BEV_BAD_ARGUMENT;
  }
  if (!isfinite(goal->target_c) || !isfinite(goal->lowest_soc) || !isfinite(goal->deviation_k)
      || goal->deviation_k < 0.0 || !bev_is_time(trip)
      || (goal->price != NULL && !are_prices(goal->price, trip->steps))) {
    return BEV_BAD_INPUT;
  }
  memset(of, 0, sizeof(*of));
  of->vehicle = vehicle;
  of->trip = trip;
  of->goal = goal;
  of->kept_every = 1;
  of->is_certain = goal->deviation_k > 0.0 ? 0 : 1;
  of->switch_on_j = BEV_JOULES_PER_WH
      * (of->is_certain != 0 ? BEV_SWITCH_ON_WH : BEV_SWITCH_ON_EXPECTED_WH);
  return BEV_OK;
}

bev_status bev_plan_by_values(const bev_vehicle *vehicle, const bev_trip *trip,
                              const bev_value_goal *goal, double *states, double *powers_w,
                              uint8_t *flags, double *memory, int32_t *ends_in,
                              int32_t kept_every) {
  recursion of;
  if (states == NULL || powers_w == NULL || flags == NULL || memory == NULL || ends_in == NULL
      || kept_every < 1) {
    return BEV_BAD_ARGUMENT;
  }
  bev_status status = begin(&of, vehicle, trip, goal);
  if (status != BEV_OK) {
    return status;
  }
  of.kept_every = kept_every;
  *ends_in = -1;
  divide_memory(&of, trip->steps, flags, memory);
  prepare(&of);
  of.lack_price = BEV_LACK_PRICE;
  forget_prices(&of);
  status = plan(&of, states, powers_w, ends_in);
  if (of.unheated_lack_w > 0.0
      && (status == BEV_EMPTY
          || (status == BEV_OK
              && (states[trip->steps] < goal->lowest_soc - BEV_RESERVE_TOLERANCE
                  || most_lack_w(&of, states, powers_w) > of.unheated_lack_w + BEV_NO_WORSE_W)))) {
    /* The reserve comes before the power of climbs, and heat for a climb may cost the charge that it needs. */
    of.lack_price = 0.0;
    forget_prices(&of);
    status = plan(&of, states, powers_w, ends_in);
  }
  memory[0] = of.step_k;
  memory[1] = (double)of.points;
  memory[2] = is_to_be_followed(&of, status, states) != 0 ? of.lack_price : -1.0;
  return status;
}

bev_status bev_follow_values(const bev_vehicle *vehicle, const bev_trip *trip,
                             const bev_value_goal *goal, int32_t kept_steps, double *states,
                             double *powers_w, uint8_t *flags, double *memory,
                             int32_t *ends_in) {
  recursion of;
  if (states == NULL || powers_w == NULL || flags == NULL || memory == NULL || ends_in == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  bev_status status = begin(&of, vehicle, trip, goal);
  if (status != BEV_OK || kept_steps < trip->steps) {
    return status != BEV_OK ? status : BEV_BAD_ARGUMENT;
  }
  of.step_k = memory[0];
  of.points = (int32_t)memory[1];
  of.lack_price = memory[2];
  *ends_in = -1;
  if (of.is_certain != 0 || of.lack_price < 0.0) {
    return BEV_LEFT;
  }
  divide_memory(&of, kept_steps, flags, memory);
  prepare(&of);
  status = find_path(&of, states, powers_w);
  if (status == BEV_OK && is_within_layers(&of, states) != 0) {
    status = finish(&of, goal->target_c, states, powers_w, ends_in);
    return status == BEV_OK && is_to_be_followed(&of, status, states) == 0 ? BEV_LEFT : status;
  }
  return status == BEV_OK || status == BEV_EMPTY ? BEV_LEFT : status;
}
