# SPDX-License-Identifier: Apache-2.0
"""Readers of routes by format: one module each, chosen by the content of the file (registry)."""
