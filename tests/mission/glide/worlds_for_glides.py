"""Small worlds for glides: fields, walls and people of a plain mission."""

from companion.config import mission_from_text
from companion.config.rules import rules_of
from tests.sim.client import PLAIN

FIELDS = "fields: [{name: meadow, east_m: 1000, north_m: 0, up_m: 0, radius_m: 80}]"
WALL = """obstacles:
  - {name: wall, polygon_enu_m: [[400, -600], [440, -600], [440, 600], [400, 600]], base_m: 0, top_m: 300}
"""


def glide_text(fields=FIELDS, extra="", keys="ratio: 10, airspeed_m_s: 20"):
    """A mission file with the section."""
    body = "".join(f"  {part}\n" for part in (*keys.split(", "), fields) if part)
    return f"{PLAIN}glide:\n{body}{extra}"


def glide_mission_of(*arguments, **named):
    return mission_from_text(glide_text(*arguments, **named), "m.yaml")


def options_of(*arguments, home=(-5_000.0, -5_000.0, 0.0), rally=(), **named):
    """What a choice depends on; home is far away unless it is given."""
    return rules_of(glide_mission_of(*arguments, **named)).glide_options(home, rally)
