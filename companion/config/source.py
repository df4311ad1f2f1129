"""YAML text with the place of every key: what error messages point at.

Stricter than YAML: no aliases (a key must mean what stands beside it), no duplicate keys (YAML
keeps the last in silence), and no octal or base-60 numbers (``010`` would be 8, ``1:30`` 90).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import yaml

from companion.errors import ConfigError

KeyPath = tuple[str | int, ...]

SIZE_MAX = 4_000_000  # characters; the largest world anyone has drawn by hand is a hundredth of it
_DEPTH_MAX = 20
_EXCERPT = 60
_STRING_TAG = "tag:yaml.org,2002:str"
_NUMBER_TAGS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_PLAIN_NUMBER = re.compile(
    r"[-+]?(0|[1-9][0-9]*)(\.[0-9]*)?([eE][-+]?[0-9]+)?|[-+]?\.([0-9]+|inf|Inf|INF)|\.(nan|NaN|NAN)"
)


class _Loader(yaml.SafeLoader):
    """The safe loader, which also reads ``1e3`` as the number it is in YAML 1.2."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+"), list("-+0123456789")
)


def dotted(path: KeyPath) -> str:
    """Write a key's path as messages do, ``goals.0.east_m``."""
    return ".".join(str(part) for part in path)


@dataclass(frozen=True, slots=True)
class Document:
    """A parsed mission file.

    Parameters
    ----------
    file : str
        Name of the file, for error messages.
    data : dict
        Keys and values; lists are tuples.
    lines : dict
        Line, counted from 1, at which each key or list entry stands.
    texts : dict
        What is written there, shortened.
    """

    file: str
    data: object
    lines: dict[KeyPath, int]
    texts: dict[KeyPath, str]

    def error(self, path: KeyPath, expected: str, value: str | None = None) -> ConfigError:
        """Build the error at a key; one that is not there is placed at its nearest parent."""
        found = self.texts.get(path, "nothing") if value is None else value
        place = path
        while place and place not in self.lines:
            place = place[:-1]
        return ConfigError(
            file=self.file,
            line=self.lines.get(place),
            key=dotted(path) or "file",
            value=found,
            expected=expected,
        )


def parse(text: str, file: str) -> Document:
    """Read YAML.

    Raises
    ------
    ConfigError
        For anything that is not one plain YAML mapping.
    """
    if len(text) > SIZE_MAX:
        raise ConfigError(file, None, "file", f"{len(text)} characters", f"at most {SIZE_MAX}")
    try:
        node = _root(text, file)
        located = _located(node, text, file)
        data = _frozen(_Loader("").construct_document(node))
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = None if mark is None else mark.line + 1
        raise ConfigError(file, line, "syntax", error.problem or "broken YAML", "valid YAML") from None
    except yaml.YAMLError as error:
        raise ConfigError(file, None, "syntax", str(error).splitlines()[0], "valid YAML") from None
    return Document(file, data, located.lines, located.texts)


def _root(text: str, file: str) -> yaml.MappingNode:
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEPTH_MAX:  # composing recurses
            raise ConfigError(file, None, "syntax", "deep nesting", f"at most {_DEPTH_MAX} levels")
        if isinstance(event, yaml.AliasEvent):
            line = None if event.start_mark is None else event.start_mark.line + 1
            raise ConfigError(file, line, "syntax", f"the alias *{event.anchor}", "the value written out")
    node = yaml.compose(text, Loader=_Loader)
    if node is None:
        raise ConfigError(file, None, "file", "nothing", "the keys of a mission; see mission_configs")
    if not isinstance(node, yaml.MappingNode):
        raise ConfigError(
            file,
            1,
            "file",
            "a list" if isinstance(node, yaml.SequenceNode) else "a bare value",
            "keys and values, such as 'name: my-flight'",
        )
    return node


def _located(root: yaml.MappingNode, text: str, file: str) -> Document:
    document = Document(file, {}, {(): 1}, {})
    pending: list[tuple[KeyPath, yaml.Node]] = [((), root)]
    while pending:
        path, node = pending.pop()
        if isinstance(node, yaml.ScalarNode):
            _check_scalar(document, path, node)
            continue
        for part, place, value in _children(document, path, node):
            child = (*path, part)
            document.lines[child] = place.start_mark.line + 1
            document.texts[child] = _excerpt(text, value)
            pending.append((child, value))
    return document


def _children(
    document: Document, path: KeyPath, node: yaml.Node
) -> Iterator[tuple[str | int, yaml.Node, yaml.Node]]:
    if isinstance(node, yaml.SequenceNode):
        for index, value in enumerate(node.value):
            yield index, value, value
        return
    seen: dict[str, int] = {}
    for key, value in node.value:
        line = key.start_mark.line + 1
        place = dotted(path) or "file"
        if not isinstance(key, yaml.ScalarNode) or key.tag != _STRING_TAG:
            raise ConfigError(document.file, line, place, f"the key {key.value!r:.60}", "a name as the key")
        if key.value in seen:
            raise ConfigError(
                document.file,
                line,
                dotted((*path, key.value)),
                f"a second entry (the first is in line {seen[key.value]})",
                "each key once",
            )
        seen[key.value] = line
        yield key.value, key, value


def _check_scalar(document: Document, path: KeyPath, node: yaml.ScalarNode) -> None:
    if node.tag in _NUMBER_TAGS and not _PLAIN_NUMBER.fullmatch(node.value):
        raise document.error(path, "a plain decimal number, such as 12.5")


def _excerpt(text: str, node: yaml.Node) -> str:
    written = " ".join(text[node.start_mark.index : node.end_mark.index].split())
    if not written:
        return "nothing"
    return written if len(written) <= _EXCERPT else written[: _EXCERPT - 1] + "…"


def _frozen(value: object) -> object:
    if isinstance(value, dict):
        return {key: _frozen(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return tuple(_frozen(entry) for entry in value)
    return value
