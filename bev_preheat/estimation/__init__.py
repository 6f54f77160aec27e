# SPDX-License-Identifier: Apache-2.0
"""What the battery's temperature really is, what its car is really like, and how sure that is."""
