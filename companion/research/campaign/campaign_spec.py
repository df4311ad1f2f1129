"""The file of a campaign: which methods plan or fly which missions, with which settings and seeds."""

from __future__ import annotations

import copy
import hashlib
import itertools
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, cast

from pydantic import BeforeValidator, Field, ValidationError
from pydantic_core import PydanticCustomError, PydanticKnownError

from companion.config.explain import explained
from companion.config.load import mission_from_document, mission_text
from companion.config.models import MissionConfig
from companion.config.sections.section_base import Section
from companion.config.source import Document, KeyPath, parse
from companion.errors import ConfigError
from companion.planning.comparators import ANYTIME_METHODS, FLOWN_METHODS, METHODS
from companion.planning.plugins.installed_planners import installed_planner, method_fault
from companion.planning.plugins.installed_threats import sight_origin
from companion.research.campaign.flown_methods import (
    ENCOUNTER,
    FAULTS,
    PARTS,
    EncounterConfig,
    LinkFaultsConfig,
    mission_part,
    part_of,
)
from companion.research.encounters.encounter_model import model_text
from companion.research.encounters.passing import passing_from_text

SEEDS_MAX = 100_000
DEFAULT_SETTINGS = "default"  # Name of the setting that changes nothing.

Scalar = bool | int | float | str
Label = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9][A-Za-z0-9 ._-]*$")]
Overlay = dict[str, object]


def _seeds(value: object) -> object:
    """Seeds as written; a number of them counts up from 1."""
    if isinstance(value, bool) or not isinstance(value, int | tuple):
        raise PydanticCustomError("seeds", "how many seeds, from 1 on, or a list of them")
    if isinstance(value, tuple):
        return value
    if not 1 <= value <= SEEDS_MAX:
        raise PydanticKnownError("greater_than_equal" if value < 1 else "less_than_equal", _bound(value))
    return tuple(range(1, value + 1))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _bound(value: int) -> dict[str, int]:
    return {"ge": 1} if value < 1 else {"le": SEEDS_MAX}


class CampaignConfig(Section):
    """The contents of a campaign file; its runs are all combinations."""

    name: Label
    """Names the campaign and its folder."""
    description: Annotated[str, Field(max_length=1_000)] = ""
    """For people."""
    kind: Literal["plans", "flights", "anytime", "encounters"]
    """Plans from the starts, whole flights, how soon there is a path, or flights that others pass."""
    missions: Annotated[tuple[str, ...], Field(min_length=1, max_length=1_000)]
    """Mission files, from this file's folder on."""
    methods: Annotated[tuple[str, ...], Field(min_length=1, max_length=100)]
    """The first is what the others are compared with."""
    seeds: Annotated[
        tuple[Annotated[int, Field(ge=0, le=2**63 - 1)], ...],
        BeforeValidator(_seeds), Field(min_length=1, max_length=SEEDS_MAX),
    ]  # fmt: skip
    """How many, from 1 on, or which."""
    settings: Annotated[dict[Label, Overlay], Field(min_length=1)] = {DEFAULT_SETTINGS: {}}  # noqa: RUF012
    """Values by their dotted keys in mission files, under a name for each such set."""
    autopilot: Literal["ardupilot", "px4"] = "ardupilot"
    """Whose semantics the simulator has; of flights and encounters."""
    budget_s: Annotated[float, Field(gt=0.0, le=86_400.0)] | None = None
    """Seconds a plan; left out, the mission's iterations end it, which is repeatable. Of plans."""


@dataclass(frozen=True, slots=True)
class Run:
    """One plan or flight of a campaign, by names; ``number`` counts a campaign's runs from 0."""

    number: int
    mission: str
    setting: str
    method: str
    seed: int


