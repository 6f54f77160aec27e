# SPDX-License-Identifier: Apache-2.0
"""Sphinx configuration of the documentation: `make docs`."""

from pathlib import Path
import sys
from xml.etree import ElementTree

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent), str(HERE.parent / 'studies')]

from generated_reference import write_reference  # noqa: E402

project = 'bev_preheat'
project_copyright = 'bev_preheat maintainers, Apache-2.0'
version = release = ElementTree.parse(HERE.parent / 'package.xml').findtext('version')

extensions = ['myst_parser', 'sphinx.ext.mathjax', 'sphinx-mathjax-offline']
# Formulas as GitHub writes them: $…$ in a line, ```math for a block. MathJax is part of the site.
myst_enable_extensions = ['dollarmath']
myst_fence_as_directive = ['math']
# The files of this folder are included by the pages of reference/.
exclude_patterns = ['reference/generated/*']
# Links may point to headings: page.md#heading.
myst_heading_anchors = 4
myst_links_external_new_tab = False
highlight_language = 'none'

html_theme = 'furo'
html_title = f'bev_preheat {version}'
html_static_path = ['static']
html_css_files = ['tables.css']
html_copy_source = False
html_show_sphinx = False

write_reference(HERE / 'reference/generated')
