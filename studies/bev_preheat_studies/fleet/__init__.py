# SPDX-License-Identifier: Apache-2.0
"""A winter fleet: what preheating saves at the charger, over a million drawn trips."""
