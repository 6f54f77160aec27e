# SPDX-License-Identifier: Apache-2.0
"""Doubt about the signals of the vehicle: values in, verdicts out, without ROS."""
