"""The paper's own measurements (its Table 1), for comparison with ours.

Its machine was a Pentium 4 with Matlab and its maps are not published: ratios and orderings can be compared,
absolute values cannot. Its lengths are planning units, so that PC can be compared; its NTN is ESR · NCDC.
"""

from __future__ import annotations

from typing import NamedTuple


class PaperRow(NamedTuple):
    """One row of Table 1: PST [s], NCDC, ESR, TSI [s], Q(Π), PC and the failure rate."""

    path_search_time_s: float
    num_collision_checks: int
    extension_success_rate: float
    search_iteration_time_s: float
    quality: float
    path_cost: float
    failure_rate: float


TABLE_1: dict[tuple[int, str], PaperRow] = {
    (2, "safe-rrt"): PaperRow(7.92, 1156, 0.5087, 0.0069, 0.2474, 135.43, 0.033),
    (2, "taddrrt"): PaperRow(9.51, 1606, 0.5367, 0.0059, 0.1049, 149.94, 0.045),
    (2, "nfz-ddrrt"): PaperRow(11.54, 1913, 0.4135, 0.0060, 0.0677, 179.91, 0.064),
    (2, "rrt-star"): PaperRow(14.11, 2662, 0.4189, 0.0053, 0.0661, 215.33, 0.055),
    (3, "safe-rrt"): PaperRow(13.57, 1213, 0.5441, 0.0112, 0.3571, 1565.21, 0.013),
    (3, "taddrrt"): PaperRow(13.39, 1313, 0.5453, 0.0102, 0.2255, 1635.05, 0.011),
    (3, "nfz-ddrrt"): PaperRow(16.38, 1906, 0.4654, 0.0086, 0.1633, 1883.22, 0.087),
    (3, "rrt-star"): PaperRow(23.28, 4477, 0.3761, 0.0052, 0.1422, 1962.63, 0.081),
}


def paper_row(mission_name: str, dimension: int, method: str) -> PaperRow | None:
    """Return the paper's row for a method on one of its scenarios, if it has one."""
    return TABLE_1.get((dimension, method)) if mission_name.startswith("paper-") else None
