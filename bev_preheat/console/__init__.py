# SPDX-License-Identifier: Apache-2.0
"""What all command lines share: parsers, exit statuses, tables, JSON, interrupted work."""
