# SPDX-License-Identifier: Apache-2.0
"""Tables in text files of loggers, programs and spreadsheets: columns with name, unit, numbers and times."""
