/* SPDX-License-Identifier: Apache-2.0 */
/* Values of the battery circuit's curves at a state; they do not depend on the power. */
#ifndef BEV_PREHEAT_CORE_CIRCUIT_H_
#define BEV_PREHEAT_CORE_CIRCUIT_H_

#include "curves.h"

typedef struct {
  double voltage_v;
  double resistance_ohm;
  double temperature_c;
} bev_circuit;

static inline bev_circuit bev_circuit_at(const bev_vehicle *vehicle, double soc,
                                         double temperature_c) {
  const bev_circuit circuit = {
      bev_at(&vehicle->open_circuit_voltage, BEV_AS_ARRAYS, soc, temperature_c),
      bev_at(&vehicle->resistance, BEV_AS_ARRAYS, soc, temperature_c), temperature_c};
  return circuit;
}

#endif /* BEV_PREHEAT_CORE_CIRCUIT_H_ */
