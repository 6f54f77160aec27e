/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The value of a temperature at each instant, backward, and the plan from it, forward:
 * bev_preheat.planning.methods.
 */
#include <string.h>

#include "values.h"

#define PASSES 5

/* How far the temperatures of a pass lie apart, and how far they reach to both sides of the path; 0: everywhere. */
static const double STEPS_K[PASSES] = {BEV_FIRST_STEP_K, BEV_WIDE_STEP_K, BEV_WIDE_STEP_K,
                                       BEV_NARROW_STEP_K, BEV_LAST_STEP_K};
static const double HALF_WIDTHS_K[PASSES] = {0.0, BEV_WIDE_K, BEV_WIDE_K, BEV_NARROW_K,
                                             BEV_LAST_K};

/* Place the layers of a pass around the path; those of the first pass at all temperatures of the range. */
static bev_status place_layers(recursion *of, int32_t number, const double range_c[2]) {
  const double half_k =
      HALF_WIDTHS_K[number] + BEV_WIDER_DEVIATIONS * of->goal->deviation_k;
  const double wide_k = number == 0 ? bev_maximum(range_c[1] - range_c[0], 0.0) : 2.0 * half_k;
  const double points = wide_k / STEPS_K[number] + 2.0;
  int are_finite = isfinite(wide_k);
  const int32_t fits = points <= (double)BEV_VALUE_POINTS ? 1 : 0;
  of->deviation_k = number == 0 ? 0.0 : of->goal->deviation_k;
  of->points = fits != 0 ? (int32_t)points : BEV_VALUE_POINTS;
  of->step_k = fits != 0 ? STEPS_K[number] : wide_k / (double)(BEV_VALUE_POINTS - 1);
  for (int32_t k = 0; k <= of->trip->steps; k++) {
    of->least_c[k] = number == 0 ? range_c[0] : of->path_c[k] - half_k;
    are_finite = are_finite && isfinite(of->least_c[k]);
  }
  return are_finite ? BEV_OK : BEV_NOT_FINITE;
}

/* The forward pass: in each step the best end. */
static bev_status find_path(const recursion *of, double *states, double *powers_w) {
  const int32_t steps = of->trip->steps;
  int32_t direction = of->goal->direction;
  for (int32_t k = 0; k < steps; k++) {
    const double start[4] = {states[k], states[steps + 1 + k], states[2 * (steps + 1) + k],
                             states[3 * (steps + 1) + k]};
    const layer next = layer_at(of, k + 1);
    step_end ends[MOST_ENDS];
    int32_t count = 0;
    const double at_once[4] = {start[0], start[1], 0.0, 0.0};
    bev_status status = bev_find_block_again(of, k);
    if (status == BEV_OK) {
      status = bev_ends_of_step(of, k, at_once, start[1] + under_way_k(of, k, start), ends, &count);
    }
    if (status != BEV_OK) {
      return status;
    }
    const choice choices = bev_best_of(of, ends, count, &next);
    const mixture best = bev_better_of(of, &choices, direction);
    step_end *end = &ends[best.end];
    if (best.share > 0.0) {
      end->wanted_w =
          end->powers_w[0] + best.share * (ends[best.end + 1].powers_w[0] - end->powers_w[0]);
      end->takes_surplus = 0;
    }
    status = bev_drive_step(of, k, start, 0, end);
    if (status != BEV_OK) {
      return status;
    }
    bev_write_step(of, k, end, states, powers_w);
    direction = best.direction;
  }
  return BEV_OK;
}

