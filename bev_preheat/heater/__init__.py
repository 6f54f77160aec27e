# SPDX-License-Identifier: Apache-2.0
"""The heater's side of the command: the rules by which a heater controller applies it."""
