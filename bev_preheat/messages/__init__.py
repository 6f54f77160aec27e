# SPDX-License-Identifier: Apache-2.0
"""ROS messages as the planner's values and back: one file for each message; no node, no rclpy."""
