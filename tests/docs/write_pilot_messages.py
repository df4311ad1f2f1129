"""Write docs/pilot-messages.md from the table of the pilot's texts: ``make docs``."""

from pathlib import Path

from companion.types.pilot_texts import TEXTS

PAGE = Path(__file__).parents[2] / "docs" / "pilot-messages.md"
HEAD = """# What the pilot reads

The planner sends these texts, and no others, as STATUSTEXT. Each tells only what changes what the pilot would
do: whether the flight is safe, what changes, where the next turn is, when the aircraft arrives. While nothing
changes, nothing is sent. A text is not repeated within 30 s, unless another one about the same subject was
sent in between.

The recording and the report have more: every decision with its reasons, which
[troubleshooting](troubleshooting.md) explains. `make docs` writes this page from
`companion/types/pilot_texts.py`.

| text | severity | it is sent when | what you can do |
|---|---|---|---|
"""


def page():
    """The whole page."""
    rows = [
        f"| {row.template} | {row.severity.name.lower()} | {row.cause} | {row.action} |"
        for row in TEXTS.values()
    ]
    return HEAD + "\n".join(rows) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
