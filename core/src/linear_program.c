/* SPDX-License-Identifier: Apache-2.0 */
/* The simplex method for bounded variables: bev_preheat.numerics.linear_program. */
#include "linear_program.h"

#include "bev_preheat_core_generated/constants.h"
#include <math.h>
#include <stdbool.h>

#include "arithmetic.h"

/* Place of a variable: at 0, at its upper bound, or in the basis. */
#define AT_NOTHING 0.0
#define AT_MOST 1.0
#define IN_BASIS 2.0

/*
 * The basis: a variable for each row, its value, its gain per unit, and the inverse. Variables come first, then the
 * slack of each row, then the deficit of each row.
 */
typedef struct {
  int32_t variable[BEV_MOST_ROWS];
  double value[BEV_MOST_ROWS];
  double worth[BEV_MOST_ROWS];
  double inverse[BEV_MOST_ROWS][BEV_MOST_ROWS];
} basis;

/* The entering variable, its direction, its maximum step, and its effect on the variables of the basis. */
typedef struct {
  int32_t variable;
  double direction;
  double bound;
  double changes[BEV_MOST_ROWS];
} entry;

/* The step, and the row whose variable leaves the basis (-1: none), at its upper bound or at 0. */
typedef struct {
  double step;
  int32_t leaving;
  bool leaves_full;
} pivot;

static void begin(const bev_linear_program *of, basis *at) {
  for (int32_t row = 0; row < of->rows; row++) {
    const bool has_deficit = !(of->left[row] >= 0.0);
    at->variable[row] = of->count + row + (has_deficit ? of->rows : 0);
    at->value[row] = fabs(of->left[row]);
    at->worth[row] = has_deficit ? -BEV_PIVOT_PENALTY : 0.0;
    for (int32_t other = 0; other < of->rows; other++) {
      at->inverse[row][other] = 0.0;
    }
    at->inverse[row][row] = has_deficit ? -1.0 : 1.0;
  }
  for (int32_t n = 0; n < of->count; n++) {
    of->place[n] = AT_NOTHING;
  }
}

/* The variable that gains the most at the prices of the rows; whether it gains enough. */
static bool find_entry(const bev_linear_program *of, const basis *at, entry *enters) {
  double prices[BEV_MOST_ROWS];
  for (int32_t other = 0; other < of->rows; other++) {
    prices[other] = 0.0;
    for (int32_t row = 0; row < of->rows; row++) {
      prices[other] += at->worth[row] * at->inverse[row][other];
    }
  }
  double gain = -INFINITY;
  enters->variable = 0;
  for (int32_t n = 0; n < of->count; n++) {
    double gained = of->gains[n];
    for (int32_t row = 0; row < of->rows; row++) {
      gained -= prices[row] * of->uses[row * of->count + n];
    }
    if (of->place[n] == IN_BASIS) {
      gained = 0.0;
    } else if (of->place[n] == AT_MOST) {
      gained = -gained;
    } else {
      /* As it is. */
    }
    if (gained > gain) {
      gain = gained;
      enters->variable = n;
    }
  }
  for (int32_t row = 0; row < of->rows; row++) {
    if (-prices[row] > gain) {
      gain = -prices[row];
      enters->variable = of->count + row;
    }
  }
  return gain > BEV_PIVOT_LEAST_GAIN;
}

/* Effect of the entering variable on those of the basis. */
static void find_changes(const bev_linear_program *of, const basis *at, entry *enters) {
  const bool is_variable = enters->variable < of->count;
  enters->direction = is_variable && of->place[enters->variable] == AT_MOST ? -1.0 : 1.0;
  enters->bound = is_variable ? of->most[enters->variable] : INFINITY;
  for (int32_t row = 0; row < of->rows; row++) {
    double change = 0.0;
    if (is_variable) {
      for (int32_t other = 0; other < of->rows; other++) {
        change += at->inverse[row][other] * of->uses[other * of->count + enters->variable];
      }
    } else {
      change = at->inverse[row][enters->variable - of->count];
    }
    enters->changes[row] = change;
  }
}

/* Step until a variable of the basis reaches a bound, or the entering variable its other bound. */
static pivot find_pivot(const bev_linear_program *of, const basis *at, const entry *enters) {
  pivot found = {enters->bound, -1, false};
  for (int32_t row = 0; row < of->rows; row++) {
    const double falls = enters->direction * enters->changes[row];
    double room = INFINITY;
    bool fills = false;
    if (falls > BEV_LEAST_CHANGE) {
      room = at->value[row] / falls;
    } else if (falls < -BEV_LEAST_CHANGE && at->variable[row] < of->count) {
      room = (of->most[at->variable[row]] - at->value[row]) / -falls;
      fills = true;
    } else {
      /* Nothing bounds it. */
    }
    if (room < found.step) {
      found.step = bev_maximum(room, 0.0);
      found.leaving = row;
      found.leaves_full = fills;
    }
  }
  return found;
}

/* Let a variable enter the basis in place of that of a row. */
static void change_basis(const bev_linear_program *of, basis *at, const entry *enters,
                         const pivot *by) {
  const int32_t leaving = by->leaving;
  if (at->variable[leaving] < of->count) {
    of->place[at->variable[leaving]] = by->leaves_full ? AT_MOST : AT_NOTHING;
  }
  at->variable[leaving] = enters->variable;
  at->value[leaving] = enters->direction < 0.0 ? enters->bound - by->step : by->step;
  at->worth[leaving] = 0.0;
  if (enters->variable < of->count) {
    of->place[enters->variable] = IN_BASIS;
    at->worth[leaving] = of->gains[enters->variable];
  }
  for (int32_t other = 0; other < of->rows; other++) {
    at->inverse[leaving][other] = at->inverse[leaving][other] / enters->changes[leaving];
  }
  for (int32_t row = 0; row < of->rows; row++) {
    for (int32_t other = 0; row != leaving && other < of->rows; other++) {
      at->inverse[row][other] =
          at->inverse[row][other] - enters->changes[row] * at->inverse[leaving][other];
    }
  }
}

void bev_maximise(const bev_linear_program *program) {
  basis at;
  entry enters;
  bool goes_on = true;
  begin(program, &at);
  for (int32_t round = 0; round < BEV_MOST_PIVOTS && goes_on; round++) {
    goes_on = find_entry(program, &at, &enters);
    if (goes_on) {
      find_changes(program, &at, &enters);
      const pivot by = find_pivot(program, &at, &enters);
      goes_on = by.step < INFINITY;
      for (int32_t row = 0; goes_on && row < program->rows; row++) {
        at.value[row] = at.value[row] - by.step * enters.direction * enters.changes[row];
      }
      if (goes_on && by.leaving >= 0) {
        change_basis(program, &at, &enters, &by);
      } else if (goes_on) {
        double *const place = &program->place[enters.variable];
        *place = *place == AT_MOST ? AT_NOTHING : AT_MOST;
      } else {
        /* The gain is unbounded. */
      }
    }
  }
  for (int32_t n = 0; n < program->count; n++) {
    program->found[n] = program->place[n] == AT_MOST ? program->most[n] : 0.0;
  }
  for (int32_t row = 0; row < program->rows; row++) {
    const int32_t variable = at.variable[row];
    if (variable < program->count) {
      program->found[variable] =
          bev_minimum(bev_maximum(at.value[row], 0.0), program->most[variable]);
    }
  }
}
