# SPDX-License-Identifier: Apache-2.0
"""Synthetic cars whose parameters are known, to judge identified vehicle files."""
