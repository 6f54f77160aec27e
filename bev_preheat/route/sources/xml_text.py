# SPDX-License-Identifier: Apache-2.0
"""Checks XML before it is read: well-formed, without document types and their entities."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.parsers import expat

from bev_preheat.errors import InvalidInput

if TYPE_CHECKING:
    from collections.abc import Callable

# Deeper nesting is no route.
MOST_DEPTH = 50


class _Refusal(Exception):
    """Ends the parser."""


def check_xml(text: bytes, on_element: Callable[[str, dict[str, str], int], None] | None = None) -> None:
    """
    Raise InvalidInput naming the line if a text is not well-formed XML, or has a document type.

    `on_element` gets the name (without namespace), the attributes and the line of each element.
    """
    parser = expat.ParserCreate()
    depth = 0

    def refuse(*_: object) -> None:
        raise _Refusal('has a document type (<!DOCTYPE …>); delete it: routes need none')

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MOST_DEPTH:
            raise _Refusal(f'elements are nested more than {MOST_DEPTH} deep')
        if on_element is not None:
            on_element(name.rpartition(':')[2], attributes, parser.CurrentLineNumber)

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    try:
        parser.Parse(text, True)
    except _Refusal as error:
        raise InvalidInput(f'line {parser.CurrentLineNumber}: {error}') from error
    except expat.ExpatError as error:
        raise InvalidInput(f'line {error.lineno}: is not XML: {expat.ErrorString(error.code)}; is the file '
                           'complete?') from error
    except InvalidInput:
        raise
    except (ValueError, LookupError) as error:
        raise InvalidInput(f'line {parser.CurrentLineNumber}: is not XML: {error}') from error
