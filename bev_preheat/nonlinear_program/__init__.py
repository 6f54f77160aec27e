# SPDX-License-Identifier: Apache-2.0
"""The nonlinear program as a reference for the heuristics; the only package that uses CasADi."""
