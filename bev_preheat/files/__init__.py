# SPDX-License-Identifier: Apache-2.0
"""Files: what is checked in reading and writing them, whatever their kind."""
