# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 nodes: topics, parameters, services; wiring only."""
