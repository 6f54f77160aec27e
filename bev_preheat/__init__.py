# SPDX-License-Identifier: Apache-2.0
"""Battery preheating before fast charging: model, planning, command line and ROS 2 nodes."""
