# SPDX-License-Identifier: Apache-2.0
"""Files of any kind read, checked and written; tables of loggers and spreadsheets with units and times."""
