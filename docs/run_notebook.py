"""Runs a notebook's cells and stores what they print and show: text, and figures as pictures.

python docs/run_notebook.py examples/real_panda.ipynb
"""

from __future__ import annotations

import ast
import base64
import io
import json
import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure


def run_cell(source: str, names: dict[str, Any], number: int) -> list[dict[str, Any]]:
    """The outputs of one cell: what it prints, and the value of its last line if that is an expression.

    Args:
        source: The cell's code.
        names: What the cells before it defined; changed.
        number: Its number, as it is shown.
    """
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed = io.StringIO()
    value = None
    with redirect_stdout(printed):
        exec(compile(tree, f"cell {number}", "exec"), names)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), names)
    outputs = []
    if printed.getvalue():
        text = printed.getvalue().splitlines(keepends=True)
        outputs.append({"name": "stdout", "output_type": "stream", "text": text})
    if value is not None:
        shown = {
            "data": show(value),
            "execution_count": number,
            "metadata": {},
            "output_type": "execute_result",
        }
        outputs.append(shown)
    return outputs


def show(value: Any) -> dict[str, Any]:
    """A value as notebooks show it: a figure as a picture, all else as text."""
    if not isinstance(value, Figure):
        return {"text/plain": repr(value).splitlines(keepends=True)}
    picture = io.BytesIO()
    value.savefig(picture, format="png", dpi=100, metadata={"Software": "armgap"})
    return {
        "image/png": base64.b64encode(picture.getvalue()).decode(),
        "text/plain": ["<a figure>"],
    }


def run_notebook(path: Path) -> None:
    """Runs all cells in one namespace and writes their outputs into the file."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    names: dict[str, Any] = {"__name__": "notebook"}
    number = 0
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            continue
        number += 1
        cell["execution_count"] = number
        cell["outputs"] = run_cell("".join(cell["source"]), names, number)
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    run_notebook(Path(sys.argv[1]))
