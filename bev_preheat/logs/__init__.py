# SPDX-License-Identifier: Apache-2.0
"""Drive logs as people have them: formats, signal maps, recordings in SI units."""
