"""The package as a whole: its version, its declared dependencies, and what its documents say."""

import ast
import json
import re
import shlex
import subprocess
import sys
from importlib.metadata import requires, version
from pathlib import Path

import pytest

import mpcplan
from mpcplan.bench.store import COLUMNS, STATUSES
from mpcplan.cli.arguments import parser
from mpcplan.config import Config

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted((ROOT / "mpcplan").rglob("*.py"))
DOCUMENTS = [
    *sorted(ROOT.glob("*.md")),
    *sorted((ROOT / "docs").glob("*.md")),
    ROOT / "scenarios" / "README.md",
]
README = (ROOT / "README.md").read_text(encoding="utf-8")
MODULES = {  # import name by distribution, where the two differ
    "commonroad-io": "commonroad",
    "commonroad-drivability-checker": "commonroad_dc",
    "pillow": "PIL",
    "pyyaml": "yaml",
}
# the checker imports the first two for the cost and the vehicle: pinned here, since verdicts depend
# on them; then the converter's program, and solvers behind qpsolvers
INDIRECT = {
    *("commonroad_clcs", "commonroad_vehicle_models", "eclipse_sumo"),
    *("clarabel", "proxsuite"),
}


def _declared() -> set[str]:
    """Import names of the dependencies, and of the extras that the package itself imports."""
    tools = "extra == .(dev|notebook)"
    lines = [line for line in requires("mpcplan") or [] if not re.search(tools, line)]
    names = {re.split(r"[^A-Za-z0-9_.-]", line)[0].lower() for line in lines}
    return {MODULES.get(name, name.replace("-", "_")) for name in names}


def _imported(path: Path) -> set[str]:
    """Third-party modules that a file imports anywhere."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add((node.module or "").split(".")[0])
    return found - set(sys.stdlib_module_names) - {"mpcplan"}


def _blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def _commands(path: Path) -> list[list[str]]:
    """Arguments of all calls of mpcplan in a document's console blocks."""
    lines = "\n".join(_blocks(path.read_text(encoding="utf-8"), "console")).splitlines()
    calls = [part for line in lines for part in line.removeprefix("$ ").split(" && ")]
    return [shlex.split(call)[1:] for call in calls if call.startswith("mpcplan ")]


def test_versions_agree():
    newest = re.search(r"^## \[(\d[^]]*)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest is not None
    assert version("mpcplan") == mpcplan.__version__ == newest.group(1)


def test_dependencies_are_what_is_imported():
    imported = set().union(*map(_imported, SOURCES))
    assert imported == _declared() - INDIRECT


@pytest.mark.parametrize("name", mpcplan.__all__)
def test_public_names_are_there_and_described(name):
    assert getattr(mpcplan, name).__doc__


def test_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="nonsense"):
        _ = mpcplan.nonsense


def test_import_is_light():
    code = "import sys, mpcplan, mpcplan.cli; print(sorted(set(sys.modules) & set(sys.argv[1:])))"
    heavy = ["numpy", "casadi", "osqp", "scipy", "shapely", "matplotlib", "commonroad", "rtamt"]
    done = subprocess.run(
        [sys.executable, "-c", code, *heavy], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_package_is_typed():
    assert (Path(mpcplan.__file__).parent / "py.typed").is_file()


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(path):
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", path.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (path.parent / target).exists(), target


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_anchors_within_a_document_exist(path):
    text = path.read_text(encoding="utf-8")
    heads = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    known = {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}
    assert set(re.findall(r"\]\(#([^)]+)\)", text)) <= known


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_in_documents_are_understood(path):
    for call in _commands(path):
        args = parser().parse_args(call)
        config = getattr(args, "config", None)
        assert config is None or (ROOT / config).is_file()
        scenario = getattr(args, "scenario", None)
        assert scenario is None or scenario.name.isupper() or (ROOT / scenario).exists()


def test_all_commands_are_in_the_readme():
    for name in ("solve", "evaluate", "bench", "compare", "config"):
        assert f"`mpcplan {name}" in README


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_parameters_in_documents_exist(path):
    sections = "|".join(Config.model_fields)
    text = path.read_text(encoding="utf-8")
    for section, key in re.findall(rf"(?:`|--set |\")({sections})\.([a-z_]+)(?=[`=])", text):
        assert key in getattr(Config(), section).model_dump(), f"{section}.{key}"


def test_every_column_and_status_is_documented():
    text = (ROOT / "docs" / "benchmark.md").read_text(encoding="utf-8")
    assert [name for name in (*COLUMNS, *STATUSES) if f"`{name}`" not in text] == []


def _keys(value: object) -> set[str]:
    """All keys of nested dictionaries and lists."""
    if isinstance(value, dict):
        return set(value).union(*map(_keys, value.values()))
    return set().union(*map(_keys, value)) if isinstance(value, list) else set()


@pytest.mark.slow
def test_readme_example_runs_and_its_trace_is_documented(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    (code,) = _blocks(README, "python")
    names: dict = {}
    exec(compile(code, "README.md", "exec"), names)
    assert names["run"].solved and names["verdict"].valid
    trace = names["run"].trace()
    json.dumps(trace, allow_nan=False)
    documented = set(re.findall(r"`([^`]+)`", (ROOT / "docs" / "trace.md").read_text()))
    assert _keys({k: v for k, v in trace.items() if k != "config"}) <= documented | {"config"}
