"""The documentation's code runs as it stands on the pages; the site builds without a warning."""

import importlib.util
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import mpcplan

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
HOW_TO = ("howto/predictor.md", "howto/seed_source.md", "howto/qp_backend.md")
WITH_CODE = ("index.md", "planners.md", "trace.md", *HOW_TO)
BEFORE = {  # what must have been run for the code of a page
    "trace.md": "mpcplan solve scenarios/ZAM_TJunction-1_1_T-1.xml",
}
ENDS = {"planners.md": 1}  # exit codes of commands: the example there hits who drives slower
RUN = ("mpcplan solve", "mpcplan bench-solvers")  # the commands that are run; others take too long
SECONDS = 500
BLOCK = re.compile(r'^```(python|yaml|console)(?: title="([^"]+)")?\n(.*?)^```$', re.M | re.S)
SITE = importlib.util.find_spec("mkdocs") is not None


def blocks(page: str) -> list[tuple[str, str, str]]:
    """Language, title ('' for none) and code of a page's blocks."""
    return BLOCK.findall((DOCS / page).read_text(encoding="utf-8"))


def run(call: list[str], folder: Path, code: int = 0) -> str:
    """What a command in a folder prints; the package is the one that is tested."""
    place = str(Path(mpcplan.__file__).parents[1])
    done = subprocess.run(
        call, cwd=folder, capture_output=True, text=True, timeout=SECONDS,
        env={"PYTHONPATH": place, "MPLBACKEND": "Agg", "PATH": "/usr/bin:/bin",
             "HOME": str(folder)},
    )  # fmt: skip
    assert done.returncode == code, f"{shlex.join(call)}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def as_module(command: str) -> list[str]:
    return [sys.executable, "-m", *shlex.split(command)]


def test_all_pages_with_python_are_tested():
    pages = {str(path.relative_to(DOCS)) for path in DOCS.rglob("*.md")}
    assert {page for page in pages if any(b[0] == "python" for b in blocks(page))} == {*WITH_CODE}


@pytest.mark.parametrize("page", WITH_CODE)
def test_python_is_well_formed(page):
    for language, title, code in blocks(page):
        if language == "python":
            compile(code, title or page, "exec")


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_CODE)
def test_page_works_step_by_step(page, tmp_path):
    """Files are written as titled, commands run, and then the code, as a newcomer would."""
    for name in ("scenarios", "configs"):
        (tmp_path / name).symlink_to(ROOT / name)
    if page in BEFORE:
        run(as_module(BEFORE[page]), tmp_path)
    printed, code = [], []
    for language, title, text in blocks(page):
        if title:
            (tmp_path / title).write_text(text, encoding="utf-8")
        elif language == "python":
            code.append(text)
    for language, _, text in blocks(page):
        for line in text.splitlines() if language == "console" else ():
            command = line.removeprefix("$ ")
            if command.startswith(RUN) and not re.search(r"\b[A-Z]{4,}\b", command):
                printed.append(run(as_module(command), tmp_path, ENDS.get(page, 0)))
    (tmp_path / "page.py").write_text("\n".join(code), encoding="utf-8")
    printed.append(run([sys.executable, "page.py"], tmp_path))
    assert all(printed)
    if page in HOW_TO:
        assert "solved, valid" in printed[0]


# ---------------------------------------------------------------- the site


def hook():
    """The module of the site's own steps."""
    spec = importlib.util.spec_from_file_location("site_hook", DOCS / "hooks" / "site.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.skipif(not SITE, reason="needs the extra 'docs'")
def test_every_module_is_in_the_reference():
    site = hook()
    shown = {
        name for _, packages in site.API.values() for p in packages for name in site.modules(p)
    }
    folder = ROOT / "mpcplan"
    parts = (path.relative_to(ROOT).with_suffix("").parts for path in folder.rglob("*.py"))
    known = {".".join(part[:-1] if part[-1] == "__init__" else part) for part in parts}
    left_out = {name for name in known if name.split(".")[-1] in site.NOT_IN_API or ".cli" in name}
    assert known - left_out == shown


@pytest.mark.skipif(not SITE, reason="needs the extra 'docs'")
def test_formulas_become_mathml_and_a_broken_one_is_named():
    site = hook()
    made = site.on_page_content(r'<div class="arithmatex">\[\frac{a}{b} &lt; 1\]</div>')
    assert made.startswith("<math") and 'display="block"' in made and "<mfrac>" in made
    made = site.on_page_content(
        r'<div class="arithmatex">\[\begin{aligned} a &amp;= b \\ c &amp;= d \end{aligned}\]</div>'
    )
    assert made.count("<mtr>") == 2 and "&amp;" not in made and "columnalign" not in made
    for broken, words in ((r"a_b_c", "DoubleSubscript"), (r"\alhpa", "unknown: .*alhpa")):
        with pytest.raises(Exception, match=f"formula .*{words}"):
            site.on_page_content(rf'<span class="arithmatex">\({broken}\)</span>')


@pytest.mark.slow
@pytest.mark.skipif(not SITE, reason="needs the extra 'docs'")
def test_site_builds_without_a_warning_and_needs_no_network(tmp_path):
    call = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", tmp_path]
    done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, timeout=SECONDS)
    assert done.returncode == 0, done.stderr
    pages = list(tmp_path.rglob("*.html"))
    assert len(pages) > 40
    for page in pages:
        text = page.read_text(encoding="utf-8")
        fetched = r'<(?:script|img|link|iframe)[^>]+(?:src|href)="(?:https?:)?//'
        assert not re.search(fetched, text), page
        assert "arithmatex" not in text and not re.search(r":(class|func|mod|data):`", text), page
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        assert (tmp_path / "notebooks" / f"{path.stem}.html").is_file()
    reference = (tmp_path / "api" / "predict.html").read_text(encoding="utf-8")
    assert 'id="mpcplan.predict.lane_follow.LaneFollow"' in reference
