"""Changes of a mission file's text that keep all other characters, and with them comments and layout.

The parser knows where each value stands. A change replaces, adds or removes only the characters of its own
value. The new text is parsed, and the change is refused unless it says exactly what was asked for.
"""

from __future__ import annotations

import functools
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from itertools import takewhile

from companion.config.source import Document, KeyPath, dotted, parse, written_text
from companion.errors import ConfigError

INDENT = 2
EXACT_MAX = 2**53  # Whole numbers up to this are exact.


@functools.lru_cache(maxsize=4)
def parsed(text: str) -> Document:
    """Return a parsed text; the same again while it is asked for, since several steps of a change need it.

    Raises
    ------
    ConfigError
        If it is no YAML.
    """
    return parse(text, "mission")


def replaced(text: str, values: Mapping[KeyPath, object]) -> str:
    """Return a text in which keys that it has hold other values.

    Parameters
    ----------
    text : str
        The mission file.
    values : mapping
        New value of each key or list entry.

    Raises
    ------
    ConfigError
        If a key is missing, or a value cannot be written.
    """
    document, expected = parsed(text), None
    spans = sorted((_span(document, path), path) for path in values)
    new, expected = text, document.data
    for (start, end), path in reversed(spans):
        gap = " " if start == end and new[start - 1 : start] == ":" else ""
        new = new[:start] + gap + written(path, values[path]) + new[end:]
        expected = _with(expected, path, lambda _, value=values[path]: _frozen(value))
    return _verified(document, new, expected, spans[0][1] if spans else ())


def with_key(text: str, path: KeyPath, value: object) -> str:
    """Return a text in which a key holds a value, whether the text has the key or not.

    Raises
    ------
    ConfigError
        If its section is a list or a plain value, or the value cannot be written.
    """
    document = parsed(text)
    parent = value_at(document.data, path[:-1])
    if path in document.places:
        return replaced(text, {path: value})
    if not isinstance(parent, dict):
        if parent is not None or not path[:-1] or isinstance(path[-2], int):
            raise document.error(path, "a key of a section that is there")
        return with_key(text, path[:-1], {path[-1]: value})
    entry = f"{path[-1]}: {written(path, value)}"
    expected = _with(document.data, path[:-1], lambda section: {**section, path[-1]: _frozen(value)})
    return _verified(document, _with_entry(document, path[:-1], entry), expected, path)


def with_item(text: str, path: KeyPath, value: object) -> str:
    """Return a text with one more entry in a list.

    Parameters
    ----------
    text : str
        The mission file.
    path : tuple
        Path of the new entry; entries from its number on move up by one. A missing list is made, and a word
        in its place, such as ``from_autopilot``, goes.
    value : object
        The new entry.

    Raises
    ------
    ConfigError
        If there is no such place, or the value cannot be written.
    """
    document, (where, number) = parsed(text), (path[:-1], path[-1])
    items = value_at(document.data, where)
    if not isinstance(number, int) or not 0 <= number <= (len(items) if isinstance(items, tuple) else 0):
        raise document.error(path, "a place in the list, or the one after its end")
    if isinstance(items, dict):
        raise document.error(path, "an entry of a list")
    if not isinstance(items, tuple) or not items:
        return _with_first_item(document, where, value)
    entry, new = written(path, value), text
    if _is_flow(document, where):
        if number < len(items):
            start = document.places[path][1]
            new = f"{text[:start]}{entry}, {text[start:]}"
        else:
            end = _span(document, (*where, number - 1))[1]
            new = f"{text[:end]}, {entry}{text[end:]}"
    else:
        near = (*where, max(0, number - 1))
        dash = _dash(document, near)
        at = _line_start(text, dash) if number == 0 else _line_end(text, _span(document, near)[1])
        line = " " * (dash - _line_start(text, dash)) + f"- {entry}"
        new = _with_line(text, at, line)
    expected = _with(
        document.data, where, lambda entries: (*entries[:number], _frozen(value), *entries[number:])
    )
    return _verified(document, new, expected, path)


