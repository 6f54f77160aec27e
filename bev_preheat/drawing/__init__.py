# SPDX-License-Identifier: Apache-2.0
"""Pictures; the only package that imports matplotlib."""
