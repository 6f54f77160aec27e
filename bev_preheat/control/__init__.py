# SPDX-License-Identifier: Apache-2.0
"""What the planner process does between a message and a command, without ROS."""
