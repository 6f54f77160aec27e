/* SPDX-License-Identifier: Apache-2.0 */
/* The ends of a step, and their best mixture: bev_preheat.planning.steps_ahead and value_layers. */
#include "values.h"

double bev_lacking_w(const recursion *of, int32_t k, const double start[4], const step_end *end,
                     double terminal_w) {
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
  bev_merit merit;
  bev_merit_at(of->trip, k, start[1], &merit);
  const double command_w = bev_capped_w(&merit, end->wanted_w);
  const double drawn_w = bev_electric_w(&merit, command_w);
  bev_inputs inputs = bev_inputs_of(of->vehicle, of->trip, k, NULL, NULL);
  inputs.power_w = inputs.power_w + drawn_w;
  inputs.heat_w = bev_heat_with_heater_w(of->vehicle, inputs.heat_w, command_w);
  bev_integrate(of->vehicle, BEV_RUNGE_KUTTA_4, 1, start[0], start[1], &inputs, result);
  if (!(result[0] > 0.0 && result[0] <= 1.0)
      || (end->wanted_w > 0.0 && !(result[1] <= of->vehicle->highest_c))) {
    return 0;
  }
  end->states[0] = result[0];
  end->states[1] = result[1];
  end->powers_w[0] = command_w;
  end->powers_w[2] = drawn_w;
  end->cost_j = price_in(of, k) * (inputs.power_w + result[3]) * inputs.duration_s;
  return 1;
}

static bev_status drive_step(const recursion *of, int32_t k, const double start[4], int32_t is_ahead,
                             step_end *end) {
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
  const double terminal_w = of->trip->idle_power_w[k] + end->powers_w[2] + end->powers_w[1];
  const double voltage = 0.5
      * (voltage_v(of, start[0], start[1]) + voltage_v(of, end->states[0], end->states[1]));
  end->cost_j = price_in(of, k) * joules_of_charge(of, voltage) * (start[0] - end->states[0]);
  const int32_t is_cut = of->trip->sources == NULL
      ? (end->powers_w[0] != end->wanted_w ? 1 : 0)
      : (fabs(end->powers_w[0] - end->wanted_w) > BEV_END_TOLERANCE_W ? 1 : 0);
  end->regime |= is_cut != 0 ? LIMITED_COMMAND : 0u;
  end->regime |= end->powers_w[1] > 0.0 ? BRAKED : 0u;
  if (run->may_overdraw[k] != 0u && of->lack_price > 0.0) {
    const double lack_w = bev_lacking_w(of, k, start, end, terminal_w);
    end->cost_j += of->lack_price * of->trip->duration_s[k] * lack_w;
    end->regime |= lack_w > 0.0 ? LACKING : 0u;
  }
  return BEV_OK;
}

bev_status bev_drive_step(const recursion *of, int32_t k, const double start[4], int32_t is_ahead, step_end *end) {
  const bev_status status = drive_step(of, k, start, is_ahead, end);
  const double beyond_j = status == BEV_OK ? hot_j(of, end->states[1]) : 0.0;
  end->cost_j += beyond_j;
  end->regime |= beyond_j > 0.0 ? HOT : 0u;
  return status;
}

double bev_seen_ahead_c(const recursion *of, int32_t k, double settled_c, const double start[4],
                        const step_end *end) {
  const double k_per_w = of->trip->duration_s[k] / of->vehicle->heat_capacity_j_per_k;
  const double heater_k = of->vehicle->heater_efficiency * k_per_w * end->powers_w[0];
  const double outer_k =
      k_per_w * (of->trip->idle_heat_w[k] - of->trip->leakage_w_per_k[k] * start[1]);
  return settled_c + of->kept_share[k] * ((end->states[1] - start[1]) - heater_k)
      - of->drained_share[k] * outer_k + of->arriving_share[k] * heater_k;
}

