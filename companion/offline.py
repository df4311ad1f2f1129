"""Planning and flying offline from Python, for ``from companion import load_mission, plan, fly``.

Plans are those of ``companion plan``, flights those of ``companion sitl``. The simulator is an extra, which
is imported only for a flight.
"""

from __future__ import annotations

import pkgutil
import tempfile
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

from companion.config import MissionConfig, load_mission, require_goals
from companion.config.compose import world_of
from companion.errors import ConfigError
from companion.frames import FloatArray
from companion.research.campaign.runs import plan_runs, result_of
from companion.run_places import FLIGHT, places
from companion.types.path import Path as FlightPath
from companion.types.plan import Plan
from companion.types.record import FlightRecord
from companion.world.snapshot import Snapshot

DPI_NOTEBOOK = 72

__all__ = ["Flown", "Planned", "fly", "load_mission", "plan"]


@dataclass(frozen=True, slots=True)
class Planned:
    """One offline plan.

    Parameters
    ----------
    mission : MissionConfig
        Mission of the plan.
    world : Snapshot
        World in which it was made.
    answer : Plan
        The planner's answer.
    """

    mission: MissionConfig
    world: Snapshot
    answer: Plan

    @property
    def reaches_goal(self) -> bool:
        """Whether the path passes all goals and ends at the last."""
        return self.answer.reaches_goal

    @property
    def path(self) -> FlightPath:
        """The path: times [s], positions, shape (N, 3) [m], courses, speeds.

        Raises
        ------
        ValueError
            If there is none.
        """
        if self.answer.path is None:
            raise ValueError(f"there is no path: {self.answer.status.value}")
        return self.answer.path

    @property
    def measures(self) -> Mapping[str, object]:
        """Measures of the paper's tables by name, as in ``companion plan --json``."""
        measures = result_of(self.answer, self.mission)
        del measures["path"]
        return measures

    def picture(self, file: str | Path, *, dpi: int = 150) -> Path:
        """Draw the plan with its search, as a PNG."""
        from companion.ui.reports.plots import plot_plan  # Drawing needs an extra.  # noqa: PLC0415

        plot_plan(Path(file), self.mission, self.world, self.answer, dpi)
        return Path(file)

    def _repr_png_(self) -> bytes:
        return _bytes_of(self.picture)


@dataclass(frozen=True, slots=True)
class Flown:
    """One flight in the simulator.

    Parameters
    ----------
    mission : MissionConfig
        Mission of the flight.
    measures : mapping
        Measures by name, as in ``companion sitl --json``.
    record : FlightRecord
        Decisions, missions and the true paths.
    """

    mission: MissionConfig
    measures: Mapping[str, object]
    record: FlightRecord

    @property
    def success(self) -> bool:
        """Whether the aircraft reached the goal and touched nothing."""
        return self.measures["success"] is True

    @property
    def true_path(self) -> FloatArray:
        """True path, shape (N, 4) at 10 Hz: time [s], east, north, up [m]."""
        return self.record.flown[:, :4]

    def picture(self, file: str | Path, *, dpi: int = 150) -> Path:
        """Draw the flown path and the paths of threats, as a PNG."""
        from companion.ui.reports import style  # Drawing needs an extra.  # noqa: PLC0415
        from companion.ui.reports.plots import flight_map  # noqa: PLC0415

        with style.drawing():
            world = world_of(self.mission, none_known=False)
            style.write_picture(Path(file), flight_map(self.mission, world, self.record), dpi)
        return Path(file)

    def _repr_png_(self) -> bytes:
        return _bytes_of(self.picture)


def plan(
    mission: MissionConfig,
    *,
    method: str | None = None,
    seed: int | None = None,
    time_limit_s: float | None = None,
) -> Planned:
    """Plan from a mission's start to its goals.

    Parameters
    ----------
    mission : MissionConfig
        Mission from :func:`load_mission`.
    method : str, optional
        ``safe-rrt``, a comparator or an installed planner; by default that of the mission file.
    seed : int, optional
        Seed of the search; by default that of the mission file.
    time_limit_s : float, optional
        Time limit of the search [s]. By default the mission file's iterations end it, which makes the result
        repeatable.

    Raises
    ------
    ConfigError
        If there is no such method, or the mission leaves its goals to the autopilot.
    """
    require_goals(mission, mission.name)
    first = mission.planning.seed if seed is None else seed
    world, (answer,) = plan_runs(mission, method=method, first_seed=first, runs=1, time_limit_s=time_limit_s)
    return Planned(mission, world, answer)


def fly(
    mission: MissionConfig, *, seed: int = 1, autopilot: Literal["ardupilot", "px4"] = "ardupilot"
) -> Flown:
    """Fly a mission in the simulator, as fast as possible.

    Parameters
    ----------
    mission : MissionConfig
        Mission from :func:`load_mission`.
    seed : int
        Seed of weather, sensors, tracks and plans.
    autopilot : str
        Autopilot whose mission semantics are simulated.

    Raises
    ------
    ConfigError
        If the simulator is not installed, or the mission leaves its goals to the autopilot.
    """
    require_goals(mission, mission.name)
    flown = _simulator()
    with ThreadPoolExecutor(1) as executor:  # The event loop of a notebook's thread is already running.
        return executor.submit(flown, mission, seed, autopilot).result()


def _bytes_of(picture: Callable[..., Path]) -> bytes:
    """Return a small picture for a notebook, which shows bytes and no file."""
    with tempfile.TemporaryDirectory() as folder:
        return picture(Path(folder) / "picture.png", dpi=DPI_NOTEBOOK).read_bytes()


def _simulator() -> Callable[[MissionConfig, int, str], Flown]:
    """Return the function that flies, which the simulator registers together with its commands."""
    try:
        place = places()[FLIGHT]
        return cast("Callable[[MissionConfig, int, str], Flown]", pkgutil.resolve_name(place))
    except (KeyError, ImportError):
        found, expected = "no simulator installed", "pip install 'safe-rrt-companion[sim]'"
        raise ConfigError("companion", None, "fly", found, expected) from None
