"""What is fuzzed: each target is a function of bytes with something that must hold of it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

CORPUS = Path(__file__).parent / "corpus"
HEAVY = Path(__file__).parent / "heavy"  # inputs that take seconds: measured, and neither changed nor tests


class BrokenPromiseError(AssertionError):
    """Something that must hold did not."""


def promise(holds, what):
    """See that something holds; ``assert`` would be left out where Python optimises."""
    if not holds:
        raise BrokenPromiseError(what)


@dataclass(frozen=True)
class Work:
    """What an input costs: the bytes that the code under test is given, and how to give it them.

    ``start`` makes everything anew and returns what is to be timed; ``idle`` does the same for an input
    of no bytes, whose time is no cost of a byte.
    """

    num_bytes: int
    start: Callable[[], Callable[[], object]]
    idle: Callable[[], Callable[[], object]] | None = None


@dataclass(frozen=True)
class Target:
    """One of them.

    ``check`` raises where anything escapes or a promise is broken; ``work`` is what is timed; ``modules``
    are those whose lines count as covered.
    """

    name: str
    check: Callable[[bytes], None]
    work: Callable[[bytes], Work]
    modules: tuple[str, ...]
    length_max: int = 4096
    words: tuple[bytes, ...] = ()  # that the fuzzer may put in


def all_targets():
    """Targets by name. Imported when asked, so that the fuzzer can watch what they import."""
    from tests.fuzz.file_targets import FILE_TARGETS  # noqa: PLC0415
    from tests.fuzz.import_targets import IMPORT_TARGETS  # noqa: PLC0415
    from tests.fuzz.link_targets import LINK_TARGETS  # noqa: PLC0415
    from tests.fuzz.mission_targets import MISSION_TARGETS  # noqa: PLC0415

    return {
        target.name: target for target in (*LINK_TARGETS, *MISSION_TARGETS, *IMPORT_TARGETS, *FILE_TARGETS)
    }


def corpus_of(name, folder=CORPUS):
    """Stored inputs of a target, in order."""
    return sorted(path for path in (folder / name).glob("*") if path.is_file())
