"""What the site has beside the pages in docs/: API reference, notebooks, formulas as MathML.

The formulas are written as in LaTeX between dollar signs. MathML is drawn by the browser itself, so
a page needs no script and no network.
"""

from __future__ import annotations

import html
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from nbclient import NotebookClient
from nbconvert import MarkdownExporter

ROOT = Path(__file__).resolve().parents[2]
RUN = "run"  # the value of `notebooks` with which they are executed
CELL_SECONDS = 1200
API = {  # pages of the reference: title, and the packages or modules on it
    "interface": ("Interface", [
        "mpcplan", "config", "errors", "task", "observation", "trajectory", "vehicle", "plan",
        "planner", "seeking", "cycle", "develop", "choice", "guessing", "risk", "reassociate",
        "plug", "environment", "witness", "console",
    ]),
    "road": ("Road and loading", [
        "scenario", "scenario_checks", "scenario_repair", "scenario_xml", "road",
    ]),
    "predict": ("Prediction", ["predict"]),
    "game": ("Level-k game", ["game"]),
    "seed": ("Seeds", ["seed"]),
    "refine": ("Refinement", ["refine", "solvers"]),
    "verify": ("Verification", ["verify"]),
    "simulate": ("Closed loop", ["simulate", "baselines"]),
    "sumo": ("Simulated traffic", ["sumo"]),
    "rules": ("Rules", ["rules"]),
    "score": ("Referee", ["score"]),
    "bound": ("Bound", ["bound"]),
    "bench": ("Many scenarios", ["bench", "compete", "report", "report.figures"]),
    "show": ("Pictures and words", ["show", "explain", "review"]),
}  # fmt: skip
NOT_IN_API = ("cli", "__main__")  # no interface: what they do is in the README
MATH = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)


def on_files(files: Files, config: Any) -> Files:
    """Adds the pages that are made here."""
    for path, content in (*_reference(), *_notebooks(config["extra"]["notebooks"] == RUN)):
        files.append(File.generated(config, path, content=content))
    return files


def on_page_content(text: str, **kwargs: Any) -> str:
    """Formulas as MathML."""
    return MATH.sub(_mathml, text)


def _mathml(found: re.Match[str]) -> str:
    latex, display = html.unescape(found[3]).strip(), found[2] == "["
    latex = latex.replace("{aligned}", "{align*}")  # the converter knows only this one
    try:
        made = convert(latex, display="block" if display else "inline")
    except Exception as error:
        raise PluginError(f"formula {latex!r}: {type(error).__name__}: {error}") from error
    unknown = re.search(r"\\\w+", made)
    if unknown is not None:
        raise PluginError(f"formula {latex!r}: unknown: {unknown[0]}")
    # browsers mind the style, not the attribute
    return re.sub(r'columnalign="(left|right)"', r'style="text-align: \1"', made)


# ---------------------------------------------------------------- API reference


def modules(package: str) -> Iterator[str]:
    """A module or package of mpcplan with all its modules, by their full names."""
    name = package if package == "mpcplan" else f"mpcplan.{package}"
    yield name
    folder = ROOT.joinpath(*name.split("."))
    if package != "mpcplan" and folder.is_dir():
        yield from (f"{name}.{one.name}" for one in pkgutil.iter_modules([str(folder)]))


def _reference() -> Iterator[tuple[str, str]]:
    lines = [
        "# API reference",
        "",
        "From the docstrings, by stage.",
        "",
        "| Page | Of |",
        "|---|---|",
    ]
    for page, (title, packages) in API.items():
        of = ", ".join(f"`{name}`" for name in packages)
        lines.append(f"| [{title}]({page}.md) | {of} |")
        parts = [f"::: {module}\n" for package in packages for module in modules(package)]
        yield f"api/{page}.md", "\n".join([f"# {title}\n", *parts])
    yield "api/index.md", "\n".join(lines) + "\n"


# ---------------------------------------------------------------- notebooks


def _notebooks(run: bool) -> Iterator[tuple[str, str | bytes]]:
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        if run:
            place = {"metadata": {"path": str(path.parent)}}
            NotebookClient(
                notebook, timeout=CELL_SECONDS, kernel_name="python3", resources=place,
                extra_arguments=["--log-level=ERROR"],
            ).execute()  # fmt: skip
        resources = {"output_files_dir": path.stem, "unique_key": path.stem}
        text, made = MarkdownExporter().from_notebook_node(notebook, resources=resources)
        yield f"notebooks/{path.stem}.md", _page(text, run)
        for name, content in made["outputs"].items():
            yield f"notebooks/{name}", content


def _page(text: str, run: bool) -> str:
    """A notebook's text with links as they are among the pages."""
    text = text.replace("](../docs/", "](../").replace("%matplotlib inline\n", "")
    if run:
        return text
    head, rest = text.split("\n", 1)
    note = "This page was made without executing the notebook: its figures are missing."
    return (
        f"{head}\n\n!!! note\n    {note} `NOTEBOOKS=run mkdocs build --strict` makes them.\n{rest}"
    )
