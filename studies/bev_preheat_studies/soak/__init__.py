# SPDX-License-Identifier: Apache-2.0
"""The installed planner under load for a long time (`make soak`)."""
