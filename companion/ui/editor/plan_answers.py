"""Offline plans for the editor's page: of the file, and with other prices and limits."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping

import numpy as np

from companion.config import MissionConfig, mission_from_text, require_goals
from companion.config.compose import goals_of
from companion.config.models import PlanningConfig
from companion.config.offline_problem import judged_plan, offline_problem, offline_world
from companion.errors import CompanionError, ConfigError
from companion.kernels.native.ready import make_ready
from companion.planning.plan_runner import StopRule
from companion.planning.solver import solve
from companion.recording.mcap_writer import plain
from companion.types.path import Path
from companion.types.plan import Plan
from companion.ui.editor.place_changes import set_value

TIME_LIMIT_S = 0.5  # A plan that takes longer is shown unfinished.
WHOLE_LIMIT_S = 30.0  # The search is then continued to its end, for at most this time.
LEVEL_MIN = 0.01  # Below this a place is not under threat.
# Prices and limits that the page asks for with sliders: the lowest and the highest value of each.
SLIDERS: dict[str, tuple[float, float]] = {
    "price_seen": (0.0, 20.0),
    "price_pursued": (0.0, 20.0),
    "price_near": (0.0, 30.0),
    "price_energy": (0.0, 3.0),
    "price_collision": (0.0, 100.0),
    "seen_max_s": (1.0, 120.0),
    "threat_level_max": (0.05, 1.0),
    "quality_min": (0.0, 1.0),
    "clearance_wanted_m": (0.0, 300.0),
}


class SupersededError(CompanionError):
    """A newer plan was requested, so that this one is not needed."""


def sliders() -> list[dict[str, object]]:
    """Return key, lowest, highest and default value of each slider; no default means no limit."""
    defaults = {key: PlanningConfig.model_fields[key].default for key in SLIDERS}
    return [
        {"key": key, "low": low, "high": high, "default": defaults[key]}
        for key, (low, high) in SLIDERS.items()
    ]


class PlanAnswers:
    """Makes one plan at a time; a newer one for the same side of the comparison breaks the older one off."""

    def __init__(self) -> None:
        self._turn = threading.Lock()
        self._lock = threading.Lock()
        self._wanted: dict[str, _Deadline] = {}

    def answer(
        self, text: str, file: str, settings: Mapping[str, object], side: str, *, is_whole: bool = False
    ) -> dict[str, object]:
        """Return a plan of a mission file's text as JSON.

        Parameters
        ----------
        text : str
            The mission file.
        file : str
            Name of the file.
        settings : mapping
            Values of ``planning`` that count instead of the file's, by key.
        side : str
            Side of the comparison that the plan is for.
        is_whole : bool
            Whether it is made to its end, while nothing newer is asked for.

        Raises
        ------
        ConfigError
            If the mission or a setting is wrong.
        SupersededError
            If a newer plan was asked for meanwhile.
        """
        for key, value in settings.items():
            if key not in SLIDERS:
                raise ConfigError(
                    "request", None, str(key)[:60], repr(value)[:60], f"one of {', '.join(SLIDERS)}"
                )
            text = set_value(text, ("planning", key), value)
        mission = mission_from_text(text, file)
        require_goals(mission, file)
        rule = self._begun(side, is_whole)
        with self._turn:
            if rule.is_broken_off:
                raise SupersededError("a newer plan is asked for")
            make_ready()  # The first plan may wait for it, and has its whole time then.
            began = time.perf_counter()
            rule.start(began + (WHOLE_LIMIT_S if is_whole else TIME_LIMIT_S))
            plan = _planned(mission, rule)
            took = time.perf_counter() - began
        if rule.is_broken_off:
            raise SupersededError("a newer plan is asked for")
        return _document(mission, plan) | {"took_s": round(took, 3), "is_stopped": rule.is_stopped}

    def _begun(self, side: str, is_whole: bool) -> _Deadline:
        """Return the stopping rule of a new plan.

        The older one of this side is broken off, and any that would take long.
        """
        rule = _Deadline(is_whole)
        with self._lock:
            for other, older in self._wanted.items():
                if other == side or older.is_whole:
                    older.break_off()
            self._wanted[side] = rule
        return rule


class _Deadline(StopRule):
    """Stops a plan at a deadline, which is set when the plan begins."""

    def __init__(self, is_whole: bool) -> None:
        super().__init__(lambda _asked: time.perf_counter() >= self._due_s)
        self.is_whole = is_whole
        self._due_s = 0.0

    def start(self, due_s: float) -> None:
        """Set the deadline by the computer's clock [s]."""
        self._due_s = due_s


def _planned(mission: MissionConfig, rule: StopRule) -> Plan:
    """Return the plan of ``companion plan`` with the mission file's seed."""
    problem = offline_problem(mission, offline_world(mission), None, mission.planning.seed)
    return judged_plan(mission, problem, solve(problem, rule))


def _document(mission: MissionConfig, plan: Plan) -> dict[str, object]:
    """Return what the page shows of a plan."""
    path = plan.path
    document: dict[str, object] = {
        "reaches_goal": plan.reaches_goal,
        "status": plan.status.value,
        "notes": plan.notes,
        "J_s": plan.objective_s,
        "gap": plan.gap,
        "seen_s": plan.seen_s,
        "quality": plan.measures.quality,
        "settings": {key: getattr(mission.planning, key) for key in SLIDERS},
        "path": [],
    }
    if path is not None:
        document |= {
            "path": np.column_stack([path.times_s, path.positions_enu_m, path.threat_levels])
            .round(3)
            .tolist(),
            "length_m": path.length_m,
            "arrival_s": path.duration_s,
            "level_max": float(path.threat_levels.max()),
            "threatened_m": _threatened_m(path),
            "pursued_s": plan.pursuit.total_s,
            "first_pursued_s": plan.pursuit.first_s,
            "lowest_m": float(path.positions_enu_m[:, 2].min()),
            "num_goals": len(goals_of(mission)),
        }
    return plain(document)  # type: ignore[return-value]


def _threatened_m(path: Path) -> float:
    """Return the length of the path with a threat level above zero [m]."""
    steps = np.linalg.norm(np.diff(path.positions_enu_m, axis=0), axis=1)
    return float(steps[path.threat_levels[1:] > LEVEL_MIN].sum())
