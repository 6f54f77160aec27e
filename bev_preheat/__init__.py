# SPDX-License-Identifier: Apache-2.0
"""Battery preheating before fast charging: model, planning, command line and ROS 2 nodes."""

import os

# Before NumPy loads. No matrix here has more than some ten rows, and OpenBLAS begins by starting a
# thread for each core: a quarter of the processor time that the planner takes to start.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
