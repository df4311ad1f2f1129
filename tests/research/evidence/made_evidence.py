"""Rows that were never run."""

from companion.research.campaign.run_store import Row
from companion.research.evidence.samples import Case, Evidence, Sample


def sample(name, values, method="m", successes=None):
    """A measure's values for the seeds 1, 2, …; None is no value."""
    rows = {}
    for seed, value in enumerate(values, 1):
        success = True if successes is None else successes[seed - 1]
        rows[seed] = Row(
            seed, "paper-2d", "shifted", method, seed, None, {"success": success, name: value}, "c", "m"
        )
    return Sample(rows)


def case(dimension=2, mission="paper-2d", **samples):
    named = {name.replace("_", "-"): one for name, one in samples.items()}
    return Case(mission, "shifted", dimension, named)


def evidence(*cases, kind="plans"):
    return Evidence("made", kind, cases, 4, 4, ("c",), ("m",))
