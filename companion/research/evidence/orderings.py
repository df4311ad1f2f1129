"""The paper's Tables 1 to 5 as printed, and the orderings that follow from them.

Source: "Online UAV path planning in uncertain and hostile environments", section 5.3. Its machine was a
Pentium 4 with Matlab, and its maps are not published: orderings can be compared, absolute values cannot.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

OURS = "safe-rrt"
# Methods that may also stand for the paper's: without the game of 2.3, and without our samplers, too.
OURS_PRINTED = ("safe-rrt-rs", "safe-rrt-printed")


@dataclass(frozen=True, slots=True)
class PaperTable:
    """One table: the names of its measures, and the printed values by dimension and method.

    Parameters
    ----------
    number : int
        Number of the table.
    subject : str
        Subject of the comparison.
    measures : tuple of str
        Columns.
    printed : dict
        The columns' values, by dimension and by our name of the method.
    """

    number: int
    subject: str
    measures: tuple[str, ...]
    printed: dict[int, dict[str, tuple[float, ...]]]


class Ordering(NamedTuple):
    """A pair of methods whose printed values differ: ``less`` has the smaller one."""

    table: int
    dimension: int
    measure: str
    less: str
    more: str
    printed_less: float
    printed_more: float


TABLES = (
    PaperTable(
        1,
        "Safe-RRT and traditional methods",
        ("PST", "NCDC", "ESR", "TSI", "Q", "PC", "FR"),
        {
            2: {
                OURS: (7.92, 1156, 0.5087, 0.0069, 0.2474, 135.43, 0.033),
                "taddrrt": (9.51, 1606, 0.5367, 0.0059, 0.1049, 149.94, 0.045),
                "nfz-ddrrt": (11.54, 1913, 0.4135, 0.0060, 0.0677, 179.91, 0.064),
                "rrt-star": (14.11, 2662, 0.4189, 0.0053, 0.0661, 215.33, 0.055),
            },
            3: {
                OURS: (13.57, 1213, 0.5441, 0.0112, 0.3571, 1565.21, 0.013),
                "taddrrt": (13.39, 1313, 0.5453, 0.0102, 0.2255, 1635.05, 0.011),
                "nfz-ddrrt": (16.38, 1906, 0.4654, 0.0086, 0.1633, 1883.22, 0.087),
                "rrt-star": (23.28, 4477, 0.3761, 0.0052, 0.1422, 1962.63, 0.081),
            },
        },
    ),
    PaperTable(
        2,
        "Selection of sub goals",
        ("PST", "NTN", "NCDC", "ESR", "TTA", "PC", "FR"),
        {
            2: {
                OURS: (7.92, 588, 1156, 0.5087, 33.23, 135.43, 0.033),
                "edbm": (11.07, 710, 1628, 0.4361, 39.17, 167.73, 0.082),
            },
            3: {
                OURS: (13.57, 660, 1213, 0.5441, 60.59, 1565.21, 0.013),
                "edbm": (19.49, 784, 1746, 0.4490, 75.26, 1728.38, 0.053),
            },
        },
    ),
    PaperTable(
        3,
        "Avoidance of static threats",
        ("ATP", "TTA", "NHTW"),
        {
            2: {
                OURS: (0.1211, 33.23, 4),
                "taddrrt": (0.1976, 35.79, 6),
                "rrt-star": (0.2536, 47.54, 13),
            },
            3: {
                OURS: (0.0821, 60.59, 15),
                "taddrrt": (0.1313, 85.59, 22),
                "rrt-star": (0.1675, 121.51, 49),
            },
        },
    ),
    PaperTable(
        4,
        "Estimators of the reachable set",
        ("ADTP", "TDTA", "ETDTA", "ETDTA/TDTA", "TFP/PD", "RRS"),
        {
            2: {
                OURS: (0.0855, 22.97, 19.31, 0.8407, 0.1883, 46),
                "rrt-reach": (0.1245, 24.39, 14.05, 0.5761, 0.2672, 34),
                "rrt": (0.1746, 34.55, 11.42, 0.3305, 0.3558, 19),
            },
            3: {
                OURS: (0.0622, 43.26, 36.39, 0.8412, 0.1859, 72),
                "rrt-reach": (0.1076, 50.66, 39.48, 0.7793, 0.2287, 65),
                "rrt": (0.1468, 60.19, 31.50, 0.5233, 0.3206, 57),
            },
        },
    ),
    PaperTable(
        5,
        "Models of static threats",
        ("PST", "NCDC", "PC", "FR", "PSR", "Q"),
        {
            2: {
                OURS: (7.92, 1156, 135.43, 0.033, 0.8187, 0.2474),
                "probabilistic": (8.64, 1262, 151.34, 0.035, 0.7782, 0.1116),
            },
            3: {
                OURS: (13.57, 1213, 1565.21, 0.013, 0.8726, 0.3571),
                "probabilistic": (17.23, 1469, 1672.16, 0.013, 0.8135, 0.2654),
            },
        },
    ),
)


def orderings() -> Iterator[Ordering]:
    """Every pair of different values in a column of a table."""
    for table in TABLES:
        for dimension, rows in table.printed.items():
            for one, other in itertools.combinations(rows, 2):
                for measure, a, b in zip(table.measures, rows[one], rows[other], strict=True):
                    if a != b:
                        less, more = (one, other) if a < b else (other, one)
                        yield Ordering(table.number, dimension, measure, less, more, min(a, b), max(a, b))
