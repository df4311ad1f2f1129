"""The provenance of rows, in a sentence."""

from __future__ import annotations

from companion.research.evidence.samples import Evidence

_HASH = 40  # Number of characters of a commit's name.
_SHORT = 12


def provenance_of(evidence: Evidence) -> str:
    """Return the number of rows, and the program and computer that made them."""
    runs = f"{evidence.num_rows:,} of {evidence.num_wanted:,} runs of `campaigns/{evidence.name}.yaml`"
    commits = ", ".join(f"`{commit[:_SHORT]}{commit[_HASH:]}`" for commit in evidence.commits)
    return f"{runs}, made by commit {commits} on {'; '.join(evidence.machines)}."
