/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Plan situations on this computer, on a stack filled beforehand, and report the overwritten bytes.
 *
 *     painted_stack memory STEPS    bytes of memory: optimal_switch, the same with a heat path, value_function
 *     painted_stack plans           situations on standard input, answers on standard output
 *
 * A situation is two int32 (method, 0: optimal_switch; number of steps) and the numbers of take_situation. An
 * answer is two int32 (status; bytes of stack) and the numbers of tell_plan.
 */
#define _XOPEN_SOURCE 700
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <ucontext.h>

#include "planned.h"
#include "vehicle.h"

enum { STACK_BYTES = 1 << 18, PAINT = 0xA5 };

static unsigned char stack[STACK_BYTES];
static double numbers[SITUATION_NUMBERS + COLUMNS * BEV_MOST_STEPS + 1];
static double answer[ANSWER_NUMBERS];
static ucontext_t outside;
static ucontext_t inside;
static int32_t (*plan)(void);
static int32_t status;

static int32_t plan_nothing(void) {
  return 0;
}

static void run(void) {
  status = plan();
}

/* The bytes of stack that a function overwrites. */
static int32_t stack_of(int32_t (*function)(void)) {
  int32_t untouched = 0;
  plan = function;
  memset(stack, PAINT, sizeof stack);
  if (getcontext(&inside) != 0) {
    exit(2);
  }
  inside.uc_stack.ss_sp = stack;
  inside.uc_stack.ss_size = sizeof stack;
  inside.uc_link = &outside;
  makecontext(&inside, run, 0);
  if (swapcontext(&outside, &inside) != 0) {
    exit(2);
  }
  while (untouched < STACK_BYTES && stack[untouched] == PAINT) {
    untouched++;
  }
  return STACK_BYTES - untouched;
}

static int plan_all(void) {
  /* The stack used by the context switch itself. */
  const int32_t frame = stack_of(plan_nothing);
  int32_t asked[2];
  while (fread(asked, sizeof asked, 1, stdin) == 1) {
    const int32_t steps = asked[1];
    if (steps < 1 || steps > BEV_MOST_STEPS) {
      return 2;
    }
    const size_t count = (size_t)(SITUATION_NUMBERS + COLUMNS * steps + 1);
    if (fread(numbers, sizeof *numbers, count, stdin) != count) {
      return 2;
    }
    take_situation(steps, numbers);
    const int32_t used = stack_of(asked[0] == 0 ? plan_switch : plan_by_values) - frame;
    const int32_t told[2] = {status, used};
    tell_plan(answer);
    if (fwrite(told, sizeof told, 1, stdout) != 1 || fwrite(answer, sizeof answer, 1, stdout) != 1) {
      return 2;
    }
  }
  return fflush(stdout) == 0 ? 0 : 2;
}

int main(int count, char **arguments) {
  if (count == 3 && strcmp(arguments[1], "memory") == 0) {
    const int32_t steps = (int32_t)strtol(arguments[2], NULL, 10);
    printf("%lld %lld %lld\n", (long long)switch_bytes(steps, 0), (long long)switch_bytes(steps, 1),
           (long long)values_bytes(steps));
    return 0;
  }
  return count == 2 && strcmp(arguments[1], "plans") == 0 ? plan_all() : 2;
}
