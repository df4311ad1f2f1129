"""``companion identify``: the results as a table, and as keys to paste into a mission file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from companion.config.compose import vehicle_of
from companion.plain_text import printable
from companion.research.identification.coordination_estimate import coordination_key
from companion.research.identification.energy_estimate import energy_keys
from companion.research.identification.flown_samples import Flown, flown_of
from companion.research.identification.noise_estimate import Identified, NoiseKey, Spread, identified


def identify(sources: Sequence[Path], mission_file: Path | None) -> tuple[list[Flown], Identified]:
    """Read recordings; identify noise, turns and power of the aircraft of the first one's mission.

    Raises
    ------
    RecordError
        If one of them cannot be read.
    ConfigError
        If a mission file cannot be read.
    """
    flights = [flown_of(source, mission_file) for source in sources]
    vehicle = vehicle_of(flights[0].mission)
    windows = [window for flight in flights for window in flight.windows]
    turns = [turn for flight in flights for turn in flight.turns]
    found = identified(flights, vehicle)
    keys = (*found.keys, coordination_key(turns))
    return flights, replace(found, keys=keys, energy=energy_keys(windows, vehicle))


def document_of(flights: Sequence[Flown], found: Identified) -> dict[str, object]:
    """Return the JSON of the command."""
    document: dict[str, object] = {
        "recordings": [flight.name for flight in flights],
        "tracked_s": round(found.tracked_s, 1),
        "left_out": found.num_left_out,
        "deviations": [_spread_document(spread) for spread in found.spreads],
        "vehicle": {name: _rounded(value) for name, value in found.known.items()},
        "keys": [_key_document(key) for key in found.keys],
    }
    return document | ({"energy": [_key_document(key) for key in found.energy]} if found.energy else {})


def _spread_document(spread: Spread) -> dict[str, object]:
    figures = {"mean": spread.mean, "std": spread.std, "low": spread.low, "high": spread.high}
    return {
        "name": spread.name,
        "unit": spread.unit,
        **{name: _finite(value) for name, value in figures.items()},
        "samples": spread.num,
        "independent": round(spread.num_independent, 1),
    }


def _key_document(key: NoiseKey) -> dict[str, object]:
    return {
        "key": key.name,
        "value": None if key.value is None else _rounded(key.value),
        "low": _finite(key.low),
        "high": _finite(key.high),
        "note": key.note,
    }


def _finite(value: float) -> float | None:
    return round(value, 6) if math.isfinite(value) else None


def _rounded(value: float) -> float:
    """Round to three digits, which is more than is known."""
    return float(f"{value:.3g}")


def fragment_of(found: Identified) -> str:
    """Return the keys in YAML; keys with too little data are comments."""
    lines = _section("vehicle", found.keys)
    if found.energy:
        lines += _section("energy", found.energy)
        lines.append("  # capacity_wh and reserve_wh: of your battery")
    return "\n".join(lines)


def _section(name: str, keys: Sequence[NoiseKey]) -> list[str]:
    lines = [f"{name}:"]
    for key in keys:
        if key.value is None:
            lines.append(f"  # {key.name}: {key.note}")
            continue
        interval = f"{key.low:.2g} to {key.high:.2g}"
        lines.append(f"  {key.name}: {_rounded(key.value):g}  # {interval}: {key.note}")
    return lines


def show(flights: Sequence[Flown], found: Identified, screen: Console) -> None:
    """Print the measurements and the keys."""
    words = ", ".join(printable(flight.name) for flight in flights)
    screen.print(f"{words}: {found.tracked_s:.0f} s along plans", markup=False, soft_wrap=True)
    if found.num_left_out:
        screen.print(f"{found.num_left_out} positions far from any plan are left out")
    table = Table(title="deviations from the plans flown")
    for column in ("of", "mean", "deviation", "95 % of it", "samples", "independent"):
        table.add_column(column, justify="left" if column == "of" else "right")
    for spread in found.spreads:
        if spread.num < 2:
            continue
        table.add_row(
            spread.name, f"{spread.mean:.2f} {spread.unit}", f"{spread.std:.2f} {spread.unit}",
            f"{spread.low:.2f} to {spread.high:.2f}", str(spread.num), f"{spread.num_independent:.0f}",
        )  # fmt: skip
    if table.row_count:
        screen.print(table)
    screen.print(fragment_of(found), markup=False, highlight=False, soft_wrap=True)
