# SPDX-License-Identifier: Apache-2.0
"""Checks common to reading and writing files of any kind."""
