# SPDX-License-Identifier: Apache-2.0
"""The options of `preheat plan` on the prospect of charging."""

import pytest

DRIVE = ['plan', '--vehicle', 'reference', '--route', 'reference', '--temperature', '-7', '--soc', '0.5']


@pytest.mark.parametrize('option, value, named', [
    ('--charging-probability', 'nan', 'charging probability: nan'),
    ('--charging-probability', '1.1', 'charging probability: 1.1'),
    ('--arrival-deviation', '-1', 'arrival deviation: -1'),
    ('--charging-known-before', 'inf', 'time before arrival: inf')])
def test_a_bad_prospect_is_refused_in_one_line(refused, option, value, named):
    assert f'{named} is not allowed' in refused(*DRIVE, option, value)