bev_status bev_ends_of_step(const recursion *of, int32_t k, const double start[4], double settled_c,
                            step_end ends[MOST_ENDS], int32_t *count) {
  const double full_w = of->trip->heater_limit_w[k];
  bev_merit merit;
  bev_merit_at(of->trip, k, start[1], &merit);
  const int32_t kinds = merit.count == 0 ? 3 : 2 + merit.heating;
  double heat_w = 0.0;
  int32_t found = 0;
  int32_t off = 0;
  *count = 0;
  for (int32_t n = merit.heating; n < merit.count; n++) {
    heat_w += merit.heats_w[n];
  }
  /* From all cooling sources down to the best one, then off. */
  for (int32_t kind = merit.heating - merit.count; kind < kinds; kind++) {
    step_end *end = &ends[found];
    if ((kind == 1 && (of->layers_overcharge[k] == 0u || !(ends[off].powers_w[1] > 0.0)))
        || (kind >= 2 && !(full_w > BEV_LEAST_HEATING_W))) {
      continue;
    }
    if (kind >= 2) {
      /* The best source, the two best, and so on. */
      heat_w = merit.count == 0 ? full_w : heat_w + merit.heats_w[kind - 2];
    }
    end->wanted_w = kind == 0 ? 0.0 : heat_w;
    end->kind = kind;
    end->takes_surplus = kind > 0 ? 1 : 0;
    const bev_status status = bev_drive_step(of, k, start, 1, end);
    if (kind < 0) {
      heat_w -= merit.heats_w[merit.heating - kind - 1];
    }
    if (status == BEV_EMPTY && kind > 0) {
      break;
    }
    if (status != BEV_OK && !(status == BEV_EMPTY && kind < 0)) {
      return status;
    }
    if (kind < 0 && (status == BEV_EMPTY || !(end->powers_w[0] < -BEV_ROUNDING_W))) {
      continue;
    }
    if (kind == 0) {
      off = found;
      heat_w = 0.0;
    } else if (found > 0 && !(end->powers_w[0] > ends[found - 1].powers_w[0] + BEV_ROUNDING_W)) {
      continue;
    } else {
      /* An end with another power. */
    }
    end->settled_c = bev_seen_ahead_c(of, k, settled_c, start, end);
    end->cost_j += of->price_j[k + 1] * (end->states[0] - of->soc[k + 1]);
    found++;
  }
  *count = found;
  for (int32_t n = found - 1; n >= 0; n--) {
    /* Power that the heater draws later is paid for later; and late heat costs where limits miss it. */
    const double heater_j = ends[n].powers_w[0] * of->trip->duration_s[k];
    ends[n].cost_j += of->due_share[k]
            * (heater_j * of->due_price[k + 1] - (ends[n].cost_j - ends[off].cost_j))
        + of->late_price_j[k + 1] * of->late_share[k] * heater_j
            * of->vehicle->heater_efficiency / of->vehicle->heat_capacity_j_per_k
        + BEV_HEATING_PRICE * price_in(of, k) * (ends[n].powers_w[2] * of->trip->duration_s[k]);
  }
  return BEV_OK;
}

/* Compare a mixture with the best of its direction. */
static void keep_cheaper(choice *best, const mixture *found) {
  mixture *const before = &best->by_direction[found->direction + 1];
  *before = found->value_j < before->value_j ? *found : *before;
}

choice bev_best_of(const recursion *of, const step_end ends[MOST_ENDS], int32_t count, const layer *next) {
  choice best = {{{INFINITY, 0.0, 0, -1}, {INFINITY, 0.0, 0, 0}, {INFINITY, 0.0, 0, 1}}};
  for (int32_t end = 0; end < count; end++) {
    const int32_t direction = direction_of(ends[end].powers_w[0]);
    const mixture whole = {
        ends[end].cost_j + worth_j(of, next, ends[end].settled_c, direction), 0.0, end, direction};
    keep_cheaper(&best, &whole);
  }
  for (int32_t end = 0; of->is_certain != 0 && end + 1 < count; end++) {
    const step_end *low = &ends[end];
    const step_end *high = &ends[end + 1];
    const double wide_k = high->settled_c - low->settled_c;
    const int is_cold = low->powers_w[0] < 0.0;
    const double least_w = bev_maximum(
        BEV_LEAST_HEATING_W, BEV_LEAST_MIXED_SHARE * (is_cold ? -low->powers_w[0] : high->powers_w[0]));
    /* The share from which the mixture heats with enough, or to which it cools with enough. */
    const double edge_share = ((is_cold ? -least_w : least_w) - low->powers_w[0])
        / (high->powers_w[0] - low->powers_w[0]);
    const double from_share = is_cold ? 0.0 : bev_maximum(edge_share, 0.0);
    const double from = (low->settled_c + from_share * wide_k - next->least_c) / next->step_k;
    const double to = (high->settled_c - next->least_c) / next->step_k;
    const double up_to = is_cold
        ? (low->settled_c + bev_minimum(edge_share, 1.0) * wide_k - next->least_c) / next->step_k
        : to;
    const double per_point_j = (high->cost_j - low->cost_j) / wide_k * next->step_k;
    if (!(wide_k > 0.0) || !(up_to > 0.0) || !(from < (double)(next->points - 1))) {
      continue;
    }
    const int32_t first = from < 0.0 ? 0 : (int32_t)from + 1;
    const int32_t last = up_to < (double)next->points ? (int32_t)up_to : next->points - 1;
    double least_j = INFINITY;
    int32_t found = first;
    for (int32_t n = first; n <= last; n++) {
      const double value_j = next->on_j[n] + (double)n * per_point_j;
      found = value_j < least_j ? n : found;
      least_j = bev_minimum(least_j, value_j);
    }
    const double low_place = (low->settled_c - next->least_c) / next->step_k;
    const mixture mixed = {low->cost_j + least_j - low_place * per_point_j,
                           ((double)found - low_place) / (to - low_place), end, is_cold ? -1 : 1};
    keep_cheaper(&best, &mixed);
  }
  return best;
}

mixture bev_better_of(const recursion *of, const choice *best, int32_t before) {
  mixture better = best->by_direction[1];
  for (int32_t n = 0; n < 3; n += 2) {
    mixture on = best->by_direction[n];
    on.value_j += before == on.direction || before == ANY_DIRECTION ? 0.0 : of->switch_on_j;
    better = on.value_j < better.value_j ? on : better;
  }
  return better;
}
