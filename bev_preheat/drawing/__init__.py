# SPDX-License-Identifier: Apache-2.0
"""Pictures; the only room besides the demonstration that knows matplotlib."""
