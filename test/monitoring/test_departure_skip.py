# SPDX-License-Identifier: Apache-2.0
"""`preheat prepare --skip-next` and `--skip-none`: the request to the planner, and its answers in words."""

from contextlib import contextmanager
from types import SimpleNamespace

import pytest
from rclpy.task import Future
from std_srvs.srv import SetBool

from bev_preheat.commands.main import main
from bev_preheat.monitoring import planner_client


class Planner:
    """In place of a Listener and its node: a planner whose service comes and answers as time passes."""

    def __init__(self, there_after_s, answer_after_s, response):
        self._there_s, self._answer_s, self._response = there_after_s, there_after_s + answer_after_s, response
        self.now_s, self.asked, self.node = 0.0, [], self

    def create_client(self, service_type, name):
        assert service_type is SetBool
        self.service = name
        return SimpleNamespace(service_is_ready=lambda: self.now_s >= self._there_s, call_async=self._ask)

    def _ask(self, request):
        self.asked.append(request.data)
        self._answer = Future()
        return self._answer

    def monotonic(self):
        return self.now_s

    def listen(self, duration_s):
        self.now_s += duration_s
        if self.asked and self.now_s >= self._answer_s and not self._answer.done():
            self._answer.set_result(self._response)


@pytest.fixture
def skip(monkeypatch, capfd):
    """`skip(planner, *arguments)` runs the command with a Planner: its exit status, output and errors."""
    def skip(planner, *arguments):
        @contextmanager
        def listening(name, namespace):
            planner.namespace = namespace
            yield planner

        monkeypatch.setattr('bev_preheat.nodes.listening.listening', listening)
        monkeypatch.setattr(planner_client, 'time', planner)
        monkeypatch.setenv('COLUMNS', '200')
        return main(['prepare', *arguments]), *capfd.readouterr()

    return skip


@pytest.mark.parametrize('option, is_skipped', [('--skip-next', True), ('--skip-none', False)])
def test_the_planner_is_asked_once_and_its_sentence_is_printed(skip, option, is_skipped):
    planner = Planner(0.5, 0.5, SetBool.Response(success=True, message='Skipped: work.'))
    assert skip(planner, option, '--namespace', '/car') == (0, 'Skipped: work.\n', '')
    assert (planner.service, planner.asked) == ('/car/planner/skip_departure', [is_skipped])


@pytest.mark.parametrize('there_s, answers_s, asked, told', [
    (1e9, 0.0, [], 'no planner answers as /planner: is it running'),
    # A second request would skip another departure.
    (0.0, 1e9, [True], '/planner has not answered')])
def test_a_planner_that_does_not_answer_gets_no_second_request(skip, there_s, answers_s, asked, told):
    planner = Planner(there_s, answers_s, None)
    status, _, errors = skip(planner, '--skip-next')
    assert (status, planner.asked) == (2, asked) and told in errors
    assert planner.now_s < 60.0
