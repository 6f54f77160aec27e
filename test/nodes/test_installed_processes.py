# SPDX-License-Identifier: Apache-2.0
"""Private ROS domains."""

import socket

import domain_coordinator
import pytest

from bev_preheat.simulator import installed_drive
from bev_preheat.simulator.installed_drive import reserved_domain_id


def test_reserved_domains_differ(monkeypatch):
    monkeypatch.setattr(installed_drive, 'DOMAIN_IDS', range(91, 101))
    with reserved_domain_id() as first, reserved_domain_id() as second:
        assert first != second
        assert {first, second} <= set(range(91, 101))


# DDSI-RTPS 9.6.1.1: the first participant's port is 10 above the domain's, each next port 2 higher.
# Earlier participants of a domain may have ended.
@pytest.mark.parametrize('participants_before', [0, 1, 6, 30])
def test_domain_in_which_somebody_takes_part_is_left_alone(monkeypatch, participants_before):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        with reserved_domain_id() as taken:
            participant.bind(('127.0.0.1', 7400 + 250 * taken + 10 + 2 * participants_before))
        monkeypatch.setattr(installed_drive, 'DOMAIN_IDS', range(taken, taken + 1))
        with pytest.raises(RuntimeError, match='are all in use'), reserved_domain_id():
            pass


def test_domain_is_free_again_afterwards(monkeypatch):
    with reserved_domain_id() as domain_id:
        monkeypatch.setattr(installed_drive, 'DOMAIN_IDS', range(domain_id, domain_id + 1))
    with reserved_domain_id() as again:
        assert again == domain_id


def test_an_error_of_the_block_is_told_as_it_is(monkeypatch):
    with pytest.raises(FileNotFoundError, match='route'), reserved_domain_id() as domain_id:
        raise FileNotFoundError('route')
    monkeypatch.setattr(installed_drive, 'DOMAIN_IDS', range(domain_id, domain_id + 1))
    with reserved_domain_id() as again:
        assert again == domain_id


def test_those_who_reserve_by_the_convention_of_ros_are_respected(monkeypatch):
    with reserved_domain_id() as domain_id:
        monkeypatch.setattr(installed_drive, 'DOMAIN_IDS', range(domain_id, domain_id + 1))
    with domain_coordinator.domain_id(lambda: domain_id):
        with pytest.raises(RuntimeError, match='are all in use'), reserved_domain_id():
            pass
