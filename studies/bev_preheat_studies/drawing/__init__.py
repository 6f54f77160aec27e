# SPDX-License-Identifier: Apache-2.0
"""Pictures of studies; the only room of the studies that knows matplotlib."""