@dataclass(frozen=True)
class Campaign:
    """A campaign that was read: its file, and the text of its missions.

    Parameters
    ----------
    file : str
        Name of its file.
    config : CampaignConfig
        The file's contents.
    texts : mapping
        Each mission file's text, by the mission's name.
    models : mapping
        Text and name of the file of what passes under each setting; of encounters only.
    """

    file: str
    config: CampaignConfig
    texts: Mapping[str, str]
    models: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    @cached_property
    def runs(self) -> tuple[Run, ...]:
        """All runs, ordered by seed, so that a part of a campaign can be compared already."""
        config = self.config
        named = itertools.product(config.seeds, self.texts, config.settings, config.methods)
        return tuple(
            Run(number, mission, setting, method, seed)
            for number, (seed, mission, setting, method) in enumerate(named)
        )

    def mission(self, name: str, setting: str) -> MissionConfig:
        """Return a mission under settings."""
        overlay = mission_part(self.config.settings[setting])
        return mission_from_document(_overlaid(parse(self.texts[name], name), overlay))

    def faults(self, setting: str) -> LinkFaultsConfig:
        """Return the link's faults under settings."""
        return LinkFaultsConfig.model_validate(part_of(self.config.settings[setting], FAULTS))

    def encounter(self, setting: str) -> EncounterConfig:
        """Return the aircraft that pass under settings."""
        return EncounterConfig.model_validate(part_of(self.config.settings[setting], ENCOUNTER))

    def digest(self, mission: str) -> str:
        """SHA-256 of a mission file's text."""
        return _digest(self.texts[mission])

    def identity(self) -> dict[str, object]:
        """Return the identity of the campaign, for JSON. It consists of lists because the order matters."""
        values = self.config.model_dump(mode="json", exclude={"description", "missions", "settings"})
        lists = {
            "models": [[name, _digest(text)] for name, (text, _) in self.models.items()],
            "missions": [[name, self.digest(name)] for name in self.texts],
            "settings": [[name, overlay] for name, overlay in self.config.settings.items()],
            "planners": self._foreign_planners(),
            "threat_models": self._foreign_threat_models(),
        }
        return values | {key: entries for key, entries in lists.items() if entries}

    def _foreign_planners(self) -> list[list[str]]:
        """Return methods that are other packages' planners, each with its package and version."""
        own = {*METHODS, *FLOWN_METHODS, *ANYTIME_METHODS}
        return [[name, installed_planner(name).origin] for name in self.config.methods if name not in own]

    def _foreign_threat_models(self) -> list[list[str]]:
        """Return models of radars in the missions, each with its package and version."""
        missions = itertools.starmap(self.mission, itertools.product(self.texts, self.config.settings))
        names = {radar.model for mission in missions for radar in mission.radars} - {""}
        return [[name, sight_origin(name)] for name in sorted(names)]


def load_campaign(path: Path) -> Campaign:
    """Read a campaign's file and its missions, each under each of the settings.

    Raises
    ------
    ConfigError
        For the first thing wrong with it.
    """
    try:
        text = mission_text(path)
    except ConfigError as error:
        raise ConfigError(error.file, None, error.key, error.value, "a campaign's file to read") from None
    if not text.strip():
        raise ConfigError(str(path), None, "file", "nothing", "the keys of a campaign, such as 'name: mine'")
    document = parse(text, str(path))
    try:
        config = CampaignConfig.model_validate(document.data)
    except ValidationError as error:
        raise explained(document, error.errors(include_url=False), CampaignConfig) from None
    for place, expected in _faults(config):
        raise document.error(place, expected)
    for setting, part in itertools.product(config.settings, PARTS):
        _see_that_part_passes(document, config, setting, part)
    models = _models(document, path, config) if config.kind == "encounters" else {}
    campaign = Campaign(str(path), config, _texts(document, path, config), models)
    for mission, setting in itertools.product(campaign.texts, config.settings):
        _see_that_it_passes(document, campaign, mission, setting)
    return campaign


def _faults(config: CampaignConfig) -> Iterator[tuple[KeyPath, str]]:
    """Faults of keys that depend on each other, or on files that exist."""
    for key, entries in (("missions", config.missions), ("methods", config.methods), ("seeds", config.seeds)):
        for place, entry in enumerate(entries):
            if entry in entries[:place]:
                # A number of seeds has no entries, and names none twice.
                yield (key, place), "each one once"
    others = {"flights": FLOWN_METHODS, "anytime": ANYTIME_METHODS}
    for place, method in enumerate(config.methods):
        if expected := method_fault(method, others.get(config.kind, ())):
            yield ("methods", place), expected
    if config.budget_s is not None and config.kind != "plans":
        yield (
            ("budget_s",),
            f"no such key with 'kind: {config.kind}'; planning.planning_budget_s in settings is",
        )


