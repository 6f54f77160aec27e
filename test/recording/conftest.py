# SPDX-License-Identifier: Apache-2.0
"""A recorded drive for all tests of this folder, and a longer one for deep tests."""

import pytest
from recorded_drive import a_car, LENGTH_S, LONG_S, LONG_TARGET_C, RecordedDrive


@pytest.fixture(scope='session')
def recorded(tmp_path_factory):
    """Return the RecordedDrive of some minutes, and the folder of its recording."""
    folder = tmp_path_factory.mktemp('flights')
    return RecordedDrive(a_car(), folder).drive(LENGTH_S + 5), folder


@pytest.fixture(scope='session')
def long_folder(tmp_path_factory):
    """Return the folder of the recording of a drive of a quarter of an hour."""
    folder = tmp_path_factory.mktemp('long_flight')
    RecordedDrive(a_car(LONG_TARGET_C, LONG_S), folder).drive(LONG_S + 5)
    return folder
