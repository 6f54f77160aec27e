# SPDX-License-Identifier: Apache-2.0
"""The subcommands of `preheat`, one file each, and their shared parsers, exit statuses, tables, progress."""
