/* SPDX-License-Identifier: Apache-2.0 */
/* The backward pass: the values of all layers. */
#include "values.h"

/* The ends of step k from temperature n of a layer. */
static bev_status ends_from(const recursion *of, int32_t k, const layer *at, int32_t n, step_ends *found) {
  const double settled_c = at->least_c + (double)n * at->step_k;
  const double start[4] = {of->soc[k], settled_c - of->under_way_k[k], 0.0, 0.0};
  const bev_status status =
      bev_ends_of_step(of, k, start, settled_c, found->ends, &found->count);
  return status == BEV_EMPTY ? BEV_OK : status;
}

/* Write the values of temperature n of a layer. */
static void write_values(const recursion *of, const layer *at, int32_t n, const step_ends *from,
                         const layer *next) {
  const choice best = bev_best_of(of, from->ends, from->count, next);
  at->off_j[n] = from->count == 0 ? BEV_EMPTY_J : bev_better_of(of, &best, 0).value_j;
  at->on_j[n] = from->count == 0 ? BEV_EMPTY_J : bev_better_of(of, &best, ANY_DIRECTION).value_j;
}

/* Whether the same limits act from two temperatures. */
static int are_alike(const step_ends *one, const step_ends *other) {
  int alike = one->count == other->count && one->count > 0;
  for (int32_t n = 0; n < one->count && alike; n++) {
    alike = one->ends[n].regime == other->ends[n].regime
        && one->ends[n].kind == other->ends[n].kind;
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
static void ends_on_parabola(int32_t first, int32_t last, int32_t n, const step_ends nodes[3], step_ends *found) {
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
static bev_status values_of_layer(const recursion *of, int32_t k, const layer *at, const layer *next) {
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

bev_status bev_find_values(recursion *of, double aim_c) {
  const int32_t steps = of->trip->steps;
  layer layers[2];
  layers[1] = layer_at(of, steps);
  for (int32_t n = 0; n < layers[1].points; n++) {
    const double arrival_c = layers[1].least_c + (double)n * layers[1].step_k;
    const double short_k =
        bev_maximum(bev_maximum(aim_c - arrival_c, arrival_c - of->goal->most_c), 0.0);
    const double near_k = of->is_certain != 0 ? 0.0 : bev_minimum(short_k, BEV_NEAR_K);
    layers[1].off_j[n] =
        (BEV_SHORT_PRICE * short_k - (BEV_SHORT_PRICE - BEV_NEAR_PRICE) * near_k) * of->joules_per_k;
    layers[1].on_j[n] = layers[1].off_j[n];
  }
  expect_after(of, steps - 1, &layers[1]);
  of->price_j[steps] = 0.0;
  of->for_power_j = 0.0;
  for (int32_t k = steps - 1; k >= 0; k--) {
    layers[0] = layer_at(of, k);
    bev_watch_step(of, k, layers);
    bev_status status = find_layer(of, k, &layers[0], &layers[1]);
    of->price_j[k] = 0.0;
    of->late_price_j[k] = 0.0;
    if (status == BEV_OK && of->has_prices != 0) {
      status = bev_price_of_charge(of, k, &layers[1]);
      if (status == BEV_OK && of->lag_s > 0.0) {
        status = bev_price_of_lateness(of, k, &layers[1]);
      }
    }
    if (status != BEV_OK) {
      return status;
    }
    layers[1] = layers[0];
  }
  return BEV_OK;
}

bev_status bev_find_block_again(const recursion *of, int32_t k) {
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
