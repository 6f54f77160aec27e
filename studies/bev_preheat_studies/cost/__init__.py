# SPDX-License-Identifier: Apache-2.0
"""What planning costs: in process, and as a process among others."""
