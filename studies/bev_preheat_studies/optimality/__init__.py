# SPDX-License-Identifier: Apache-2.0
"""Random trips on which the methods are compared with the nonlinear program."""
