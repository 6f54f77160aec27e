# SPDX-License-Identifier: Apache-2.0
"""Common parts of the command lines: parsers, exit statuses, tables, JSON, interrupted work."""
