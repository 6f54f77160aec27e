/* SPDX-License-Identifier: Apache-2.0 */
#include <stddef.h>

#include "curves.h"

double bev_curve_value(const bev_curve *curve, int32_t saturating, double soc,
                       double temperature_c) {
  if (curve == NULL) {
    return NAN;
  }
  return bev_at(curve, saturating, soc, temperature_c);
}
