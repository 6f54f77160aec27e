# SPDX-License-Identifier: Apache-2.0
"""The battery's temperature and the car's deviations from its file, with uncertainty; plausible signals."""
