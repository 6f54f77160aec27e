/* SPDX-License-Identifier: Apache-2.0 */
/* Plan a situation with either method of an export: the interface for painted_stack.c and the emulator. */
#ifndef PLANNED_H_
#define PLANNED_H_

#include <stdint.h>

enum { SITUATION_NUMBERS = 7, COLUMNS = 10, ANSWER_NUMBERS = 10 };

/*
 * Take a situation: the numbers of bev_ecu_situation, then the columns of bev_trip, the first with `steps` + 1
 * values, the others with `steps`. `numbers` is not copied.
 */
void take_situation(int32_t steps, const double *numbers);

/* Plan the situation with optimal_switch or value_function; return the status. These functions are measured. */
int32_t plan_switch(void);
int32_t plan_by_values(void);

/* Write the plan's numbers, in the order of check.c. */
void tell_plan(double *answer);

/* Bytes of the caller's memory for a trip with `steps` steps. */
int64_t switch_bytes(int32_t steps, int32_t has_heat_path);
int64_t values_bytes(int32_t steps);

#endif /* PLANNED_H_ */
