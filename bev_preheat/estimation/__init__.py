# SPDX-License-Identifier: Apache-2.0
"""Estimation of the battery temperature and of the car's deviations from its file, with uncertainty."""
