"""Encounter models of MIT Lincoln Laboratory: the reader of their text files, and tracks drawn from them.

A model is a Bayesian network of what an aircraft does: its height and speed, and how speed, height and course
change. The rates of change depend a second later on their present values; height and speed are drawn once.
Values are counted in bins. A value in a bin is uniform there; in the bin about zero it is zero. It is drawn
anew when the bin changes, and otherwise with the file's rate a second.

References
----------
.. [1] Kochenderfer, Espindle, Kuchar, Griffith, "Uncorrelated Encounter Model of the National Airspace
   System", MIT Lincoln Laboratory ATC-345, 2008. The files, and how they are laid out, are in the public
   repository Airspace-Encounter-Models/em-model-manned-bayes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from companion.errors import ConfigError
from companion.frames import FloatArray
from companion.research.encounters.well_clear import FOOT_M

KNOT_M_S = 1852.0 / 3600.0
SECTIONS = (
    "labels_initial", "G_initial", "r_initial", "N_initial",
    "labels_transition", "G_transition", "r_transition", "N_transition", "boundaries", "resample_rates",
)  # fmt: skip
HEIGHT, SPEED = "L", "v"
RATES = (r"\dot v", r"\dot h", r"\dot \psi")  # In knots a second, feet a minute, degrees a second.

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Variable:
    """One variable of a network, and how often each of its bins was counted.

    Parameters
    ----------
    label : str
        Name of the variable.
    parents : tuple of int
        Numbers of the variables that it depends on.
    strides : tuple of int
        By how many rows of ``counts`` the next bin of each parent is away.
    counts : ndarray, shape (Q, R)
        For each combination of the parents' bins how often each bin was counted.
    """

    label: str
    parents: tuple[int, ...]
    strides: tuple[int, ...]
    counts: FloatArray

    def row(self, bins: Sequence[int]) -> FloatArray:
        """Return the counts (R,) that belong to the present ``bins`` of all variables."""
        place = sum(bins[parent] * stride for parent, stride in zip(self.parents, self.strides, strict=True))
        found: FloatArray = self.counts[place]
        return found


@dataclass(frozen=True, slots=True)
class EncounterModel:
    """A model that was read.

    Parameters
    ----------
    name : str
        Name of the file.
    initial : tuple of Variable
        The variables at the beginning, in the file's order.
    order : tuple of int
        Their numbers, each after its parents.
    following : tuple of Variable
        The variables that change, a second later.
    turns : tuple of int
        Their places in ``following``, each after its parents.
    changing : tuple of int
        The number that each of these has in ``initial``.
    edges : tuple of ndarray, shape (K,)
        The bins' edges of each initial variable, in the file's units; none where the bin is a name.
    rates_a_s : ndarray, shape (N,)
        Probability that a value is drawn anew, in a second.
    """

    name: str
    initial: tuple[Variable, ...]
    order: tuple[int, ...]
    following: tuple[Variable, ...]
    turns: tuple[int, ...]
    changing: tuple[int, ...]
    edges: tuple[FloatArray, ...]
    rates_a_s: FloatArray

    def number_of(self, label: str) -> int:
        """Return the number of an initial variable."""
        return next(number for number, entry in enumerate(self.initial) if entry.label == label)

    def drawn_bins(self, generator: np.random.Generator) -> list[int]:
        """Draw the bins of all variables at the beginning."""
        bins = [0] * len(self.initial)
        for number in self.order:
            counts = self.initial[number].row(bins)
            if not counts.any():
                label = self.initial[number].label
                raise ConfigError(
                    self.name, None, "N_initial", f"no count of {label} at {bins}", "some count"
                )
            bins[number] = _drawn(counts, generator)
        return bins

    def next_bins(self, bins: Sequence[int], generator: np.random.Generator) -> list[int]:
        """Draw the bins of all variables a second after ``bins``.

        A variable keeps its bin where the model never counted the present combination of bins.
        """
        later = [*bins, *(bins[number] for number in self.changing)]
        for place in self.turns:
            number, counts = self.changing[place], self.following[place].row(later)
            later[len(bins) + place] = _drawn(counts, generator) if counts.any() else bins[number]
        found = list(bins)
        for place, number in enumerate(self.changing):
            found[number] = later[len(bins) + place]
        return found

    def drawn_value(self, number: int, at: int, generator: np.random.Generator) -> float:
        """Draw a value in bin ``at`` of a variable, in the file's units."""
        low, high = (float(edge) for edge in self.edges[number][at : at + 2])
        return 0.0 if low < 0.0 < high else float(generator.uniform(low, high))

    def track(
        self, duration_s: int, generator: np.random.Generator, near_m: float | None = None
    ) -> FloatArray | None:
        """Draw what one aircraft does: from the origin, at first to the north.

        Parameters
        ----------
        duration_s : int
            How long [s].
        generator : numpy.random.Generator
            Source of everything random.
        near_m : float, optional
            Height in whose layer of the model it is to begin [m].

        Returns
        -------
        ndarray, shape (N, 7)
            Each second: time [s], east, north, height over ground [m], and the velocity in these [m/s].
            None if it begins in another layer, leaves the model's speeds, or reaches the ground: such a draw
            is not used.
        """
        bins = self.drawn_bins(generator)
        height, speed = self.number_of(HEIGHT), self.number_of(SPEED)
        if near_m is not None and np.digitize(near_m / FOOT_M, self.edges[height]) != bins[height] + 1:
            return None
        up_m = FOOT_M * self.drawn_value(height, bins[height], generator)
        speed_m_s = KNOT_M_S * self.drawn_value(speed, bins[speed], generator)
        rates = self._rates(bins, duration_s + 1, generator)
        speeds = speed_m_s + np.concatenate([[0.0], np.cumsum(rates[:-1, 0])])
        low, high = KNOT_M_S * self.edges[speed][[0, -1]]
        courses = np.concatenate([[0.0], np.cumsum(rates[:-1, 2])])
        velocity = np.column_stack([speeds * np.sin(courses), speeds * np.cos(courses), rates[:, 1]])
        places = np.vstack([[0.0, 0.0, up_m], velocity[:-1]]).cumsum(axis=0)
        if speeds.min() <= low or speeds.max() >= high or places[:, 2].min() <= 0.0:
            return None
        return np.column_stack([np.arange(duration_s + 1.0), places, velocity])

    def _rates(self, bins: list[int], rows: int, generator: np.random.Generator) -> FloatArray:
        """Draw acceleration [m/s²], climb [m/s] and turn rate [rad/s] of each second, (N, 3)."""
        numbers = [self.number_of(label) for label in RATES]
        values = [self.drawn_value(number, bins[number], generator) for number in numbers]
        found = np.empty((rows, 3))
        for row in range(rows):
            found[row] = values
            later = self.next_bins(bins, generator)
            anew = generator.random(3) < self.rates_a_s[numbers]
            for place, number in enumerate(numbers):
                if anew[place] or later[number] != bins[number]:
                    values[place] = self.drawn_value(number, later[number], generator)
            bins = later
        scaled: FloatArray = found * (KNOT_M_S, FOOT_M / 60.0, math.pi / 180.0)
        return scaled


