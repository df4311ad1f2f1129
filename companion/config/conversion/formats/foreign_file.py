"""Bytes, JSON and XML of files by others, within limits of size and depth and without what XML refers to."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import NoReturn, TypeVar
from xml.etree import ElementTree as ET
from xml.parsers import expat

from companion.config.conversion.found_places import Importer
from companion.errors import ConfigError
from companion.safe_files import read_file

Reader = TypeVar("Reader")

BYTES_MAX = 20_000_000
_DEPTH_MAX = 100
_ELEMENTS_MAX = 1_000_000


def reader_of(path: Path, readers: Mapping[str, Reader]) -> Reader:
    """Return the reader of a file, by the ending of its name.

    Raises
    ------
    ConfigError
        If there is none for it.
    """
    reader = readers.get(path.suffix.lower())
    if reader is None:
        expected = f"a name that ends in {', '.join(readers)}"
        raise ConfigError(str(path), None, "file name", path.suffix or "no ending", expected)
    return reader


def foreign_bytes(path: Path) -> bytes:
    """Return the content of a file.

    Raises
    ------
    ConfigError
        If it cannot be read, is empty, or is too large.
    """
    try:
        data = read_file(path, BYTES_MAX, follow=True)
    except (OSError, ValueError) as error:  # A NUL character in the path raises ValueError.
        reason = getattr(error, "strerror", None) or str(error)
        raise ConfigError(str(path), None, "file", reason.lower(), "a file that can be read") from None
    if not data.strip():
        raise ConfigError(str(path), None, "file", "nothing", "a file with content")
    return data


def foreign_text(importer: Importer, data: bytes) -> str:
    """Return the text of a file in UTF-8, from its first line that is not empty.

    Raises
    ------
    ConfigError
        If it is in another encoding, or has no text.
    """
    try:
        text = data.decode("utf-8-sig").lstrip()
    except UnicodeDecodeError:
        raise importer.error("file", "bytes that are not UTF-8", "a text file in UTF-8") from None
    if not text:
        raise importer.error("file", "nothing", "a file with content")
    return text


def json_document(importer: Importer, data: bytes) -> dict[str, object]:
    """Return a JSON object.

    Raises
    ------
    ConfigError
        If the file is broken, has NaN in it, or is no object.
    """

    def refuse(constant: str) -> NoReturn:
        raise importer.error("file", constant, "finite numbers, as JSON has them")

    try:
        document = json.loads(foreign_text(importer, data), parse_constant=refuse)
    except json.JSONDecodeError as error:
        raise importer.error("syntax", error.msg, "whole and valid JSON", error.lineno) from None
    except RecursionError:
        raise importer.error("syntax", "deep nesting", "few levels of brackets") from None
    except ValueError:  # A number has more digits than Python converts.
        raise importer.error("syntax", "a number of thousands of digits", "valid JSON") from None
    if not isinstance(document, dict):
        raise importer.error("file", type(document).__name__, "a JSON object, in braces")
    return document


def xml_root(importer: Importer, data: bytes) -> ET.Element:
    """Return the root of an XML document; tags have no namespace.

    A document type is refused, since only that can declare entities: one that multiplies itself would fill
    the memory, one that names a file would read it.

    Raises
    ------
    ConfigError
        If the file is broken, or has a document type, or too many or too deep elements.
    """
    builder = ET.TreeBuilder()
    parser = expat.ParserCreate(namespace_separator=" ")
    depth = count = 0

    def refuse(*_: object) -> NoReturn:
        line = parser.CurrentLineNumber
        raise importer.error(
            "file", "a document type (DOCTYPE)", "XML without one: no entities are read", line
        )

    def begin(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > _DEPTH_MAX or count > _ELEMENTS_MAX:
            expected = f"at most {_DEPTH_MAX} levels and {_ELEMENTS_MAX} elements"
            raise importer.error("file", "more elements", expected, parser.CurrentLineNumber)
        builder.start(_local(tag), {_local(name): value for name, value in attributes.items()})

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(_local(tag))

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = begin
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        words = expat.ErrorString(error.code)
        raise importer.error("syntax", words, "whole and valid XML", error.lineno) from None
    return builder.close()


def _local(tag: str) -> str:
    """Return a name without its namespace."""
    return tag.rpartition(" ")[2]
