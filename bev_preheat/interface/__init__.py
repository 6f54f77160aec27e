# SPDX-License-Identifier: Apache-2.0
"""The public Python interface, `import bev_preheat as bp`: functions and the results that they return."""
