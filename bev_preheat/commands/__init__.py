# SPDX-License-Identifier: Apache-2.0
"""The subcommands of `preheat`, one file each, and what they share: parsers, exit statuses, tables, progress."""