def model_text(path: Path) -> str:
    """Return the text of a model's file.

    Raises
    ------
    ConfigError
        If it cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(str(path), None, "file", str(error), "an encounter model's text") from None


def model_from_text(text: str, name: str) -> EncounterModel:
    """Read a model from the text of its file, which is called ``name`` in errors.

    Raises
    ------
    ConfigError
        For the first thing wrong with it: the file, the section, and what was expected.
    """
    file = _File(name, _sections(text, name))
    labels = file.labels("labels_initial")
    for label in (HEIGHT, SPEED, *RATES):
        if label not in labels:
            raise file.error("labels_initial", ", ".join(labels), f'a variable "{label}"')
    later = file.labels("labels_transition")
    if [label.removesuffix("(t)") for label in later[: len(labels)]] != labels:
        raise file.error("labels_transition", ", ".join(later), "first those of labels_initial, or with (t)")
    changing = []
    for label in later[len(labels) :]:
        if label.removesuffix("(t+1)") not in RATES or label.removesuffix("(t+1)") == label:
            raise file.error("labels_transition", label, "one of " + ", ".join(f"{of}(t+1)" for of in RATES))
        changing.append(labels.index(label.removesuffix("(t+1)")))
    initial = file.variables("initial", labels, 0)
    following = file.variables("transition", later, len(labels))
    return EncounterModel(
        name, initial, file.order("G_initial", initial), following,
        file.order("G_transition", following, len(labels)), tuple(changing), file.edges(initial),
        file.numbers("resample_rates", len(labels)),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _File:
    """A model's file: the lines of each section."""

    name: str
    lines: Mapping[str, list[str]]

    def error(self, section: str, value: str, expected: str) -> ConfigError:
        return ConfigError(self.name, None, section, value, expected)

    def labels(self, section: str) -> list[str]:
        return [label.strip().strip('"') for label in self.lines[section][0].split(",")]

    def numbers(self, section: str, count: int, line: int = 0) -> FloatArray:
        """Return ``count`` numbers (N,) of a section's line, none of them negative but in boundaries."""
        lines = self.lines[section]
        words = lines[line].split() if line < len(lines) else []
        try:
            found = np.array([float(word) for word in words])
        except ValueError:
            raise self.error(section, lines[line][:40], "numbers") from None
        if len(found) != count:
            raise self.error(section, f"{len(found)} numbers in line {line + 1}", f"{count}")
        if not np.isfinite(found).all() or (section != "boundaries" and (found < 0.0).any()):
            raise self.error(section, "a negative or infinite number", "finite ones from 0 on")
        return found

    def variables(self, kind: str, labels: Sequence[str], first: int) -> tuple[Variable, ...]:
        """Return the variables from number ``first`` on, with their tables."""
        size = len(labels)
        graph = np.array([self.numbers(f"G_{kind}", size, line) for line in range(size)]) > 0.0
        bins = self.numbers(f"r_{kind}", size).astype(int)
        parents = [tuple(int(n) for n in np.flatnonzero(graph[:, number])) for number in range(size)]
        rows = [math.prod(int(bins[n]) for n in parents[number]) for number in range(size)]
        total = sum(rows[number] * int(bins[number]) for number in range(first, size))
        counts, begin, found = self.numbers(f"N_{kind}", total), 0, []
        for number in range(first, size):
            end = begin + rows[number] * int(bins[number])
            sizes = [int(bins[n]) for n in parents[number]]
            strides = tuple(math.prod(sizes[:place]) for place in range(len(sizes)))
            table = counts[begin:end].reshape(rows[number], -1)
            found.append(Variable(labels[number], parents[number], strides, table))
            begin = end
        return tuple(found)

    def order(self, section: str, variables: Sequence[Variable], known: int = 0) -> tuple[int, ...]:
        """Places of the variables, each after its parents; those of the first ``known`` numbers are there."""
        parents = {
            known + place: [number for number in entry.parents if number >= known]
            for place, entry in enumerate(variables)
        }
        try:
            return tuple(number - known for number in TopologicalSorter(parents).static_order())
        except CycleError:
            raise self.error(section, "a circle", "a graph without one") from None

    def edges(self, variables: Sequence[Variable]) -> tuple[FloatArray, ...]:
        """Return the edges (K,) of each variable's bins; none where a line is a star."""
        found, lines = [], self.lines["boundaries"]
        for line, entry in enumerate(variables):
            is_name = line < len(lines) and lines[line].strip() == "*"
            if is_name and entry.label not in (HEIGHT, SPEED, *RATES):
                found.append(np.empty(0))
                continue
            edges = self.numbers("boundaries", entry.counts.shape[1] + 1, line)
            if (np.diff(edges) <= 0.0).any():
                raise self.error("boundaries", lines[line].strip(), "rising numbers")
            found.append(edges)
        return tuple(found)


def _sections(text: str, name: str) -> dict[str, list[str]]:
    """Return the lines of each section by its name."""
    found: dict[str, list[str]] = {}
    current: list[str] = []
    for line in text.splitlines():
        if line.startswith("#"):
            current = found.setdefault(line[1:].strip(), [])
        elif line.strip():
            current.append(line)
    for section in SECTIONS:
        if not found.get(section):
            words = "nothing" if section in found else "no such section"
            raise ConfigError(
                name, None, section, words, "lines of numbers or labels after '# " + section + "'"
            )
    return found


def _drawn(counts: FloatArray, generator: np.random.Generator) -> int:
    """Draw a bin by ``counts`` (R,), some of which is above zero."""
    sums = np.cumsum(counts)
    return int(np.searchsorted(sums, generator.random() * sums[-1], side="right"))
