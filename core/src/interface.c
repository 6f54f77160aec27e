/* SPDX-License-Identifier: Apache-2.0 */
#include "bev_preheat_core/core.h"
#include "bev_preheat_core_generated/interface.h"

int32_t bev_interface(void) { return BEV_INTERFACE_DIGEST; }
