/* SPDX-License-Identifier: Apache-2.0 */
/* A linear program of few rows and many bounded variables: bev_preheat.numerics.linear_program. */
#ifndef BEV_PREHEAT_CORE_LINEAR_PROGRAM_H_
#define BEV_PREHEAT_CORE_LINEAR_PROGRAM_H_

#include <stdint.h>

#define BEV_MOST_ROWS 9

/*
 * Maximise the sum of `gains` times `found`, subject to: the sum of `uses` times `found` is at most `left` in each
 * row, and `found` lies between 0 and `most`. `gains` and `most` have `count` values, `uses` has `count` for each
 * row, one row after the other; `place` is room for `count` numbers.
 */
typedef struct {
  int32_t count;
  int32_t rows;
  const double *gains;
  const double *uses;
  const double *most;
  double left[BEV_MOST_ROWS];
  double *place;
  double *found;
} bev_linear_program;

/* Write `found`. `rows` is 1 ... BEV_MOST_ROWS. */
void bev_maximise(const bev_linear_program *program);

#endif /* BEV_PREHEAT_CORE_LINEAR_PROGRAM_H_ */
