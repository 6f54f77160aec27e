# SPDX-License-Identifier: Apache-2.0
"""The tutorial docs/tutorials/your_bus.md: its files, and its commands as printed, up to the first command."""

from pathlib import Path
import re
import shlex
import signal
import subprocess
import sys

from node_bench import poll_until
import pytest
from typed_pages import files_of

pytestmark = [pytest.mark.needs('cantools'), pytest.mark.needs('can'), pytest.mark.needs('crccheck'),
              pytest.mark.needs('serial')]
PAGE_FILE = Path(__file__).parents[2] / 'docs/tutorials/your_bus.md'
PAGE = PAGE_FILE.read_text()
COMMANDS = [shlex.split(line) for block in re.findall(r'```bash\n(.*?)```', PAGE, re.DOTALL)
            for line in block.splitlines()]


@pytest.fixture
def car(tmp_path, monkeypatch):
    """Return the lines that the car of the tutorial has printed so far, in a folder with the page's files."""
    monkeypatch.chdir(tmp_path)
    for name, content in files_of(PAGE_FILE).items():
        (tmp_path / name).write_text(content)
    words = [sys.executable, *COMMANDS[0][1:]]
    with open(tmp_path / 'car.log', 'w') as output, subprocess.Popen(words, stdout=output) as process:
        yield lambda: (tmp_path / 'car.log').read_text().splitlines()
        assert process.poll() is None
        process.kill()


@pytest.mark.deep
def test_commands_as_printed_lead_to_the_first_command_of_the_heater(car, start_executable):
    assert COMMANDS[0] == ['python3', 'play_car.py']
    shown = re.search(r'```text\n(heater: .*?)\n```', PAGE, re.DOTALL)[1].splitlines()
    poll_until(car, 'the car plays')
    processes = {}
    for words in COMMANDS[1:]:
        assert words[:3] == ['ros2', 'run', 'bev_preheat'] and words[4] == '--ros-args'
        processes[words[3]] = start_executable(words[3], *words[5:])
    poll_until(lambda: len(car()) >= len(shown), 'the first command')
    # It may take seconds; meanwhile the battery cools a little.
    assert [line.split(',')[0] for line in car()[:len(shown)]] == [line.split(',')[0] for line in shown]
    processes['planner'].send_signal(signal.SIGKILL)
    # After its lease, as test_bus_gateway.py and test_whole_car.py show.
    poll_until(lambda: car()[-1].startswith('heater: 0 W'), '0 W')
