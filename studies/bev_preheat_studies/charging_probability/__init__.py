# SPDX-License-Identifier: Apache-2.0
"""How good the plan is if it is uncertain whether, and when, the vehicle charges."""
