"""Carries out docs/offline.ipynb cell by cell and writes what comes of each into it: ``make docs``."""

import ast
import base64
import contextlib
import io
import json
from pathlib import Path

ROOT = Path(__file__).parents[2]
NOTEBOOK = ROOT / "docs" / "offline.ipynb"


def lines_of(text):
    return text.splitlines(keepends=True)


def carried_out(source, names, number):
    """Outputs of one cell, as a notebook has them: what is printed, and the value of its last line."""
    tree, said = ast.parse(source), io.StringIO()
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    with contextlib.redirect_stdout(said):
        exec(compile(tree, "cell", "exec"), names)
        value = None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), names)
    outputs = []
    if said.getvalue():
        outputs.append({"name": "stdout", "output_type": "stream", "text": lines_of(said.getvalue())})
    if value is not None:
        outputs.append(
            {
                "data": shown(value), "execution_count": number, "metadata": {},
                "output_type": "execute_result",
            }
        )  # fmt: skip
    return outputs


def shown(value):
    """A value as a notebook shows it: a picture where it has one."""
    if hasattr(value, "_repr_png_"):
        picture = base64.encodebytes(value._repr_png_()).decode("ascii")
        return {"image/png": picture, "text/plain": [f"<{type(value).__name__}>"]}
    return {"text/plain": lines_of(repr(value))}


def run(notebook):
    """The notebook with every cell carried out anew, from the project's root."""
    names, number = {"__name__": "__main__"}, 0
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            number += 1
            cell["execution_count"] = number
            cell["outputs"] = carried_out("".join(cell["source"]), names, number)
    return notebook


def main():
    """Write the notebook anew."""
    notebook = run(json.loads(NOTEBOOK.read_text(encoding="utf-8")))
    NOTEBOOK.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    with contextlib.chdir(ROOT):
        main()
