"""The editor's answers to its page: the mission file's state, changes, plans and flights."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from pathlib import Path

from companion import __version__
from companion.config import MissionConfig
from companion.errors import ConfigError
from companion.kernels.native.ready import make_ready
from companion.ui.editor.edit_scene import Scene, key_tables, scene_of
from companion.ui.editor.edited_mission import EditedMission, changes_of
from companion.ui.editor.plan_answers import PlanAnswers, sliders
from companion.ui.editor.watched_flight import WatchedFlight
from companion.ui.page.ground import Ground
from companion.ui.page.world_document import WorldDocument

SIDES = ("file", "other")
PACE_MAX = 1_000.0
Document = dict[str, object]
Body = Mapping[str, object]


class EditSession:
    """One mission file that is edited in a browser.

    Parameters
    ----------
    path : Path
        The mission file.
    ground : Ground, optional
        What is drawn under the map.

    Raises
    ------
    ConfigError
        If the file cannot be read, or is no YAML.
    """

    def __init__(self, path: Path, ground: Ground | None = None) -> None:
        self._edited, self._ground = EditedMission(path), ground
        self._lock = threading.Lock()
        self._scene: tuple[str, Scene] | None = None
        self._world: tuple[str, WorldDocument] | None = None
        self._plans = PlanAnswers()
        self._flight: WatchedFlight | None = None
        threading.Thread(target=make_ready, name="kernels", daemon=True).start()
        self._posts: dict[str, Callable[[Body], Document]] = {
            "change": self._change, "undo": self._undo, "redo": self._redo, "save": self._save,
            "reload": self._reload, "plan": self._plan, "fly": self._fly, "stop": self._stop,
        }  # fmt: skip

    def post(self, name: str, body: Body) -> Document | None:
        """Return the answer to a request that may change something; None if there is no such request.

        Raises
        ------
        CompanionError
            If the request is wrong, or cannot be carried out.
        """
        found = self._posts.get(name)
        return None if found is None else found(body)

    def state(self) -> Document:
        """Return the mission file as it is now: what it shows, what is wrong, what can be undone."""
        with self._lock:
            return self._state()

    def tables(self) -> Document:
        """Return what does not change: the program's version, keys of all sections, sliders."""
        return {"version": __version__, "keys": key_tables(), "sliders": sliders()}

    def flight(self, since: int) -> Document:
        """Return the messages of the flight from a number on; of no flight, there are none.

        Parameters
        ----------
        since : int
            Number of messages that are known already.
        """
        flight = self._flight
        return {"lines": [], "next": 0, "is_over": True} if flight is None else flight.messages_since(since)

    def ground(self) -> bytes:
        """Return tiles and heights about the mission as JSON; empty while the mission is wrong."""
        return self._present_world().ground(self._ground)

    def field(self, height_m: float) -> bytes:
        """Return the radars' membership at a height as JSON, or that it is being computed.

        Parameters
        ----------
        height_m : float
            Height above the origin [m].
        """
        return self._present_world().field(height_m)

    def close(self) -> None:
        """End the flight that is being flown."""
        self._stop({})

    def _state(self) -> Document:
        edited, file = self._edited, str(self._edited.path)
        if self._scene is None or self._scene[0] != edited.text:
            self._scene = edited.text, scene_of(edited.text, file)
        return {
            "file": file,
            "number": edited.number,
            "is_changed": edited.is_changed,
            "can_undo": edited.can_undo,
            "can_redo": edited.can_redo,
            **self._scene[1].document,
        }

    def _present_world(self) -> WorldDocument:
        with self._lock:
            text = self._edited.text
            if self._world is None or self._world[0] != text:
                self._world = text, WorldDocument(text, str(self._edited.path))
            return self._world[1]

    def _change(self, body: Body) -> Document:
        changes = changes_of(body.get("changes"))
        with self._lock:
            seen = body.get("number", self._edited.number)
            if seen != self._edited.number:  # Its paths may mean other elements by now.
                raise _wrong("number", seen, f"{self._edited.number}: another window has changed the mission")
            self._edited.change(changes)
            return self._state()

    def _undo(self, _body: Body) -> Document:
        with self._lock:
            self._edited.undo()
            return self._state()

    def _redo(self, _body: Body) -> Document:
        with self._lock:
            self._edited.redo()
            return self._state()

    def _save(self, _body: Body) -> Document:
        with self._lock:
            self._edited.save()
            return self._state()

    def _reload(self, _body: Body) -> Document:
        with self._lock:
            self._edited.reload()
            return self._state()

    def _plan(self, body: Body) -> Document:
        settings, side = body.get("settings", {}), body.get("side", SIDES[0])
        if not isinstance(settings, dict):
            raise _wrong("settings", settings, "keys of planning with their values")
        if side not in SIDES:
            raise _wrong("side", side, " or ".join(SIDES))
        text, number, file = self._edited.text, self._edited.number, str(self._edited.path)
        is_whole = body.get("is_whole") is True
        return {"number": number, **self._plans.answer(text, file, settings, str(side), is_whole=is_whole)}

    def _fly(self, body: Body) -> Document:
        pace, seed = body.get("pace", 0), body.get("seed", 1)
        if type(pace) not in (int, float) or not 0.0 <= pace <= PACE_MAX:  # type: ignore[operator]
            raise _wrong(
                "pace", pace, f"simulated seconds a second up to {PACE_MAX:.0f}; 0 is as fast as it goes"
            )
        if type(seed) is not int or not 0 <= seed < 2**32:
            raise _wrong("seed", seed, "a whole number from 0")
        self._stop({})
        self._flight = WatchedFlight(self._right_mission(), seed, float(pace) or math.inf)  # type: ignore[arg-type]
        return {"is_begun": True}

    def _stop(self, _body: Body) -> Document:
        if self._flight is not None:
            self._flight.stop()
        return {}

    def _right_mission(self) -> MissionConfig:
        """Return the mission of the present text.

        Raises
        ------
        ConfigError
            If it is wrong.
        """
        with self._lock:
            self._state()
            assert self._scene is not None
            scene = self._scene[1]
        if scene.mission is None:
            expected = "a mission without errors; they are listed on the page"
            raise ConfigError(str(self._edited.path), None, "mission", "one with errors", expected)
        return scene.mission


def _wrong(key: str, value: object, expected: str) -> ConfigError:
    return ConfigError("request", None, key, repr(value)[:60], expected)
