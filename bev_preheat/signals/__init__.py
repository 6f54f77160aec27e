# SPDX-License-Identifier: Apache-2.0
"""Plausibility of the vehicle's signals: values in, verdicts out, without ROS."""
