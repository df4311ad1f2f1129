"""Text that came from elsewhere, made harmless where it is shown: on terminals, in logs, pages and pictures.

An escape character can hide or rewrite what a terminal shows, a line's end forge a line of the log, and
marks of writing direction turn a text round.
"""

from __future__ import annotations

import html
import unicodedata

_BLANKS = frozenset("\t\n\v\f\r\x1c\x1d\x1e\x1f\x85\u2028\u2029")


def printable(text: object) -> str:
    """A text on one line: line ends and tabs as blanks, whatever else cannot be printed as question marks."""
    words = str(text)
    return words if words.isprintable() else "".join(map(_shown, words))


def in_page(text: object) -> str:
    """A text as it stands in a page of HTML."""
    return html.escape(printable(text))


def _shown(character: str) -> str:
    if character.isprintable() or unicodedata.category(character) == "Zs":
        return character
    return " " if character in _BLANKS else "?"
