# SPDX-License-Identifier: Apache-2.0
"""The subcommands of `preheat` that run studies; the table in `bev_preheat.commands.main` names their modules."""
