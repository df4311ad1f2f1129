"""The mission file's reference page tells every key, and is the one in docs."""

from pathlib import Path

import pytest

from companion.config.models import MissionConfig, PlanningConfig
from companion.config.reference import meanings, reference
from companion.config.sections.section_base import Section

PAGE = Path(__file__).parents[2] / "docs" / "mission-file.md"


def test_the_page_in_docs_is_the_one_made_from_the_models():
    assert PAGE.read_text(encoding="utf-8") == reference(), "make docs writes it anew"


@pytest.mark.parametrize("model", Section.__subclasses__(), ids=lambda model: model.__name__)
def test_every_key_has_a_meaning(model):
    assert [name for name in model.model_fields if not meanings(model).get(name)] == []


def test_bounds_defaults_and_units_are_those_of_the_models():
    assert "| `swap_gain` |  | number ≥ 0, ≤ 1 | `0.05` |" in reference()
    assert "| `acceleration_max_m_s2` | m/s² | number > 0, ≤ 100 | required |" in reference()
    assert "| `certainty` |  | `shifted` or `literal` | `shifted` |" in reference()
    assert "| `allow_rtl` |  | `true` or `false` | `false` |" in reference()
    assert "| `boundary_coefficient_per_m` | 1/m |" in reference()
    assert PlanningConfig.model_fields["swap_gain"].default == 0.05


def test_every_section_has_its_heading_and_links_lead_to_one():
    page = reference()
    for name in ("planning", "link.signing", "obstacles", "authority"):
        assert f"\n## {name}\n" in page
        assert f"[{name}](#{name.replace('.', '')})" in page
    assert set(MissionConfig.model_fields) <= {
        line.split("`")[1] for line in page.splitlines() if line[:3] == "| `"
    }
