# SPDX-License-Identifier: Apache-2.0
"""Your own car: how well a vehicle file predicts recorded drives, and a vehicle file from such drives."""
