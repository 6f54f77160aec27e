# SPDX-License-Identifier: Apache-2.0
"""Runs the installed executables as processes, isolated from all other ROS traffic of the machine."""

from __future__ import annotations

from contextlib import contextmanager
import os
from pathlib import Path
import random
import socket
import subprocess
from typing import TYPE_CHECKING

from ament_index_python.packages import get_package_prefix
import domain_coordinator

from bev_preheat.files.output_files import existing_file

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from bev_preheat.files.output_files import AnyPath

# Domains whose UDP ports lie below Linux's ephemeral ports; 0 is the default domain.
DOMAIN_IDS = range(1, 101)
# UDP ports of a DDS domain (DDSI-RTPS 9.6.1.1): 250 from here, the participants' from 10 on, two each.
FIRST_PORT = 7400
PORTS_PER_DOMAIN = 250
PARTICIPANT_PORTS = range(10, 250, 2)
# Ending takes half a second, longer on a busy computer.
SECONDS_TO_END = 15.0


@contextmanager
def reserved_domain_id() -> Iterator[int]:
    """
    Reserve an unused ROS_DOMAIN_ID of this machine during the block.

    Other callers of this function and of `domain_coordinator.domain_id()` respect the reservation; other
    programs may still pick the same. Raises RuntimeError if none is left.
    """
    candidates = list(DOMAIN_IDS)
    # Not the module's seeded generator: two test runs with one seed would compete for domains.
    random.SystemRandom().shuffle(candidates)
    reservation = domain_coordinator.domain_id(lambda: _next_unused(candidates))
    domain_id = reservation.__enter__()
    try:
        yield domain_id
    finally:
        # An OSError of the block must not reach it: it would take the domain for one in use.
        reservation.__exit__(None, None, None)


def _next_unused(candidates: list[int]) -> int:
    """Remove candidates until one has no running participant, and return that one."""
    while candidates:
        domain_id = candidates.pop()
        if _is_unused(domain_id):
            return domain_id
    raise RuntimeError(f'ROS domains {DOMAIN_IDS[0]} ... {DOMAIN_IDS[-1]} are all in use')


def _is_unused(domain_id: int) -> bool:
    # The first participant may be gone while a later one still runs.
    first_port = FIRST_PORT + PORTS_PER_DOMAIN * domain_id
    return all(_is_free(first_port + port) for port in PARTICIPANT_PORTS)


def _is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(('127.0.0.1', port))
        except OSError:
            return False
    return True


class NodeProcess:
    """
    A running installed executable of this package; its output goes to a file.

    It is the file that `ros2 run bev_preheat NAME` looks up. As a context manager it ends the process on exit.
    """

    def __init__(self, name: str, ros_arguments: Iterable[str], log_file: AnyPath) -> None:
        """
        Start `name` with the texts of `ros_arguments` behind --ros-args.

        It inherits the environment. Raises FileNotFoundError if the package is not built, InvalidInput if the
        log cannot be a file.
        """
        self.name = name
        self.log_file = Path(log_file)
        executable = Path(get_package_prefix('bev_preheat')) / 'lib' / 'bev_preheat' / name
        # Opening a pipe would wait for a reader; opening a device may have side effects.
        existing_file(self.log_file)
        with open(self.log_file, 'wb') as log:
            self._process = subprocess.Popen(
                [str(executable), '--ros-args', *ros_arguments],
                stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                # Plain text in the file, even if the caller has a terminal.
                env=dict(os.environ, RCUTILS_COLORIZED_OUTPUT='0'))

    def __enter__(self) -> NodeProcess:
        """Return the process."""
        return self

    def __exit__(self, *exception: object) -> None:
        """End the process."""
        self.end()

    @property
    def process_id(self) -> int:
        """Return the process id."""
        return self._process.pid

    @property
    def exit_status(self) -> int | None:
        """None while it runs; then 0 ... 255, or -N if signal N ended it."""
        return self._process.poll()

    def output(self) -> str:
        """Return its output so far."""
        return self.log_file.read_text(encoding='utf-8', errors='replace')

    def send_signal(self, number: int) -> None:
        """Send it a signal."""
        self._process.send_signal(number)

    def wait(self, timeout_s: float = SECONDS_TO_END) -> int:
        """Return the exit status; raises subprocess.TimeoutExpired if it is still running."""
        return self._process.wait(timeout_s)

    def end(self) -> int:
        """End it with SIGTERM, if necessary with SIGKILL, and return the exit status."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(SECONDS_TO_END)
            except BaseException as reason:
                # It took too long, or the caller was interrupted.
                self._process.kill()
                if not isinstance(reason, subprocess.TimeoutExpired):
                    raise
        return self._process.wait()
