"""What README and notebook say of Python is carried out, and comes out as they say."""

import base64
import contextlib
import json
import re

import pytest

from tests.docs.run_notebook import NOTEBOOK, ROOT, run

PNG = b"\x89PNG\r\n\x1a\n"
SIZE_MAX = 400_000  # bytes of a notebook


def test_the_lines_in_the_readme_work(tmp_path, monkeypatch, capsys):
    (block,) = re.findall(
        r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.M | re.S
    )
    assert len(block.strip().splitlines()) <= 12
    (tmp_path / "mission_configs").symlink_to(ROOT / "mission_configs")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(compile(block, "README.md", "exec"), names)
    assert (names["planned"].reaches_goal, names["flown"].success) == (True, True)
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == ["True", "True"]
    for file in ("plan.png", "flight.png"):
        assert (tmp_path / file).read_bytes().startswith(PNG)


def texts_of(notebook):
    """Code and text of each cell's outputs, without pictures."""
    for cell in notebook["cells"]:
        outputs = cell.get("outputs", ())
        told = [output.get("text") or output["data"]["text/plain"] for output in outputs]
        yield "".join(cell["source"]), told


@pytest.mark.slow
@pytest.mark.compiled
def test_the_notebook_says_what_comes_of_it():
    stored = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    with contextlib.chdir(ROOT):
        again = run(json.loads(NOTEBOOK.read_text(encoding="utf-8")))
    assert list(texts_of(again)) == list(texts_of(stored))


def test_the_notebook_was_carried_out_and_ends_with_a_picture():
    text = NOTEBOOK.read_text(encoding="utf-8")
    assert len(text) < SIZE_MAX
    cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    picture = cells[-1]["outputs"][0]["data"]["image/png"]
    assert base64.b64decode(picture).startswith(PNG)
