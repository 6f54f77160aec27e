# SPDX-License-Identifier: Apache-2.0
"""The log suppresses repetitions and shows everything new."""

import pytest

from bev_preheat.nodes.news import RepetitionFilter

TOO_OLD = 'battery_state refused: header.stamp: is {} s old; at most 5 s are allowed'


class Clock:
    """Real time, set by hand."""

    now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def clock():
    return Clock()


def test_a_sentence_is_news_again_after_5_s(clock):
    news, told_s = RepetitionFilter(clock), []
    for tenths in range(101):
        clock.now_s = 100.0 + tenths / 10.0
        if news.has('route_plan refused: speed: is empty'):
            told_s.append(clock.now_s)
    assert told_s == [100.0, 105.0, 110.0]


def test_another_problem_is_news_at_once(clock):
    news = RepetitionFilter(clock)
    for sentence in ('battery_state refused: temperature: nan is not allowed',
                     'battery_state refused: percentage: nan is not allowed',
                     'route_plan refused: speed: is empty'):
        assert news.has(sentence)
        assert not news.has(sentence)


@pytest.mark.parametrize('figure', ['7', '7.25', '-7.25', '1e+09', '1.5e-07'])
def test_other_figures_are_no_news(clock, figure):
    news = RepetitionFilter(clock)
    assert news.has(TOO_OLD.format('6.1'))
    assert not news.has(TOO_OLD.format(figure))


def test_whoever_makes_up_sentences_does_not_fill_the_disk(clock):
    news, lines = RepetitionFilter(clock), 0
    for number in range(60_000):
        clock.now_s = 100.0 + number / 1000.0
        lines += news.has('route_plan refused: ' + chr(0x4e00 + number % 20_000))
    # 10 in each 5 s.
    assert lines == 120
