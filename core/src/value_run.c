/* SPDX-License-Identifier: Apache-2.0 */
/* The run of a pass, its cost, and its exact arrival: bev_preheat.planning.value_run. */
#include <string.h>

#include "values.h"

void bev_write_step(const recursion *of, int32_t k, const step_end *end, double *states, double *powers_w) {
  const int32_t steps = of->trip->steps;
  for (int32_t n = 0; n < 4; n++) {
    states[n * (steps + 1) + k + 1] = end->states[n];
    powers_w[n * steps + k] = end->powers_w[n];
  }
}

bev_status bev_drive_commands(const recursion *of, const double *commands_w, int32_t first, double *states,
                              double *powers_w) {
  const int32_t steps = of->trip->steps;
  for (int32_t k = first; k < steps; k++) {
    const double start[4] = {states[k], states[steps + 1 + k], states[2 * (steps + 1) + k],
                             states[3 * (steps + 1) + k]};
    step_end end;
    end.wanted_w = commands_w == NULL ? 0.0 : commands_w[k];
    end.takes_surplus = commands_w == NULL ? 1 : 0;
    const bev_status status = bev_drive_step(of, k, start, 0, &end);
    if (status != BEV_OK) {
      return status;
    }
    bev_write_step(of, k, &end, states, powers_w);
  }
  return BEV_OK;
}

/* The most power of a step, of heating (`sign` 1) or cooling (-1) [W]. */
static double limit_of(const bev_trip *trip, int32_t k, double sign) {
  return sign < 0.0 ? -trip->sources->cold_limit_w[k] : trip->heater_limit_w[k];
}

/*
 * The commands with more energy outside an interval that begins at `edge` (ends, if not certain), or less inside [J];
 * the first step that is changed. `moved_in` becomes the last one, seen from the edge.
 */
static int32_t move_edge(const recursion *of, int32_t edge, double more_j, double sign, int32_t *moved_in) {
  const bev_trip *trip = of->trip;
  const int32_t is_later = (more_j > 0.0 ? 1 : 0) != of->is_certain;
  double left_j = fabs(more_j);
  int32_t k = edge;
  memcpy(of->tried_w, of->commands_w, (size_t)trip->steps * sizeof(double));
  for (; k >= 0 && k < trip->steps && left_j > 0.0; k += is_later != 0 ? 1 : -1) {
    const double limit_w = limit_of(trip, k, sign);
    const double room_w = more_j > 0.0 ? limit_w - of->tried_w[k] : of->tried_w[k];
    const double moved_j = bev_minimum(bev_maximum(room_w, 0.0) * trip->duration_s[k], left_j);
    *moved_in = moved_j > 0.0 ? k : *moved_in;
    of->tried_w[k] += (more_j > 0.0 ? moved_j : -moved_j) / trip->duration_s[k];
    of->tried_w[k] = bev_maximum(bev_minimum(of->tried_w[k], limit_w), 0.0);
    left_j -= moved_j;
  }
  for (int32_t n = 0; n < trip->steps; n++) {
    of->tried_w[n] *= sign;
  }
  return is_later == 0 && k + 1 < edge ? k + 1 : edge;
}

double bev_beyond_k(const recursion *of, const double *states, int32_t is_short_of_charge, double sign) {
  const int32_t steps = of->trip->steps;
  const double arrival_c = states[steps + 1 + steps];
  const double per_soc_k =
      joules_of_charge(of, voltage_v(of, states[steps], arrival_c)) / of->joules_per_k;
  return is_short_of_charge != 0 ? (of->goal->lowest_soc - states[steps]) * per_soc_k
      : sign < 0.0               ? of->goal->most_c - arrival_c
                                 : arrival_c - of->goal->target_c;
}

static int is_heated(const recursion *of, const double *commands_w, int32_t k, double sign) {
  return k >= 0 && k < of->trip->steps && sign * commands_w[k] > BEV_LEAST_HEATING_W;
}

/* The largest error on arrival that moving an edge corrects [K]. */
static double most_moved_k(const recursion *of, int32_t edge, double sign) {
  const bev_trip *trip = of->trip;
  const double step_j =
      of->is_certain != 0 ? 0.0 : limit_of(trip, edge, sign) * trip->duration_s[edge];
  return bev_maximum(BEV_MOVED_K, step_j / of->joules_per_k);
}

/*
 * Move the start of the last interval, or its end if not certain, so that the arrival is exact; `ends_in` becomes the
 * step in which it ends, if it was moved there.
 */
