# SPDX-License-Identifier: Apache-2.0
"""The charging session after the drive, and what preheating is worth there."""
