"""What moving threats could do if they knew the path, in kernel form (paper 2.3)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from companion.frames import FloatArray
from companion.kernels.arrays import Game, Obstacles
from companion.kernels.threat.pursuit_game import (
    BLOCK,
    DRIVES,
    FLIES,
    PASSES_BY,
    fill_arrivals,
    fill_tops,
    is_caught,
)
from companion.types.threat import TrackState
from companion.world.pursuer_trees import deviations

CELLS = 256  # along the longer side of the bounds
CELL_MIN_M = 5.0
DEVIATIONS = 2.0  # of a track's place, by which it is taken to be nearer


class Pursuit(IntEnum):
    """What the game of paper 2.3 does in a search; the numbers are the kernel's."""

    IGNORED = 0  # threat levels alone keep away from DTs
    WEIGHED = 1  # seconds under a threat that a DT could be cost
    AVOIDED = 2  # nothing grows to where a DT could be in time


@dataclass
class Chase:
    """The game that one plan plays: what is asked of its path, less and less until there is one.

    Parameters
    ----------
    full : Game
        Against DTs as fast as they can be.
    shares : tuple of float
        Parts of their speed, against which is played where, with all the slack, all ways are barred: before
        races only the first.
    slack_min_s : float
        By which a place has to be passed before it is under threat, where no way leaves more [s].
    is_by_tree : bool
        Whether a tree keeps away from where they could be, which it can in space, too.
    """

    full: Game
    shares: tuple[float, ...]
    slack_min_s: float
    is_by_tree: bool = False

    def __post_init__(self) -> None:
        self.is_hunted = hunts = bool((self.full.hunters[:, 7] != PASSES_BY).any())
        can_avoid = self.full.is_plane or self.is_by_tree  # in space there is no race
        avoided = Pursuit.AVOIDED if can_avoid else Pursuit.WEIGHED
        self.pursuit = avoided if hunts else Pursuit.IGNORED
        self.is_raced = hunts and bool(self.full.is_plane) and not self.is_by_tree
        self.game, self._rung = self.full, ""
        self._left = list(self.shares[:1] if self.is_raced else self.shares)

    @property
    def is_avoided(self) -> bool:
        """Whether nothing may grow to where a DT could be in time."""
        return self.pursuit is Pursuit.AVOIDED

    @property
    def may_give_in(self) -> bool:
        """Whether less can be asked."""
        return self.is_avoided or self.is_raced

    @property
    def note(self) -> str:
        """What had to be given up, in words; '' where nothing had to."""
        return self._rung

    def is_caught(self, position_enu_m: Sequence[float], stamp_s: float) -> bool:
        """Whether a DT could threaten a place [m] at a moment [s]."""
        east, north, up = position_enu_m
        return bool(is_caught(self.game, east, north, up, stamp_s))

    def give_in(self, *, is_late: bool = False) -> None:
        """Ask for less slack before the DTs; then they are only weighed, in a race, and at last by a tree.

        Parameters
        ----------
        is_late : bool
            Whether there is no time for more than the last.
        """
        if self._left and not is_late:
            share = self._left.pop(0)
            self.game = slower(self.full, share, self.slack_min_s)
            self._rung = f"safe from moving threats of {100.0 * share:.0f} % of their speed"
        elif self.pursuit is Pursuit.WEIGHED:
            self.is_raced = False
        else:
            self.game, self.pursuit = self.full, Pursuit.WEIGHED
            self._rung = "no way that moving threats could not bar"


def pursuit_game(
    tracks: Sequence[TrackState], walls: Obstacles, plane_up_m: float | None, bounds: Sequence[float],
    slack_s: float,
) -> Game:  # fmt: skip
    """Earliest arrivals of all moving threats, and the walls that hide from them.

    Parameters
    ----------
    tracks : sequence of TrackState
        Moving threats.
    walls : Obstacles
        What hides, and what they drive round.
    plane_up_m : float or None
        In the plane: the flight level [m].
    bounds : sequence of float
        East and north, each low and high [m], which DTs do not leave.
    slack_s : float
        By which a place has to be passed before it is under threat [s].
    """
    west, east, south, north = bounds[:4]
    spacing = max(CELL_MIN_M, max(east - west, north - south) / CELLS)
    shape = (int((east - west) / spacing) + 2, int((north - south) / spacing) + 2) if tracks else (1, 1)
    game = Game(
        hunters=np.array([_hunter(track) for track in tracks], dtype=np.float64).reshape(-1, 8),
        arrival=np.full((len(tracks), *shape), math.inf),
        least=np.empty((len(tracks), 0, 0)),
        tops=np.full(shape, -math.inf),
        grid=np.array([west, south, spacing]),
        is_plane=0 if plane_up_m is None else 1,
        slack=slack_s,
    )
    if any(hunter[7] == DRIVES for hunter in game.hunters):
        fill_tops(walls, math.nan if plane_up_m is None else plane_up_m, game.grid, game.tops)
    for d, hunter in enumerate(game.hunters):
        if hunter[7] == DRIVES:
            fill_arrivals(hunter[0], hunter[1], game, d)
    return game._replace(least=_least_of_blocks(game.arrival))


def _least_of_blocks(arrival: FloatArray) -> FloatArray:
    """The earliest in each block of cells.

    Parameters
    ----------
    arrival : ndarray, shape (D, NX, NY)
        When a threat can be at each cell of the grid [s].

    Returns
    -------
    ndarray, shape (D, BX, BY)
        When it can be in any of the block's [s].
    """
    across = [-(-n // BLOCK) for n in arrival.shape[1:]]
    cells = np.full((len(arrival), *(BLOCK * n for n in across)), math.inf)
    cells[:, : arrival.shape[1], : arrival.shape[2]] = arrival
    blocks = cells.reshape(len(arrival), across[0], BLOCK, across[1], BLOCK)
    return np.asarray(blocks.min(axis=(2, 4)))


def slower(game: Game, share: float, slack_s: float) -> Game:
    """The game against threats of a share of their speed.

    Parameters
    ----------
    game : Game
        Against threats as fast as they can be.
    share : float
        From 0, as if they stood, to 1.
    slack_s : float
        By which a place has to be passed before it is under threat [s].
    """
    hunters, stamps = game.hunters.copy(), game.hunters[:, 3, None, None]
    hunters[:, 4] *= share
    with np.errstate(divide="ignore", invalid="ignore"):
        later = np.where(game.arrival > stamps, stamps + (game.arrival - stamps) / share, stamps)
    return game._replace(hunters=hunters, arrival=later, least=_least_of_blocks(later), slack=slack_s)


def _hunter(track: TrackState) -> list[float]:
    """Row of :class:`~companion.kernels.arrays.Game`'s hunters."""
    kind = PASSES_BY if track.flies_on else FLIES if track.is_airborne else DRIVES
    nearer = DEVIATIONS * deviations(track)[0]
    reach = track.max_threat_radius_m
    return [*track.position_enu_m, track.stamp_s, track.speed_max_m_s, reach, nearer, kind]
