# SPDX-License-Identifier: Apache-2.0
"""Control: the planner's steps from a message to a command, without ROS."""
