"""What passes a flight, by the kind of its file: an encounter model, or a scenario."""

from __future__ import annotations

from companion.research.encounters.daa_scenario import SUFFIX, Scenario, scenario_from_text
from companion.research.encounters.encounter_model import EncounterModel, model_from_text


def passing_from_text(text: str, name: str) -> EncounterModel | Scenario:
    """Read what passes from the text of its file.

    Parameters
    ----------
    text : str
        The file's text.
    name : str
        The file's name: one that ends in ``.daa`` is a scenario, any other an encounter model.

    Raises
    ------
    ConfigError
        For the first thing wrong with it: the file, the place, and what was expected.
    """
    read = scenario_from_text if name.endswith(SUFFIX) else model_from_text
    return read(text, name)
