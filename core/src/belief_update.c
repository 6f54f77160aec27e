/* SPDX-License-Identifier: Apache-2.0 */
/* The filters' updates for one battery state: parts from belief.c, order as in bev_preheat.estimation.belief. */
#include <stddef.h>

#include "bev_preheat_core/estimation.h"

bev_status bev_follow(const bev_vehicle *vehicle, const bev_belief *belief,
                      const bev_belief_terms *terms, const bev_passed *passed, int32_t *lost) {
  if (passed == NULL || lost == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  *lost = 0;
  bev_status status = bev_mix_belief(belief, passed->transitions);
  if (status == BEV_OK) {
    status = bev_move_belief(vehicle, belief, terms, &passed->drive, passed->duration_s,
                             passed->heater_power_w, passed->wander, passed->hidden_variance_s2);
  }
  if (status == BEV_OK && passed->drive.is_seen != 0) {
    status = bev_see_propulsion_power(belief, terms, passed->seen_w, passed->route_w,
                                      passed->variance_w2, passed->most_w, lost);
  }
  return status;
}

bev_status bev_take_reading(const bev_belief *belief, const bev_belief_terms *terms,
                            const bev_reading *reading, double *mean, double *covariance,
                            int32_t *lost) {
  if (reading == NULL || lost == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  *lost = 0;
  bev_status status =
      bev_see_interval(belief, terms, BEV_SENSOR, reading->noise_variances_k2,
                       reading->lowest_c, reading->highest_c, reading->tells_hypotheses, lost);
  if (status == BEV_OK && *lost == 0) {
    status = bev_see_interval(belief, terms, BEV_SOC, reading->noise_variances,
                              reading->lowest_soc, reading->highest_soc, 0, lost);
  }
  if (status == BEV_OK && *lost == 0) {
    status = bev_expect(belief, mean, covariance);
  }
  return status;
}
