"""What a planning cycle decides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Judgement:
    """What a cycle decided, in words why, and the numbers that led to it."""

    swap: bool
    kind: str
    text: str
    why: Mapping[str, object] = field(default_factory=dict)