def _texts(document: Document, path: Path, config: CampaignConfig) -> dict[str, str]:
    """Each mission's text by its name."""
    texts: dict[str, str] = {}
    for place, file in enumerate(config.missions):
        key = ("missions", place)
        try:
            text = mission_text(path.parent / file)
            mission = mission_from_document(parse(text, str(path.parent / file)))
        except ConfigError as error:
            raise document.error(key, f"a mission file that passes: {error}") from None
        if mission.goals_from_autopilot:
            raise document.error(key, "a mission with a list of goals: no autopilot is asked")
        if mission.name in texts:
            raise document.error(key, f"a mission of another name than the first '{mission.name}'")
        texts[mission.name] = text
    return texts


def _models(document: Document, path: Path, config: CampaignConfig) -> dict[str, tuple[str, str]]:
    """Each setting's encounter model or scenario, read once to see that it passes."""
    texts: dict[str, tuple[str, str]] = {}
    for setting, overlay in config.settings.items():
        key = ("settings", setting, f"{ENCOUNTER}.model")
        file = EncounterConfig.model_validate(part_of(overlay, ENCOUNTER)).model
        if not file:
            raise document.error(("settings", setting), f"a setting with {key[-1]}, the aircraft that pass")
        try:
            texts[setting] = model_text(path.parent / os.path.expandvars(file)), file
            passing_from_text(*texts[setting])
        except ConfigError as error:
            raise document.error(key, f"a model that passes: {error}") from None
    return texts


def _see_that_part_passes(document: Document, config: CampaignConfig, setting: str, part: str) -> None:
    """Check that the settings of one of :data:`PARTS` are known and valid, and of this kind of campaign.

    Raises
    ------
    ConfigError
        At the key in the campaign's file.
    """
    values, (section, kind) = part_of(config.settings[setting], part), PARTS[part]
    for name in () if config.kind == kind else values:
        expected = f"no such key with 'kind: {config.kind}', only with 'kind: {kind}'"
        raise document.error(("settings", setting, f"{part}.{name}"), expected)
    try:
        section.model_validate(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name = str(first["loc"][0])
        known = ", ".join(section.model_fields)
        expected = f"one of {known}" if first["type"] == "extra_forbidden" else first["msg"]
        raise document.error(("settings", setting, f"{part}.{name}"), expected) from None


def _see_that_it_passes(document: Document, campaign: Campaign, mission: str, setting: str) -> None:
    """Check that settings name keys of mission files and give them valid values.

    Raises
    ------
    ConfigError
        At the key in the campaign's file.
    """
    overlay = campaign.config.settings[setting]
    try:
        campaign.mission(mission, setting)
    except ConfigError as error:
        at = next((key for key in overlay if error.key == key or error.key.startswith(f"{key}.")), None)
        if at is None:
            raise document.error(("settings", setting), f"settings that {mission} takes: {error}") from None
        raise document.error(("settings", setting, at), error.expected) from None


def _overlaid(document: Document, overlay: Overlay) -> Document:
    """Return a mission file with some values replaced, by their dotted keys."""
    data = copy.deepcopy(document.data)
    for key, value in overlay.items():
        data = _with(data, key.split("."), value)
    return replace(document, data=data)


def _with(data: object, keys: list[str], value: object) -> object:
    """``data`` with a value at the place that the keys name; anything but sections and lists is replaced."""
    if not keys:
        return value
    first, rest = keys[0], keys[1:]
    if isinstance(data, tuple) and first.isdecimal() and int(first) < len(data):
        return tuple(_with(entry, rest, value) if n == int(first) else entry for n, entry in enumerate(data))
    section = cast("dict[str, object]", data) if isinstance(data, dict) else {}
    return section | {first: _with(section.get(first), rest, value)}
