# SPDX-License-Identifier: Apache-2.0
"""Sphinx configuration of the documentation: `make docs`."""

from pathlib import Path
import re
from shutil import rmtree
import sys
from xml.etree import ElementTree

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent), str(HERE.parent / 'studies')]

import bev_preheat  # noqa: E402

project = 'bev_preheat'
project_copyright = 'bev_preheat maintainers, Apache-2.0'
version = release = ElementTree.parse(HERE.parent / 'package.xml').findtext('version')

extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.mathjax', 'sphinx-mathjax-offline',
              'sphinx_gallery.gen_gallery']
# Formulas as GitHub writes them: $…$ in a line, ```math for a block. MathJax is part of the site.
myst_enable_extensions = ['dollarmath']
myst_fence_as_directive = ['math']
exclude_patterns = ['examples/*']
# Links may point to headings: page.md#heading.
myst_heading_anchors = 4
myst_links_external_new_tab = False
highlight_language = 'none'

# The public interface, in reference/python.md: each class with its documented attributes and methods.
autodoc_default_options = {'members': True, 'inherited-members': 'object, BaseException',
                           'member-order': 'bysource'}
autodoc_typehints = 'signature'
python_maximum_signature_line_length = 88
# Docstrings have code in single backticks.
default_role = 'code'
# Types in signatures that have no page: those of other packages, and internal ones.
nitpick_ignore_regex = [
    ('py:class', r'AnyMethod|ArrayLike|Axes|DataFrame|FloatArray|Path|collections\.abc\.\w+'),
    ('py:class', r'(Car|Gap)Result|ChargingStop|Check|HeatingChoice|Identification|Optimum|Plan|Reproduction'),
    ('py:class', r'Schedule|Session|Trip|Worth'),
    ('py:class', r'bev_preheat\.(simulation|vehicle)\.[\w.]+'),
]

# Each script of examples/ is run and becomes a page of gallery/. sphinx-gallery would not run an unchanged script
# again, although the package may have changed, so gallery/ is rebuilt.
rmtree(HERE / 'gallery', ignore_errors=True)
sphinx_gallery_conf = {
    'examples_dirs': 'examples',
    'gallery_dirs': 'gallery',
    'filename_pattern': r'\.py$',
    'within_subsection_order': 'example_order.place_of',
    'abort_on_example_error': True,
    'capture_repr': (),
    'download_all_examples': False,
    'show_signature': False,
    'write_computation_times': False,
    'min_reported_time': 1e9,
}

html_theme = 'furo'
html_title = f'bev_preheat {version}'
html_static_path = ['static']
html_css_files = ['tables.css']
html_copy_source = False
html_show_sphinx = False


def link_to_gallery(app, name, source):
    """Let links to the examples' scripts, which Git hosts show, lead to their pages in the gallery."""
    source[0] = re.sub(r'\]\(((?:\.\./)?)examples/(?:(GALLERY_HEADER)\.rst|(\w+)\.py)\)',
                       lambda link: f']({link[1]}gallery/{"index" if link[2] else link[3]}.rst)', source[0])


def link_public_names(app, what, name, obj, options, lines):
    """Turn public classes, and functions with brackets, into links in a docstring."""
    for number, line in enumerate(lines):
        line = re.sub(r'`(\w+)\(\)`', lambda found: (
            f':func:`{found[1]}`' if found[1] in bev_preheat.__all__ else found[0]), line)
        lines[number] = re.sub(r'(?<![\w.`:])([A-Z]\w+)(?![\w.`(])', lambda found: (
            f':class:`{found[1]}`' if found[1] in bev_preheat.__all__ else found[0]), line)


def setup(app):
    """Connect the functions above to the build."""
    app.connect('autodoc-process-docstring', link_public_names)
    app.connect('source-read', link_to_gallery)
