# SPDX-License-Identifier: Apache-2.0
"""A recorded drive for all tests of this folder, and a longer one for deep tests."""

import pytest
from recorded_drive import LONG_S, LONG_TARGET_C, record_drive


@pytest.fixture(scope='session')
def recorded(tmp_path_factory):
    """Return the outputs of a drive of some minutes, and the folder of its recording."""
    folder = tmp_path_factory.mktemp('flights')
    return record_drive(folder), folder


@pytest.fixture(scope='session')
def long_folder(tmp_path_factory):
    """Return the folder of the recording of a drive of a quarter of an hour."""
    folder = tmp_path_factory.mktemp('long_flight')
    record_drive(folder, LONG_TARGET_C, LONG_S)
    return folder
