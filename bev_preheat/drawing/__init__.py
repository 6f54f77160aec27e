# SPDX-License-Identifier: Apache-2.0
"""Pictures; the only room that knows matplotlib."""
