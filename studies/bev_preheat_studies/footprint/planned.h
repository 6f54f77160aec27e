/* SPDX-License-Identifier: Apache-2.0 */
/* One situation, planned with either method of an export: what the program and the emulator call. */
#ifndef PLANNED_H_
#define PLANNED_H_

#include <stdint.h>

enum { SITUATION_NUMBERS = 7, COLUMNS = 10, ANSWER_NUMBERS = 10 };

/*
 * Take a situation: the numbers of bev_ecu_situation, then the columns of bev_trip, the first with `steps` + 1
 * values, the others with `steps`. They are only pointed to.
 */
void take_situation(int32_t steps, const double *numbers);

/* Plan it with optimal_switch or merit_order; the status. This is what is measured. */
int32_t plan_switch(void);
int32_t plan_merit_order(void);

/* Write what the plan is told by, in the order of check.c. */
void tell_plan(double *answer);

/* Bytes of the memory that the caller gives for a trip of so many steps. */
int64_t switch_bytes(int32_t steps, int32_t has_heat_path);
int64_t merit_order_bytes(int32_t steps);

#endif /* PLANNED_H_ */
