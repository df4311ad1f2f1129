"""YAML parser that records the position of every key, for error messages.

It is stricter than YAML: it refuses aliases (a key must mean what is written there), tags, duplicate keys
(YAML silently takes the last one), octal and base-60 numbers (``010`` would be 8, ``1:30`` 90), numbers with
more digits than any value needs, and dates.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field

import yaml

from companion.errors import ConfigError

KeyPath = tuple[str | int, ...]

# Characters. Checking a text this long delays the event loop by a few tenths of a second.
SIZE_MAX = 1_000_000
_DEPTH_MAX = 20
_EXCERPT_MAX = 60
_DIGITS_MAX = 40
_TAG = "tag:yaml.org,2002:"
_PLAIN_NUMBER = re.compile(
    r"[-+]?(0|[1-9][0-9]*)(\.[0-9]*)?([eE][-+]?[0-9]+)?|[-+]?\.([0-9]+|inf|Inf|INF)|\.(nan|NaN|NAN)"
)
_PLAIN_TEXT = re.compile(r"[A-Za-z]([A-Za-z0-9 ._/-]*[A-Za-z0-9._/-])?")
_WORDS = frozenset({"null", "true", "false", "yes", "no", "on", "off", "y", "n"})
_TRUE = frozenset({"yes", "true", "on"})
# The C parser is 40 times as fast. Where PyYAML was built without it, the other parser gives the same result.
_Loader: type = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Resolver(yaml.resolver.Resolver):
    """Resolves the type of a value without quotes; ``1e3`` is a number, as in YAML 1.2."""


_Resolver.add_implicit_resolver(
    f"{_TAG}float", re.compile(r"[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+"), list("-+0123456789")
)


def _span(event: yaml.Event) -> tuple[int, int, int]:
    """Return the line on which an event begins, from 1, and its start and end in the text."""
    begins, ends = event.start_mark, event.end_mark
    return (1, 0, 0) if begins is None or ends is None else (begins.line + 1, begins.index, ends.index)


def _float(written: str) -> float:
    """Parse a number as YAML writes it, such as ``.inf`` and ``.5``."""
    name = written.lower()
    return float(name.replace(".", "")) if name.endswith(("inf", "nan")) else float(name)


def dotted(path: KeyPath) -> str:
    """Write a key's path as in messages: ``goals.0.east_m``."""
    return ".".join(str(part) for part in path)


def written_text(text: str) -> str:
    """Return text as it is written in a mission file, in quotes where it would be read as something else."""
    is_plain = _PLAIN_TEXT.fullmatch(text) is not None and text.lower() not in _WORDS
    return text if is_plain else json.dumps(text, ensure_ascii=False)


@dataclass(frozen=True, slots=True)
class Document:
    """A parsed mission file.

    Parameters
    ----------
    file : str
        Name of the file, for error messages.
    text : str
        Text of the file.
    data : dict
        Keys and values; lists are tuples.
    places : dict
        Line of each key or list entry, from 1, and start and end of its value in the text.
    written : dict
        Words for values that were computed from others, such as metres from degrees.
    """

    file: str
    text: str
    data: object
    places: dict[KeyPath, tuple[int, int, int]]
    written: dict[KeyPath, str] = field(default_factory=dict)

    def line_of(self, path: KeyPath) -> int | None:
        """Return the line of a key, None if it is missing."""
        return self.places[path][0] if path in self.places else None

    def error(self, path: KeyPath, expected: str, value: str | None = None) -> ConfigError:
        """Build the error for a key; a missing key gets the line of its nearest parent."""
        found = self._excerpt(path) if value is None else value
        place = path
        while place and place not in self.places:
            place = place[:-1]
        return ConfigError(
            file=self.file,
            line=self.line_of(place),
            key=dotted(path) or "file",
            value=found,
            expected=expected,
        )

    def _excerpt(self, path: KeyPath) -> str:
        """Return the text of a key's value, shortened."""
        if path in self.written:
            return self.written[path]
        if path not in self.places:
            return "nothing"
        _, start, end = self.places[path]
        written = " ".join(self.text[start : min(end, start + 20 * _EXCERPT_MAX)].split())
        if not written:
            return "nothing"
        return written if len(written) <= _EXCERPT_MAX else written[: _EXCERPT_MAX - 1] + "…"


def parse(text: str, file: str) -> Document:
    """Parse YAML text.

    Raises
    ------
    ConfigError
        For anything but one plain YAML mapping.
    """
    if len(text) > SIZE_MAX:
        raise ConfigError(file, None, "file", f"{len(text)} characters", f"at most {SIZE_MAX}")
    try:
        return _Composer(text, file).document()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = None if mark is None else mark.line + 1
        raise ConfigError(file, line, "syntax", error.problem or "broken YAML", "valid YAML") from None
    except (yaml.YAMLError, UnicodeEncodeError) as error:
        raise ConfigError(file, None, "syntax", str(error).splitlines()[0], "valid YAML") from None


@dataclass(slots=True)
class _Open:
    """A list or mapping that is being read; ``key`` is the mapping's key whose value comes next."""

    path: KeyPath
    line: int
    start: int
    items: list[object] | None
    entries: dict[str, object] = field(default_factory=dict)
    key: str | None = None

    def expect(self, key: str) -> None:
        """Set the key of the next value."""
        self.key = key

    def add(self, value: object) -> None:
        """Add a value."""
        if self.items is not None:
            self.items.append(value)
        else:
            self.entries[self.key or ""] = value
            self.key = None


