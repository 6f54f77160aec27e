# SPDX-License-Identifier: Apache-2.0
"""Live signals of a car: CAN by a DBC, VSS by a databroker, both by a signal map. Knows nothing of ROS."""
