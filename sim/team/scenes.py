"""Starts and goals of a team, drawn at random."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray, LocalFrame
from companion.mission.team.team_settings import TeamSettings

FRAME = LocalFrame(47.4, 8.5, 450.0)
SPACING_M = 40.0  # Between the edges of two circles, in addition to the separation.
DRAWS_MAX = 100_000
WAY_MIN = 1.0 / 3.0  # Shortest way to a goal, as a share of the side of the square.
SETTINGS = TeamSettings(apart_m=60.0, apart_up_m=25.0)


@dataclass(frozen=True, slots=True)
class Scene:
    """A team and where it flies.

    Parameters
    ----------
    num_aircraft : int
        Number of aircraft.
    side_m : float
        Side of the square in which they start and end [m].
    levels_m : tuple of float
        Heights at which they circle and fly [m].
    radius_m, speed_m_s : float
        Radius of their circles, and their speed over the ground [m, m/s].
    climb : float
        Steepest climb, a tangent.
    tolerance_m, tolerance_up_m : float
        How far they are off their plans at most, horizontally and vertically [m].
    loss : float
        Share of the messages that a receiver does not hear.
    delay_s : float
        Mean delay of a message; each takes from half to one and a half of it [s].
    range_m : float
        Range of the radio [m].
    end_s : float
        The flight ends then at the latest [s].
    settings : TeamSettings
        What the team agrees by.
    """

    num_aircraft: int = 128
    side_m: float = 12_000.0
    levels_m: tuple[float, ...] = (100.0, 150.0, 200.0, 250.0, 300.0, 350.0, 400.0)
    radius_m: float = 80.0
    speed_m_s: float = 20.0
    climb: float = 0.12
    tolerance_m: float = 15.0
    tolerance_up_m: float = 8.0
    loss: float = 0.3
    delay_s: float = 1.0
    range_m: float = 30_000.0
    end_s: float = 1500.0
    settings: TeamSettings = SETTINGS


def starts_and_goals(scene: Scene, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return where each aircraft circles at first and where it wants to circle.

    A goal may lie in a circle that somebody else has not left.

    Parameters
    ----------
    scene : Scene
        The team.
    rng : Generator
        Source of chance.

    Returns
    -------
    starts, goals : ndarray, shape (N, 3)
        East, north, up of the centres [m].
    """
    starts, goals = circles(scene, rng), circles(scene, rng)
    for _ in range(DRAWS_MAX):
        near = np.flatnonzero(np.hypot(*(goals - starts)[:, :2].T) < WAY_MIN * scene.side_m)
        if not len(near):
            break
        swapped = [near[0], rng.integers(len(goals))]
        goals[swapped] = goals[swapped[::-1]]
    return starts, goals


def circles(scene: Scene, rng: np.random.Generator) -> FloatArray:
    """Return centres of circles that keep clear of each other.

    Parameters
    ----------
    scene : Scene
        The team.
    rng : Generator
        Source of chance.

    Returns
    -------
    ndarray, shape (N, 3)
        East, north, up of a circle for each aircraft [m].
    """
    apart_m = 2.0 * (scene.radius_m + scene.tolerance_m) + scene.settings.apart_m + SPACING_M
    found = np.empty((0, 3))
    for _ in range(DRAWS_MAX):
        if len(found) == scene.num_aircraft:
            return found
        place = np.array([*rng.uniform(0.0, scene.side_m, 2), rng.choice(scene.levels_m)])
        near = np.hypot(*(found[:, :2] - place[:2]).T) < apart_m
        if not (near & (abs(found[:, 2] - place[2]) < 1.0)).any():
            found = np.vstack([found, place])
    raise ValueError(f"{scene.num_aircraft} aircraft: expected fewer, or a larger square")