class _Composer:
    """Builds a document from the parser's events, without look-ahead or recursion."""

    def __init__(self, text: str, file: str) -> None:
        self._document = Document(file, text, None, {(): (1, 0, 0)})
        self._resolver = _Resolver()
        self._open: list[_Open] = []
        self._root: object = None
        self._num_documents = 0

    def document(self) -> Document:
        """Parse the text to its end."""
        file = self._document.file
        for event in yaml.parse(self._document.text, Loader=_Loader):
            self._take(event)
        if self._root is None:
            raise ConfigError(file, None, "file", "nothing", "the keys of a mission; see mission_configs")
        if not isinstance(self._root, dict):
            found = "a list" if isinstance(self._root, tuple) else "a bare value"
            raise ConfigError(file, 1, "file", found, "keys and values, such as 'name: my-flight'")
        return Document(file, self._document.text, self._root, self._document.places)

    def _take(self, event: yaml.Event) -> None:
        line, _, _ = _span(event)
        if isinstance(event, yaml.AliasEvent):
            raise self._broken(line, f"the alias *{event.anchor}", "the value written out")
        if isinstance(event, yaml.DocumentStartEvent):
            self._num_documents += 1
            if self._num_documents > 1:
                raise self._broken(line, "another document", "one")
        elif isinstance(event, yaml.ScalarEvent):
            self._take_scalar(event)
        elif isinstance(event, yaml.CollectionStartEvent):
            self._begin(event)
        elif isinstance(event, yaml.CollectionEndEvent):
            self._end(event)

    def _begin(self, event: yaml.CollectionStartEvent) -> None:
        line, start, _ = _span(event)
        if len(self._open) >= _DEPTH_MAX:
            raise self._broken(line, "deep nesting", f"at most {_DEPTH_MAX} levels")
        if self._wants_key:
            kind = "a list" if isinstance(event, yaml.SequenceStartEvent) else "a mapping"
            raise self._wrong_key(line, kind)
        path = self._next_path()
        self._place(path, line, start, start)
        self._check_tag(path, event.tag)
        self._open.append(
            _Open(path, line, start, [] if isinstance(event, yaml.SequenceStartEvent) else None)
        )

    def _end(self, event: yaml.CollectionEndEvent) -> None:
        ended = self._open.pop()
        line = self._document.places[ended.path][0]
        self._place(ended.path, line, ended.start, _span(event)[2])
        self._add(ended.entries if ended.items is None else tuple(ended.items))

    def _take_scalar(self, event: yaml.ScalarEvent) -> None:
        line, start, end = _span(event)
        if self._wants_key:
            self._take_key(event, line, end)
            return
        path = self._next_path()
        self._place(path, line, start, end)
        self._check_tag(path, event.tag)
        self._add(self._value(path, event))

    @property
    def _wants_key(self) -> bool:
        return bool(self._open) and self._open[-1].items is None and self._open[-1].key is None

    def _take_key(self, event: yaml.ScalarEvent, line: int, end: int) -> None:
        mapping, name = self._open[-1], event.value
        if event.tag is not None or self._kind(event) != "str":
            raise self._wrong_key(line, repr(name))
        path = (*mapping.path, name)
        if path in self._document.places:
            found = f"a second entry (the first is in line {self._document.places[path][0]})"
            raise ConfigError(self._document.file, line, dotted(path), found, "each key once")
        mapping.expect(name)
        self._document.places[path] = line, end, end

    def _next_path(self) -> KeyPath:
        """Return the path of the value that comes now."""
        if not self._open:
            return ()
        parent = self._open[-1]
        return (*parent.path, len(parent.items) if parent.items is not None else parent.key or "")

    def _place(self, path: KeyPath, line: int, start: int, end: int) -> None:
        """Record the position of a value; its line is that of its key if it has one."""
        line = self._document.places[path][0] if path in self._document.places else line
        self._document.places[path] = line, start, end

    def _add(self, value: object) -> None:
        if self._open:
            self._open[-1].add(value)
        else:
            self._root = value

    def _kind(self, event: yaml.ScalarEvent) -> str:
        """Return the type of a scalar; a quoted one is text."""
        if not event.implicit[0]:
            return "str"
        tag: str = self._resolver.resolve(yaml.ScalarNode, event.value, (True, False))  # type: ignore[no-untyped-call]
        return tag.removeprefix(_TAG)

    def _value(self, path: KeyPath, event: yaml.ScalarEvent) -> object:
        written = event.value
        match self._kind(event):
            case "str":
                return written
            case "null":
                return None
            case "bool":
                return written.lower() in _TRUE
            case "int" | "float" as kind:
                if not _PLAIN_NUMBER.fullmatch(written) or len(written) > _DIGITS_MAX:
                    raise self._document.error(path, "a plain decimal number, such as 12.5")
                return int(written) if kind == "int" else _float(written)
            case _:
                raise self._document.error(path, "a number, true or false, or text, in quotes")

    def _check_tag(self, path: KeyPath, tag: str | None) -> None:
        if tag is not None:
            raise self._document.error(path, "the value without a tag", f"the tag {tag[:_EXCERPT_MAX]}")

    def _wrong_key(self, line: int, found: str) -> ConfigError:
        place = dotted(self._open[-1].path) or "file"
        return ConfigError(self._document.file, line, place, f"the key {found:.60}", "a name as the key")

    def _broken(self, line: int | None, found: str, expected: str) -> ConfigError:
        return ConfigError(self._document.file, line, "syntax", found, expected)
