# SPDX-License-Identifier: Apache-2.0
"""Pictures; the only package that imports matplotlib, once a figure is made, because that takes a second."""