static bev_status arrive_exactly(const recursion *of, double *states, double *powers_w, int32_t *ends_in) {
  const int32_t steps = of->trip->steps;
  const int32_t outside = of->is_certain != 0 ? -1 : 1;
  const double *commands_w = powers_w;
  int32_t edge = steps - 1;
  while (edge > 0 && !(fabs(commands_w[edge]) > BEV_LEAST_HEATING_W)) {
    edge--;
  }
  /* Of the cooling, if that comes last, in the same way. */
  const double sign = is_heated(of, commands_w, edge, -1.0) ? -1.0 : 1.0;
  while (edge >= 0
         && !(is_heated(of, commands_w, edge, sign) && powers_w[steps + edge] <= 1.0
              && !is_heated(of, commands_w, edge + outside, sign))) {
    edge--;
  }
  const double to_target_k = bev_beyond_k(of, states, 0, sign);
  const double to_reserve_k = bev_beyond_k(of, states, 1, sign);
  const int32_t is_short_of_charge = to_target_k < 0.0 && to_reserve_k > to_target_k ? 1 : 0;
  double excess_k = is_short_of_charge != 0 ? to_reserve_k : to_target_k;
  if (edge < 0 || !(fabs(excess_k) <= most_moved_k(of, edge, sign))) {
    return BEV_OK;
  }
  double moved_j = 0.0;
  int32_t moved_in = edge;
  double next_j = -excess_k * of->joules_per_k;
  for (int32_t k = 0; k < steps; k++) {
    of->commands_w[k] = sign * commands_w[k];
  }
  for (int32_t n = 0; n < BEV_MOST_TRIALS && fabs(excess_k) > BEV_ARRIVAL_TOLERANCE_K; n++) {
    const int32_t first = move_edge(of, edge, next_j, sign, &moved_in);
    const bev_status status = bev_drive_commands(of, of->tried_w, first, states, powers_w);
    if (status != BEV_OK) {
      return status;
    }
    const double found_k = bev_beyond_k(of, states, is_short_of_charge, sign);
    const double slope = (found_k - excess_k) / (next_j - moved_j);
    moved_j = next_j;
    excess_k = found_k;
    if (!isfinite(slope) || slope == 0.0) {
      break;
    }
    next_j = moved_j - excess_k / slope;
  }
  if (moved_j != 0.0 && sign > 0.0 && of->is_certain == 0) {
    int32_t last = steps - 1;
    while (last > moved_in && !(commands_w[last] > 0.0)) {
      last--;
    }
    *ends_in = last == moved_in ? last : -1;
  }
  return BEV_OK;
}

double bev_most_lack_w(const recursion *of, const double *states, const double *powers_w) {
  double most_w = 0.0;
  const int32_t steps = of->trip->steps;
  for (int32_t k = 0; k < steps; k++) {
    const double start[4] = {states[k], states[steps + 1 + k], 0.0, 0.0};
    const step_end end = {
        {states[k + 1], states[steps + 2 + k], 0.0, 0.0}, {0.0}, 0.0, 0.0, 0.0, 0, 0, 0u};
    const double terminal_w =
        of->trip->idle_power_w[k] + powers_w[2 * steps + k] + powers_w[steps + k];
    most_w = bev_maximum(most_w, bev_lacking_w(of, k, start, &end, terminal_w));
  }
  return most_w;
}

double bev_cost_of_run(const recursion *of, const double *states, const double *powers_w, double aim_c) {
  const int32_t steps = of->trip->steps;
  int32_t before = of->goal->direction;
  double cost_j = 0.0;
  double voltage = voltage_v(of, states[0], states[steps + 1]);
  for (int32_t k = 0; k < steps; k++) {
    const double start[4] = {states[k], states[steps + 1 + k], 0.0, 0.0};
    const step_end end = {
        {states[k + 1], states[steps + 2 + k], 0.0, 0.0}, {0.0}, 0.0, 0.0, 0.0, 0, 0, 0u};
    const double next_voltage = voltage_v(of, end.states[0], end.states[1]);
    const double terminal_w =
        of->trip->idle_power_w[k] + powers_w[2 * steps + k] + powers_w[steps + k];
    const int32_t direction = direction_of(powers_w[k]);
    cost_j += price_in(of, k) * joules_of_charge(of, 0.5 * (voltage + next_voltage))
            * (start[0] - end.states[0])
        + BEV_HEATING_PRICE * price_in(of, k) * of->trip->duration_s[k]
            * powers_w[(of->trip->sources == NULL ? 0 : 2) * steps + k]
        + of->lack_price * of->trip->duration_s[k] * bev_lacking_w(of, k, start, &end, terminal_w)
        + (direction != 0 && direction != before ? of->switch_on_j : 0.0) + hot_j(of, end.states[1]);
    before = direction;
    voltage = next_voltage;
  }
  const double arrival_c = states[steps + 1 + steps];
  const double short_k =
      bev_maximum(bev_maximum(aim_c - arrival_c, arrival_c - of->goal->most_c), 0.0)
      + bev_maximum(bev_beyond_k(of, states, 1, 1.0), 0.0);
  return cost_j + BEV_SHORT_PRICE * of->joules_per_k * short_k;
}

void bev_keep_run(const recursion *of, const double *states, const double *powers_w) {
  const size_t rows = 4u * ((size_t)of->trip->steps + 1u);
  memcpy(of->kept, states, rows * sizeof(double));
  memcpy(&of->kept[rows], powers_w, 4u * (size_t)of->trip->steps * sizeof(double));
}

void bev_take_kept_run(const recursion *of, double *states, double *powers_w) {
  const size_t rows = 4u * ((size_t)of->trip->steps + 1u);
  memcpy(states, of->kept, rows * sizeof(double));
  memcpy(powers_w, &of->kept[rows], 4u * (size_t)of->trip->steps * sizeof(double));
}

bev_status bev_finish(const recursion *of, double aim_c, double *states, double *powers_w, int32_t *ends_in) {
  const size_t rows = 4u * ((size_t)of->trip->steps + 1u);
  bev_keep_run(of, states, powers_w);
  const bev_status status = arrive_exactly(of, states, powers_w, ends_in);
  if (status == BEV_OK
      && bev_cost_of_run(of, states, powers_w, aim_c) > bev_cost_of_run(of, of->kept, &of->kept[rows], aim_c)) {
    /* The heat beyond the target was for limits on the way. */
    bev_take_kept_run(of, states, powers_w);
    *ends_in = -1;
  }
  return status;
}
