# SPDX-License-Identifier: Apache-2.0
"""The names of the Vehicle Signal Specification in a recording are those that the signal map and the bus use."""

from pathlib import Path
import re

import pytest

from bev_preheat.bus import conditioning

pytestmark = [pytest.mark.needs('mcap'), pytest.mark.needs('rclpy')]
ROOT = Path(__file__).resolve().parents[2]


def test_each_name_is_known_and_each_field_is_recorded():
    from bev_preheat.nodes.flight_recording import METADATA, TYPES
    signal_map = (ROOT / 'config' / 'signals' / 'vss.yaml').read_text()
    patterns = [re.compile(text) for text in re.findall(r"'/(.*?)/'", signal_map)]
    names = {conditioning.TEMPERATURE, 'Vehicle.Powertrain.TractionBattery.Charging.IsCharging'}
    assert 'Charging.IsCharging' in signal_map
    for field, name in METADATA['vss'].items():
        topic, _, attribute = field.partition('.')
        assert hasattr(TYPES[topic](), attribute), field
        # The first pattern recognises the whole branch.
        assert name in names or any(pattern.search(name) for pattern in patterns[1:]), name


def test_the_names_are_in_the_file(tmp_path):
    from mcap.reader import make_reader

    from bev_preheat.flight_recorder.ring import recordings_in
    from bev_preheat.flight_recorder.steps import RecordedStep
    from bev_preheat.flight_recorder.writer import Entry, Recording, RecordingWriter, STEP_CHANNEL
    from bev_preheat.nodes.flight_recording import METADATA
    writer = RecordingWriter(Recording(tmp_path, 10**9, '01234567', '20260101T000000'), {}, tuple, METADATA)
    writer.put(Entry(STEP_CHANNEL, 1, RecordedStep(1)))
    writer.close(10.0)
    [path] = recordings_in(tmp_path)
    with open(path, 'rb') as file:
        [metadata] = list(make_reader(file).iter_metadata())
    assert metadata.name == 'vss' and metadata.metadata == METADATA['vss']
