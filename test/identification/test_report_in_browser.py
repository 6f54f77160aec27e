# SPDX-License-Identifier: Apache-2.0
"""The report of an identification fits the windows of a computer and of a phone."""

from types import SimpleNamespace

from browser import browser
import pytest

pytestmark = [pytest.mark.needs('selenium', 'chromium', 'chromedriver', 'jinja2')]
WIDE = 'a_recording_with_a_long_name_and_no_space_' * 4
PICTURE = '<svg width="1400" height="200" viewBox="0 0 1400 200"><rect width="1400" height="200"/></svg>'


def a_result():
    """Return the page of an Identification, with long words in each table and sentence."""
    estimate = SimpleNamespace(label=WIDE, unit='kJ/K', start=1.0, estimate=2.0, low=1.5, high=2.5, prior_low=0.5,
                               prior_high=5.0, arrival_k=0.3, prior=WIDE, is_identified=True)
    structure = SimpleNamespace(structure=WIDE, rmse_k=1.0, worst_k=2.0, cost=3.0, diverges=False)
    return SimpleNamespace(
        vehicle=SimpleNamespace(name=WIDE), start_name=WIDE, verdict=(WIDE,), record_next=(WIDE,),
        coverage=SimpleNamespace(trips=1, drives=1, nights=0, charging_sessions=0, hours=1.0),
        estimates=[estimate], rmse_k=0.5, worst_k=1.0,
        left_out=[SimpleNamespace(name=WIDE, error_k=0.5, deviation_k=0.2, is_within=True)],
        structures=[structure], baselines={'constant': structure}, structure='', remarks=(WIDE,))


@pytest.mark.parametrize('width', [1280, 390])
def test_the_page_is_no_wider_than_the_window(tmp_path, width):
    from bev_preheat.identification.result import report_text
    page = tmp_path / 'report.html'
    page.write_text(report_text(a_result(), dict.fromkeys(
        ('resistance', 'unseen', 'trips', 'residuals', 'coverage'), PICTURE)), encoding='utf-8')
    with browser(tmp_path / 'profile') as chromium:
        chromium.size(width, 800)
        chromium.open(page.as_uri())
        assert chromium.run('return window.innerWidth') == width
        assert chromium.overflow_px() <= 0