def without(text: str, path: KeyPath) -> str:
    """Return a text without a key or a list entry.

    Raises
    ------
    ConfigError
        If there is none, or it stands where it cannot be removed alone.
    """
    document, (where, last) = parsed(text), (path[:-1], path[-1])
    if path not in document.places:
        raise document.error(path, "a key of the file")
    end = _span(document, path)[1]
    parent = value_at(document.data, where)
    keys = list(parent) if isinstance(parent, dict) else list(range(len(parent)))  # type: ignore[arg-type]
    if _is_flow(document, where):
        new = _without_flow(document, where, keys, last)
    else:
        is_item = isinstance(parent, tuple)
        first = _line_start(text, _dash(document, path) if is_item else _key_start(document, path))
        stop = _line_end(text, end)
        new = text[:first] + text[stop:]
        if len(keys) == 1 and is_item:
            colon = _key_start(document, where) + len(str(where[-1])) + 1
            new = text[:colon] + " []" + text[colon:first] + text[stop:]

    def less(section: object) -> object:
        if isinstance(section, tuple):
            return tuple(entry for number, entry in enumerate(section) if number != last)
        assert isinstance(section, dict)
        return {key: entry for key, entry in section.items() if key != last}

    return _verified(document, new, _with(document.data, where, less), path)


def exchanged(text: str, path: KeyPath, by: int) -> str:
    """Return a text in which an entry of a list has changed places with another, with their comments.

    Parameters
    ----------
    text : str
        The mission file.
    path : tuple
        Path of the entry.
    by : int
        Number of the other entry less that of this one.

    Raises
    ------
    ConfigError
        If there is no other entry there.
    """
    document, where, number = parsed(text), path[:-1], path[-1]
    items = value_at(document.data, where)
    if not isinstance(items, tuple) or not isinstance(number, int) or not 0 <= number + by < len(items):
        raise document.error(path, f"an entry of a list, with another one {by:+d} from it")
    low, high = sorted((number, number + by))
    (begin, end), (first, last) = (_extent(document, (*where, each)) for each in (low, high))
    order = list(items)
    order[low], order[high] = order[high], order[low]
    new = text[:begin] + text[first:last] + text[end:first] + text[begin:end] + text[last:]
    return _verified(document, new, _with(document.data, where, lambda _: tuple(order)), path)


def value_at(data: object, path: KeyPath) -> object:
    """Return what a parsed file holds at a path; None if there is nothing."""
    for part in path:
        if isinstance(data, dict):
            data = data.get(part)
        elif isinstance(data, tuple) and isinstance(part, int) and 0 <= part < len(data):
            data = data[part]
        else:
            return None
    return data


def written(path: KeyPath, value: object) -> str:
    """Return a value as it is written on one line of a mission file.

    Raises
    ------
    ConfigError
        If it is no number, text, truth value, list or mapping of these.
    """
    if isinstance(value, bool) or value is None:
        return json.dumps(value)
    if isinstance(value, int | float) and math.isfinite(value):
        return _number(value)
    if isinstance(value, str):
        return written_text(value)
    if isinstance(value, list | tuple):
        return "[" + ", ".join(written(path, entry) for entry in value) + "]"
    if isinstance(value, dict):
        entries = (f"{key}: {written(path, entry)}" for key, entry in value.items())
        return "{" + ", ".join(entries) + "}"
    raise ConfigError("change", None, dotted(path), repr(value)[:60], "a finite number, text, true or false")


def _number(value: float) -> str:
    """Return a number without needless digits."""
    return str(int(value)) if float(value).is_integer() and abs(value) < EXACT_MAX else repr(value)


def _verified(document: Document, text: str, expected: object, path: KeyPath) -> str:
    """Return a changed text if it says what is expected."""
    try:
        is_right = parsed(text).data == expected
    except ConfigError:
        is_right = False
    if not is_right:
        raise document.error(path, "a layout that can be changed here; change this place in the file by hand")
    return text


def _with(data: object, path: KeyPath, change: Callable[..., object]) -> object:
    """Return parsed data with another value at a path."""
    if not path:
        return change(data)
    if isinstance(data, tuple):
        number = int(path[0])
        return (*data[:number], _with(data[number], path[1:], change), *data[number + 1 :])
    assert isinstance(data, dict)
    return {**data, path[0]: _with(data.get(str(path[0])), path[1:], change)}


def _frozen(value: object) -> object:
    """Return a value as the parser would: lists are tuples."""
    if isinstance(value, list | tuple):
        return tuple(map(_frozen, value))
    return {key: _frozen(entry) for key, entry in value.items()} if isinstance(value, dict) else value


