/* SPDX-License-Identifier: Apache-2.0 */
/* The exported vehicle, and an example situation: constants, in vehicle.c and example.c. */
#ifndef BEV_ECU_VEHICLE_H_
#define BEV_ECU_VEHICLE_H_

#include "bev_ecu.h"

/* Constants for computing the columns of a trip, besides heat_share of the vehicle (README.md). */
typedef struct {
  /* Leakage of the battery's heat: constant part, and part for each m/s of speed. */
  double leakage_w_per_k;
  double leakage_w_per_k_per_mps;
  /* Maximum electrical power of the heater; the cabin takes its share first. */
  double heater_maximum_w;
  /* The state of charge below which no plan goes. */
  double lowest_soc;
  double default_target_c;
} bev_ecu_car;

extern const char *const bev_ecu_vehicle_name;
extern const bev_vehicle bev_ecu_vehicle;
extern const bev_ecu_car bev_ecu_car_of_vehicle;

extern const bev_trip bev_ecu_example_trip;
extern const bev_ecu_situation bev_ecu_example;

#endif /* BEV_ECU_VEHICLE_H_ */
