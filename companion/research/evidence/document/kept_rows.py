"""Rows of campaigns as one small file each, fit for a repository: measures without paths, in CSV.

The first line, behind ``# ``, describes the campaign, as JSON. Numbers have six digits. Only measures that
tables show are kept.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from companion.errors import ConfigError
from companion.research.campaign.campaign_spec import Scalar
from companion.research.campaign.engines.runners import json_text
from companion.research.campaign.run_store import Row, RunStore
from companion.research.evidence.evidence_tables import RATES
from companion.research.evidence.samples import GROUPS, Evidence, evidence_from, stored

ENDING = ".csv"
_MARK = "# "
_NAMED = ("number", "mission", "setting", "method", "seed", "error", "commit", "machine")
_LENGTH_MAX = 50_000_000


def stored_measures(kind: str) -> tuple[str, ...]:
    """Return the kept measures of a kind of run."""
    rates = [name for name, _ in RATES[kind]]
    return tuple(dict.fromkeys([*rates, *(of.name for group in GROUPS[kind] for of in group.measures)]))


def stored_text(store: RunStore) -> str:
    """Return a campaign's rows as the text of such a file.

    Raises
    ------
    ConfigError
        If there is no row yet.
    """
    rows, header, dimensions = stored(store)
    names = stored_measures(str(header["kind"]))
    commits, machines = (
        list(dict.fromkeys(getattr(row, key) for row in rows)) for key in ("commit", "machine")
    )
    head = {"identity": header, "dimensions": dimensions, "commits": commits, "machines": machines}
    buffer = io.StringIO()
    buffer.write(f"{_MARK}{json_text(head)}\n")
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([*_NAMED, *names])
    for row in rows:
        places = commits.index(row.commit), machines.index(row.machine)
        named = row.number, row.mission, row.setting, row.method, row.seed, row.error or "", *places
        writer.writerow([*named, *(_written(row.measures.get(name)) for name in names)])
    return buffer.getvalue()


def stored_evidence(file: Path) -> Evidence:
    """Read such a file.

    Raises
    ------
    ConfigError
        If it cannot be read, or is no such file.
    """
    try:
        text = file.read_text(encoding="utf-8")
        head, _, body = text[:_LENGTH_MAX].partition("\n")
        header = json.loads(head.removeprefix(_MARK))
        rows = list(_rows(csv.DictReader(io.StringIO(body)), header))
        return evidence_from(rows, header["identity"], header["dimensions"])
    except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
        found = f"{type(error).__name__}: {error}"
        raise ConfigError(str(file), None, "rows", found, "what companion results --keep writes") from None


def _rows(lines: Iterable[Mapping[str, str]], header: Mapping[str, list[str]]) -> Iterator[Row]:
    for line in lines:
        entries = ((name, value) for name, value in line.items() if name not in _NAMED and value)
        measures: dict[str, Scalar | None] = {name: _read(value) for name, value in entries}
        yield Row(
            number=int(line["number"]),
            mission=line["mission"],
            setting=line["setting"],
            method=line["method"],
            seed=int(line["seed"]),
            error=line["error"] or None,
            measures=measures,
            commit=header["commits"][int(line["commit"])],
            machine=header["machines"][int(line["machine"])],
        )


def _written(value: Scalar | None) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _read(text: str) -> Scalar:
    return text == "true" if text in ("true", "false") else float(text)
