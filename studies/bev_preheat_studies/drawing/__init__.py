# SPDX-License-Identifier: Apache-2.0
"""Figures of studies; the only room of the studies that imports matplotlib."""