def _span(document: Document, path: KeyPath) -> tuple[int, int]:
    """Return start and end of a value's own characters; what follows it on its line is not part of it."""
    if path not in document.places:
        raise document.error(path, "a key of the file")
    _, start, end = document.places[path]
    value = value_at(document.data, path)
    if isinstance(value, dict | tuple) and value and not _is_flow(document, path):
        last = list(value)[-1] if isinstance(value, dict) else len(value) - 1
        return start, _span(document, (*path, last))[1]
    return start, start + len(document.text[start:end].rstrip())


def _extent(document: Document, path: KeyPath) -> tuple[int, int]:
    """Return start and end of a list's entry: of its lines, unless the list is in brackets."""
    start, end = _span(document, path)
    if _is_flow(document, path[:-1]):
        return start, end
    return _line_start(document.text, _dash(document, path)), _line_end(document.text, end)


def _is_flow(document: Document, path: KeyPath) -> bool:
    """Return whether a list or section is written in brackets."""
    start = document.places[path][1]
    return document.text[start : start + 1] in ("{", "[")


def _line_start(text: str, at: int) -> int:
    return text.rfind("\n", 0, at) + 1


def _line_end(text: str, at: int) -> int:
    """Return where the next line begins."""
    found = text.find("\n", at)
    return len(text) if found < 0 else found + 1


def _with_line(text: str, at: int, line: str) -> str:
    """Return a text with one more line, which ends as the others do."""
    end = "\r\n" if "\r\n" in text else "\n"
    begin = end if at and text[at - 1] != "\n" else ""
    return f"{text[:at]}{begin}{line}{'' if begin else end}{text[at:]}"


def _dash(document: Document, path: KeyPath) -> int:
    """Return where the dash of an entry of a list stands."""
    return document.text.rindex("-", 0, document.places[path][1])


def _key_start(document: Document, path: KeyPath) -> int:
    """Return where the line's key stands whose value is at a path: the last one before the value."""
    key = re.compile(rf"^[ -]*{re.escape(str(path[-1]))}[ ]*:", re.M)
    starts = [found.start() for found in key.finditer(document.text[: document.places[path][1] + 1])]
    if not starts:
        raise document.error(path, "a key on a line of its own")
    at = starts[-1]
    return at + len(list(takewhile(lambda letter: letter in " -", document.text[at:])))


def _with_entry(document: Document, path: KeyPath, entry: str) -> str:
    """Return the text with one more entry at the end of a section."""
    text, section = document.text, value_at(document.data, path)
    start = document.places[path][1]
    if not section:
        return f"{text[: start + 1]}{entry}{text[start + 1 :]}"
    assert isinstance(section, dict)
    last = _span(document, (*path, list(section)[-1]))[1]
    if path and _is_flow(document, path):
        return f"{text[:last]}, {entry}{text[last:]}"
    column = start - _line_start(text, start) if path else 0
    return _with_line(text, _line_end(text, last), " " * column + entry)


def _with_first_item(document: Document, path: KeyPath, value: object) -> str:
    """Return the text with a list that has one entry; mappings stand on lines of their own."""
    text, entry = document.text, written(path, value)
    if len(path) > 1 or not isinstance(value, dict):
        return with_key(text, path, [value])
    assert isinstance(document.data, dict)
    expected = {**document.data, path[0]: (_frozen(value),)}
    block = f"\n{' ' * INDENT}- {entry}"
    if path in document.places:
        start, end = _span(document, path)
        new = text[:start].rstrip(" ") + block + text[end:]
    else:
        new = _with_entry(document, (), f"{path[0]}:{block}")
    if "\r\n" in text:
        new = new.replace("\r\n", "\n").replace("\n", "\r\n")
    return _verified(document, new, expected, path)


def _without_flow(document: Document, path: KeyPath, keys: Sequence[str | int], last: str | int) -> str:
    """Return the text without an entry of a list or section in brackets, and without its comma."""
    text, number = document.text, keys.index(last)
    if number:
        begin, end = _span(document, (*path, keys[number - 1]))[1], _span(document, (*path, last))[1]
        return text[:begin] + text[end:]
    begin = document.places[path][1] + 1
    if len(keys) == 1:
        return text[:begin] + text[_span(document, (*path, last))[1] :]
    comma = text.index(",", _span(document, (*path, last))[1]) + 1
    rest = text[comma:]
    return text[:begin] + rest[len(rest) - len(rest.lstrip()) :]
