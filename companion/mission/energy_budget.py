"""The energy that a mission's goals cost one after another, and what is left for the way back."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

Place = tuple[float, float, float]

JOULES_PER_WH = 3_600.0


@dataclass(frozen=True, slots=True)
class GoalEnergy:
    """Energy at one goal.

    Parameters
    ----------
    used_wh : float
        Energy used from the start to this goal [Wh].
    left_wh : float
        Energy left there; negative if it does not last to there [Wh].
    left_after_return_wh : float
        Energy left after a straight flight from there back to the start [Wh].
    """

    used_wh: float
    left_wh: float
    left_after_return_wh: float


@dataclass(frozen=True, slots=True)
class EnergyBudget:
    """Energy along the goals of a mission.

    Parameters
    ----------
    on_board_wh : float
        Energy at the start [Wh].
    reserve_wh : float
        Energy that must be left at the landing [Wh].
    goals : tuple of GoalEnergy
        One entry for each goal, in order; at least one.
    """

    on_board_wh: float
    reserve_wh: float
    goals: tuple[GoalEnergy, ...]

    @property
    def margin_at_goal_wh(self) -> float:
        """Energy beyond the reserve at the last goal; negative if the reserve is missed [Wh]."""
        return self.goals[-1].left_wh - self.reserve_wh

    @property
    def margin_after_return_wh(self) -> float:
        """Energy beyond the reserve after the return from the goal where it is least [Wh]."""
        return min(goal.left_after_return_wh for goal in self.goals) - self.reserve_wh

    @property
    def verdict(self) -> str:
        """One sentence: what is left at the last goal, and by how much the reserve is reached or missed."""
        worst = min(range(len(self.goals)), key=lambda index: self.goals[index].left_after_return_wh)
        return (
            f"{self.goals[-1].left_wh:.1f} Wh left at the last goal, "
            f"the reserve of {self.reserve_wh:g} Wh {_by(self.margin_at_goal_wh)}; "
            f"with the flight back from goal {worst + 1} {_by(self.margin_after_return_wh)}"
        )


def _by(margin_wh: float) -> str:
    return f"{'reached' if margin_wh >= 0.0 else 'missed'} by {abs(margin_wh):.1f} Wh"


def budget_of(
    places: Sequence[Place],
    leg_energy_j: Callable[[Place, Place], float],
    *,
    on_board_wh: float,
    reserve_wh: float,
) -> EnergyBudget:
    """Return the budget of straight legs.

    Parameters
    ----------
    places : sequence of tuple
        East, north, up of the start, then of each goal in order [m].
    leg_energy_j : callable
        Takes two places and returns the energy of the straight flight from the first to the second [J].
    on_board_wh : float
        Energy at the start [Wh].
    reserve_wh : float
        Energy that must be left at the landing [Wh].
    """
    goals, used_wh = [], 0.0
    for begin, end in itertools.pairwise(places):
        used_wh += leg_energy_j(begin, end) / JOULES_PER_WH
        left_wh = on_board_wh - used_wh
        goals.append(GoalEnergy(used_wh, left_wh, left_wh - leg_energy_j(end, places[0]) / JOULES_PER_WH))
    return EnergyBudget(on_board_wh, reserve_wh, tuple(goals))
