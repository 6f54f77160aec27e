# SPDX-License-Identifier: Apache-2.0
"""Battery preheating before fast charging: model, planning, command line and ROS 2 nodes."""

import os

# Set before NumPy loads. No matrix here has more than about ten rows, and OpenBLAS would start a
# thread per core: a quarter of the planner's start-up time.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
