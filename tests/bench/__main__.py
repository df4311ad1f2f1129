"""The benchmarks, compared: ``python -m tests.bench [--beside CHECKOUT] [--rounds N] [--save]``.

Alone, figures are compared with the stored baseline; with ``--beside``, with another checkout of this
program that is measured in turn with this one. ``--save`` makes them the new baseline.
"""

import argparse
import sys
from pathlib import Path

from tests.bench import figures

HERE = Path(__file__).parents[2]


def main():
    parser = argparse.ArgumentParser(prog="python -m tests.bench")
    parser.add_argument("--beside", type=Path, help="another checkout, measured in turn with this one")
    parser.add_argument("--rounds", type=int, default=3, help="times that each is measured (default 3)")
    parser.add_argument("--save", action="store_true", help="keep the figures as the baseline")
    asked = parser.parse_args()
    if asked.beside is not None:
        ours, others = figures.side_by_side(HERE, asked.beside, asked.rounds)
        lines = list(figures.table(ours, others, ("here", "beside")))
    else:
        ours = figures.medians([figures.measured(HERE) for _ in range(asked.rounds)])
        stored = figures.baseline()
        lines = list(figures.table(ours, stored[0] if stored else {}, ("here", "baseline")))
        if stored:
            lines.append(f"the baseline's computer takes 1, this one {stored[1]:.3f}; times are scaled by it")
    if asked.save:
        figures.saved(ours)
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
