"""Makes text from other sources harmless before it is shown in terminals, logs, pages and pictures.

An escape sequence can hide or rewrite the content of a terminal, a line end can forge a line of a log, and
characters that set the writing direction can reverse text.
"""

from __future__ import annotations

import html
import unicodedata

_BLANKS = frozenset("\t\n\v\f\r\x1c\x1d\x1e\x1f\x85\u2028\u2029")


def printable(text: object) -> str:
    """Return the text on one line; line ends and tabs become blanks, unprintable characters become ``?``."""
    words = str(text)
    return words if words.isprintable() else "".join(map(_shown, words))


def in_page(text: object) -> str:
    """Return the text for an HTML page."""
    return html.escape(printable(text))


def _shown(character: str) -> str:
    if character.isprintable() or unicodedata.category(character) == "Zs":
        return character
    return " " if character in _BLANKS else "?"
