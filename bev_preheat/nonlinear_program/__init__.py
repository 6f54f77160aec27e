# SPDX-License-Identifier: Apache-2.0
"""The nonlinear program behind the heuristics; the only room that knows CasADi."""
