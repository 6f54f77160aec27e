# SPDX-License-Identifier: Apache-2.0
"""CITATION.cff agrees with package.xml and with the page on the paper."""

from pathlib import Path
from xml.etree import ElementTree

import yaml

ROOT = Path(__file__).resolve().parents[1]
CITATION = yaml.safe_load((ROOT / 'CITATION.cff').read_text())
PACKAGE = ElementTree.parse(ROOT / 'package.xml')


def words(text):
    return ' '.join(text.split())


def test_the_citation_is_that_of_the_package():
    assert CITATION['cff-version'] == '1.2.0' and CITATION['message']
    assert CITATION['title'] == PACKAGE.findtext('name')
    # YAML reads 0.10 as a number; three parts are a text.
    assert CITATION['version'] == PACKAGE.findtext('version')
    assert CITATION['license'] == PACKAGE.findtext('license')
    assert CITATION['authors'] == [{'name': PACKAGE.findtext('maintainer')}]


def test_the_paper_is_cited_as_on_its_page():
    paper, = CITATION['references']
    head = words((ROOT / 'docs/explanation/paper.md').read_text().split('\n\n')[1])
    authors = ', '.join(f'{author["given-names"][0]}. {author["family-names"]}' for author in paper['authors'])
    assert head == f'{authors}: *{paper["title"]}.*'
