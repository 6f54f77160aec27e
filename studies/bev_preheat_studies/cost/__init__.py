# SPDX-License-Identifier: Apache-2.0
"""The cost of planning: in process, and as a process among others."""
