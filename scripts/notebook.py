# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Notebooks of the documentation: ``python scripts/notebook.py FILE.ipynb…`` executes them in place.

They read the shared data sets from ``CDFF_DATA``. The documentation site, of which this file is a hook, shows
the cells and outputs of ``NAME.ipynb`` in place of the line ``<!-- NAME.ipynb -->`` of a page.
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

_NEGATIVE_ZERO = re.compile(r"-(0\.0+)\b")
_MARKER = re.compile(r"^<!-- (\w+\.ipynb) -->$", re.MULTILINE)
#: Longest time of a cell, seconds.
_TIMEOUT_S = 300
#: Forms of an output, the first one that is present is shown; longer HTML needs style sheets of its own.
_FORMS, _LONGEST_HTML = ("image/png", "text/html", "text/plain"), 4000
#: Style sheets in the HTML of an output, which would apply to the whole page.
_STYLE = re.compile(r"<style.*?</style>", re.DOTALL)


def execute(path: Path) -> dict[str, Any]:
    """Return the notebook of a file with the outputs of a new execution, in an empty folder.

    Raises ``nbclient.exceptions.CellExecutionError`` if a cell fails.
    """
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        resources = {"metadata": {"path": folder}}
        NotebookClient(notebook, timeout=_TIMEOUT_S, kernel_name="python3", resources=resources).execute()
    document: dict[str, Any] = json.loads(nbformat.writes(notebook))
    document["metadata"].pop("language_info", None)  # it depends on the version of Python
    for cell in document["cells"]:
        cell["metadata"] = {}
        cell["outputs"] = [output for output in cell.get("outputs", []) if output["output_type"] != "stream"]
        if cell["cell_type"] != "code":
            del cell["outputs"]
        for output in cell.get("outputs", []):
            output["metadata"] = {}
            output["data"] = _shown(output["data"])
    return document


def shown_texts(document: Mapping[str, Any]) -> list[str]:
    """Return the texts of the outputs of a notebook in order; for a picture the name of its form.

    Rounded zeros lose their sign: rounding errors, which differ between processors, decide it.
    """
    outputs = (output for cell in document["cells"] for output in cell.get("outputs", []))
    texts = ("".join(output["data"].get("text/plain", "image/png")) for output in outputs)
    return [_NEGATIVE_ZERO.sub(r" \1", text) for text in texts]


def markdown_of(document: Mapping[str, Any]) -> str:
    """Return the cells of a notebook with their outputs as Markdown."""
    return "\n\n".join(part for cell in document["cells"] for part in _parts(cell))


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Insert notebooks into a page of the site; called by MkDocs."""
    folder = Path(page.file.abs_src_path).parent
    return _MARKER.sub(
        lambda match: markdown_of(json.loads((folder / match[1]).read_text(encoding="utf-8"))), markdown
    )


def _shown(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the first form of an output, and its text unless it is a picture."""
    is_long = len(data.get("text/html", "")) > _LONGEST_HTML
    form = next(name for name in _FORMS if name in data and not (name == "text/html" and is_long))
    return {
        name: data[name] for name in data if name == form or (name == "text/plain" and form != "image/png")
    }


def _parts(cell: Mapping[str, Any]) -> Iterator[str]:
    source = "".join(cell["source"])
    yield source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```"
    for output in cell.get("outputs", []):
        data = {form: "".join(text) for form, text in output["data"].items()}
        if "image/png" in data:
            yield f'<img alt="Output" src="data:image/png;base64,{data["image/png"].strip()}">'
        elif "text/html" in data:
            html = _STYLE.sub("", data["text/html"])
            yield re.sub(r"\n\s*", " ", html)  # Markdown ends HTML at an empty line
        else:
            yield f"```text\n{data['text/plain']}\n```"


def main(names: list[str]) -> int:
    """Execute the notebooks in place."""
    for name in names:
        document = execute(Path(name))
        text = json.dumps(document, indent=1, ensure_ascii=False, sort_keys=True)
        Path(name).write_text(text + "\n", encoding="utf-8")
        print(f"{name}: {len(document['cells'])} cells, {len(text) // 1000} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
