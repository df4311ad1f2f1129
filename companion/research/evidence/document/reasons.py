"""Reasons why orderings of the paper are not reproduced, written by people in a YAML file.

Each entry names the orderings that it is about; a key that is left out means all.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from companion.config.explain import explained
from companion.config.load import mission_text
from companion.config.sections.section_base import Section
from companion.config.source import parse
from companion.research.evidence.verdicts import Judged

Words = Annotated[str, Field(min_length=1, max_length=4_000)]
Names = Annotated[tuple[str, ...], Field(min_length=1)]


class Reason(Section):
    """One reason, and the orderings that it explains."""

    why: Words
    """In words."""
    tables: tuple[Annotated[int, Field(ge=1, le=5)], ...] = (1, 2, 3, 4, 5)
    """Of the paper."""
    measures: Names | None = None
    """Columns."""
    less: Names | None = None
    """Methods whose value is printed as the smaller one."""
    more: Names | None = None
    """Methods whose value is printed as the larger one."""
    methods: Names | None = None
    """Methods of which one is in it."""
    missions: Names | None = None
    """On which maps."""
    settings: Names | None = None
    """Under which settings."""

    def is_of(self, entry: Judged) -> bool:
        """Return whether the reason explains an ordering's verdict."""
        ordering = entry.ordering
        wanted = (
            (self.measures, ordering.measure),
            (self.less, ordering.less),
            (self.more, ordering.more),
            (self.missions, entry.case.mission),
            (self.settings, entry.case.setting),
        )
        known = all(names is None or name in names for names, name in wanted)
        is_among = self.methods is None or not {ordering.less, ordering.more}.isdisjoint(self.methods)
        return known and is_among and ordering.table in self.tables


class Reasons(Section):
    """The whole file."""

    orderings: tuple[Reason, ...] = ()
    """The first that is of an ordering is its reason."""
    notes: dict[Literal["plans", "flights", "anytime"], Words] = {}  # noqa: RUF012
    """What else has to be said of campaigns of a kind."""

    def of(self, entry: Judged) -> int | None:
        """Number of an ordering's reason, from 1 on; None if there is none."""
        return next((n for n, reason in enumerate(self.orderings, 1) if reason.is_of(entry)), None)


def load_reasons(path: Path) -> Reasons:
    """Read such a file.

    Raises
    ------
    ConfigError
        For the first thing wrong with it.
    """
    document = parse(mission_text(path), str(path))
    try:
        return Reasons.model_validate(document.data)
    except ValidationError as error:
        raise explained(document, error.errors(include_url=False), Reasons) from None
