"""Draws the pictures of docs/architecture.md from the code and its tables: ``make docs``."""

import ast
import re
import tomllib
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "architecture.md"
IMAGES = ROOT / "docs" / "img"
STAY = re.compile(r"^\| (\d+) \| `([\w.]+):([\w.]+)` \| (.*) \|$", re.M)
WIDTH, ROW, GAP = 860, 54, 10
PER_ROW = 4  # More rooms of one layer go on in the next row: their names do not fit.
FONT = "font-family='Helvetica, Arial, sans-serif'"


def layers():
    """Layers, the top one first, each a list of rooms."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    rows = next(entry["layers"] for entry in contracts if entry["type"] == "layers")
    return [[name.strip() for name in row.split("|")] for row in rows]


def first_sentence(room):
    """What lives in a room, in the words of its docstring; a file's own line where a room is one file."""
    folder = ROOT / "companion" / room
    source = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
    told = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8")))
    return re.split(r"[.;](?:\s|$)", told.replace("``", ""), maxsplit=1)[0]


def stays():
    """Number, module, function and words of each stay of the track."""
    return [(int(n), module, name, told) for n, module, name, told in STAY.findall(PAGE.read_text("utf-8"))]


def text(x, y, words, size=13, weight="normal", colour="#1b2a3a"):
    return (
        f"<text x='{x}' y='{y}' {FONT} font-size='{size}' font-weight='{weight}' fill='{colour}'>"
        f"{escape(words)}</text>"
    )


def box(x, y, width, height, fill):
    return f"<rect x='{x}' y='{y}' width='{width}' height='{height}' rx='6' fill='{fill}' stroke='#7d8fa3'/>"


def picture(height, parts):
    head = f"<svg xmlns='http://www.w3.org/2000/svg' width='{WIDTH}' height='{height}' "
    return head + f"viewBox='0 0 {WIDTH} {height}'>\n" + "\n".join(parts) + "\n</svg>\n"


def lines_of(words, most):
    """Words in at most two lines of so many characters."""
    lines, line = [], ""
    for word in words.split():
        if len(line) + len(word) + 1 > most and line:
            lines.append(line)
            line = ""
        line = f"{line} {word}".strip()
    lines.append(line)
    return lines[:2] if len(lines) <= 2 else [lines[0], f"{lines[1]} …"]


def rooms_svg():
    """One colour a layer, one box a room."""
    parts = [f"<rect width='{WIDTH}' height='100%' fill='#ffffff'/>"]
    y = GAP
    rows = [
        (number, layer[first : first + PER_ROW])
        for number, layer in enumerate(layers())
        for first in range(0, len(layer), PER_ROW)
    ]
    for number, row in rows:
        width = (WIDTH - GAP * (len(row) + 1)) / len(row)
        for place, room in enumerate(row):
            x = GAP + place * (width + GAP)
            folder = ROOT / "companion" / room
            files = (
                sum(1 for path in folder.rglob("*.py") if path.name != "__init__.py")
                if folder.is_dir()
                else 1
            )
            parts.append(box(round(x), y, round(width), ROW, "#e8f0f8" if number % 2 else "#f4f7ea"))
            parts.append(text(round(x) + 10, y + 18, room, 14, "bold"))
            parts.append(
                text(round(x + width) - 52, y + 18, f"{files} file{'s' * (files > 1)}", 11, colour="#5a6b7c")
            )
            for n, line in enumerate(lines_of(first_sentence(room), int(width / 6.1))):
                parts.append(text(round(x) + 10, y + 34 + 14 * n, line, 11))
        y += ROW + GAP
    return picture(y, parts)


def track_svg():
    """The stays, one below the other, coloured by their room."""
    colours = ("#e8f0f8", "#f4f7ea", "#fdf1e3", "#f3eaf7", "#e9f6f0", "#fbe9ea", "#eef0f2")
    found, rooms, parts, y = stays(), [], [f"<rect width='{WIDTH}' height='100%' fill='#ffffff'/>"], GAP
    for number, module, name, told in found:
        room = module.split(".")[1]
        rooms += [room] * (room not in rooms)
        parts.append(box(GAP, y, WIDTH - 2 * GAP, 36, colours[rooms.index(room) % len(colours)]))
        parts.append(text(GAP + 10, y + 23, str(number), 14, "bold"))
        parts.append(text(GAP + 44, y + 23, f"{module.removeprefix('companion.')}: {name}", 12))
        parts.append(text(470, y + 23, re.sub(r"`", "", told), 12, colour="#33475b"))
        if number < len(found):
            parts.append(f"<path d='M {GAP + 18} {y + 36} v {GAP}' stroke='#7d8fa3' stroke-width='2'/>")
        y += 36 + GAP
    return picture(y, parts)


PICTURES = {"rooms.svg": rooms_svg, "track.svg": track_svg}


def main():
    """Write the pictures."""
    for name, draw in PICTURES.items():
        (IMAGES / name).write_text(draw(), encoding="utf-8")


if __name__ == "__main__":
    main()