/* The temperatures of the first pass: those of the unheated run, target and warmer. */
static void range_of(const recursion *of, double range_c[2]) {
  const double target_c = of->goal->target_c;
  double warmest_c = of->path_c[0];
  range_c[0] = bev_minimum(bev_minimum(of->path_c[0], target_c), of->goal->most_c);
  for (int32_t k = 1; k <= of->trip->steps; k++) {
    range_c[0] = bev_minimum(range_c[0], of->path_c[k]);
    warmest_c = bev_cools(of->trip) ? bev_maximum(warmest_c, of->path_c[k]) : warmest_c;
  }
  range_c[0] -= BEV_BELOW_K;
  range_c[1] = bev_minimum(bev_maximum(warmest_c, target_c) + BEV_ABOVE_K,
                           of->vehicle->highest_c + BEV_BELOW_K);
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
  bev_status status = bev_drive_commands(of, NULL, 0, states, powers_w);
  if (status != BEV_OK) {
    return status;
  }
  (void)bev_keep_path(of, states);
  of->unheated_lack_w = bev_most_lack_w(of, states, powers_w);
  range_of(of, range_c);
  bev_keep_run(of, states, powers_w);
  for (int32_t number = 0; number < (of->is_certain != 0 ? PASSES : BEV_EXPECTED_PASSES);) {
    of->has_prices = number == 0 ? 0 : is_priced;
    status = place_layers(of, number, range_c);
    if (status == BEV_OK) {
      status = bev_find_values(of, aim_c);
    }
    if (status == BEV_OK) {
      status = find_path(of, states, powers_w);
    }
    if (status != BEV_OK && status != BEV_EMPTY) {
      return status;
    }
    double saved_j = status == BEV_EMPTY ? -INFINITY : 0.0;
    if (status == BEV_OK && number > 0 && of->is_certain != 0) {
      saved_j = bev_cost_of_run(of, of->kept, &of->kept[rows], aim_c)
          - bev_cost_of_run(of, states, powers_w, aim_c);
    }
    if (saved_j < 0.0) {
      /* No pass makes the plan worse: charge may be priced wrongly, as limits bend. */
      bev_take_kept_run(of, states, powers_w);
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
    bev_keep_run(of, states, powers_w);
    const double moved_k = bev_keep_path(of, states);
    /* The reserve of charge allows this temperature. */
    const double spare_k = -bev_beyond_k(of, states, 1, 1.0);
    const double reached_c = states[steps + 1 + steps] + spare_k;
    const int32_t is_short = spare_k < 0.0 || aim_c < target_c ? 1 : 0;
    const double aimed_c = aim_c;
    aim_c = is_short != 0 ? bev_minimum(target_c, reached_c) : aim_c;
    looks++;
    const int32_t is_found = number == 0
        ? fabs(aim_c - aimed_c) < BEV_NEAR_RESERVE_K
        : moved_k < BEV_EDGE_SHARE * HALF_WIDTHS_K[number]
            || (of->is_certain != 0 && saved_j < BEV_LOOK_WH * BEV_JOULES_PER_WH);
    if (is_found != 0 || looks >= BEV_MOST_LOOKS) {
      number++;
      looks = 0;
      is_priced = 1;
    }
  }
  of->aim_c = aim_c;
  return bev_finish(of, aim_c, states, powers_w, ends_in);
}

/*
 * Whether the layers of a pass with an aim lead to the plan of this run: they are wide, and it arrives at that aim, or
 * is as short of charge and power as without heating.
 */
static int leads_on(const recursion *of, const double *states, const double *powers_w, double aim_c) {
  if (of->is_certain != 0) {
    return 0;
  }
  const size_t points = (size_t)of->trip->steps + 1u;
  const double short_k = bev_beyond_k(of, states, 1, 1.0);
  const double lack_w = bev_most_lack_w(of, states, powers_w);
  const int is_short = short_k > BEV_ARRIVAL_TOLERANCE_K;
  if (is_short || lack_w > 0.0) {
    double *unheated = of->kept;
    double *unheated_w = &unheated[4u * points];
    for (size_t n = 0; n < 4u; n++) {
      unheated[n * points] = states[n * points];
    }
    if (bev_drive_commands(of, NULL, 0, unheated, unheated_w) != BEV_OK
        || lack_w > bev_most_lack_w(of, unheated, unheated_w) + BEV_NO_WORSE_W
        || (is_short && short_k > bev_beyond_k(of, unheated, 1, 1.0) + BEV_ARRIVAL_TOLERANCE_K)) {
      return 0;
    }
  }
  const double wanted_c = bev_minimum(of->goal->target_c, states[2u * points - 1u] - short_k);
  return is_short || fabs(wanted_c - aim_c) <= BEV_NEAR_RESERVE_K;
}

/* Whether the run stays so far within the layers that the deviations on the way are in them, too. */
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
 * Divide the memory of a plan of `kept_steps` steps, whose last part is the trip. It begins with the numbers that all
 * layers share: step_k, points, the price of a missing joule (negative: they are not to be followed), and the aim.
 */
static void divide_memory(recursion *of, int32_t kept_steps, uint8_t *flags, double *memory) {
  const size_t steps = (size_t)kept_steps;
  const size_t passed = (size_t)(kept_steps - of->trip->steps);
  of->overcharge = &flags[passed];
  of->overdraw = &of->overcharge[steps];
  of->layers_overcharge = &of->overdraw[steps];
  of->layers_overdraw = &of->layers_overcharge[steps];
  of->left_s = &memory[4u + passed];
  of->soc = &of->left_s[steps + 1u];
  of->path_c = &of->soc[steps + 1u];
  of->least_c = &of->path_c[steps + 1u];
  of->under_way_k = &of->least_c[steps + 1u];
  of->price_j = &of->under_way_k[steps + 1u];
  of->late_price_j = &of->price_j[steps + 1u];
  of->due_price = &of->late_price_j[steps + 1u];
  of->kept_share = &of->due_price[steps + 1u];
  of->drained_share = &of->kept_share[steps];
  of->arriving_share = &of->drained_share[steps];
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
    of->drained_share[k] = 0.0;
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
    if (vehicle->shell_share > 0.0) {
      /* All heat but Joule heat enters the shell, and leaks more than from the core. */
      const double held = 1.0
          / (1.0 + trip->leakage_w_per_k[k] * (1.0 - vehicle->shell_share)
                 / vehicle->coolant_conductance_w_per_k);
      of->drained_share[k] = of->kept_share[k] - held
          * (of->kept_share[k] - exp(-(after_s + 0.5 * duration_s) / of->coolant_lag_s));
      of->arriving_share[k] *= held;
    }
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
  if (!isfinite(goal->target_c) || isnan(goal->most_c) || !isfinite(goal->lowest_soc) || !isfinite(goal->deviation_k)
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

bev_status bev_plan_by_values(const bev_vehicle *vehicle, const bev_trip *trip, const bev_value_goal *goal,
                              double *states, double *powers_w, uint8_t *flags, double *memory, int32_t *ends_in,
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
  bev_forget_prices(&of);
  status = plan(&of, states, powers_w, ends_in);
  if (of.unheated_lack_w > 0.0
      && (status == BEV_EMPTY
          || (status == BEV_OK
              && (states[trip->steps] < goal->lowest_soc - BEV_SOC_TOLERANCE
                  || bev_most_lack_w(&of, states, powers_w) > of.unheated_lack_w + BEV_NO_WORSE_W)))) {
    /* The reserve comes before the power of climbs, and heat for a climb may cost the charge that it needs. */
    of.lack_price = 0.0;
    bev_forget_prices(&of);
    status = plan(&of, states, powers_w, ends_in);
  }
  memory[0] = of.step_k;
  memory[1] = (double)of.points;
  memory[2] = status == BEV_OK && leads_on(&of, states, powers_w, of.aim_c) ? of.lack_price : -1.0;
  memory[3] = of.aim_c;
  return status;
}

bev_status bev_follow_values(const bev_vehicle *vehicle, const bev_trip *trip, const bev_value_goal *goal,
                             int32_t kept_steps, double *states, double *powers_w, uint8_t *flags, double *memory,
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
    status = bev_finish(&of, goal->target_c, states, powers_w, ends_in);
    return status == BEV_OK && !leads_on(&of, states, powers_w, memory[3]) ? BEV_LEFT : status;
  }
  return status == BEV_OK || status == BEV_EMPTY ? BEV_LEFT : status;
}
