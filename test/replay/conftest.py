# SPDX-License-Identifier: Apache-2.0
"""A recorded drive for all tests of this folder."""

import pytest
from recorded_drive import a_car, LENGTH_S, RecordedDrive


@pytest.fixture(scope='session')
def recorded(tmp_path_factory):
    """Return the RecordedDrive of a quarter of an hour, and the folder of its recording."""
    folder = tmp_path_factory.mktemp('flights')
    return RecordedDrive(a_car(), folder).drive(LENGTH_S + 5), folder
