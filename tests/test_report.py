"""The report: its tables by hand, the command as a user runs it, and the page in a browser."""

import csv
import json
import re
import shutil
from pathlib import Path

import pytest

from mpcplan.cli import main
from mpcplan.report.causes import UNKNOWN, causes, kind_of
from mpcplan.report.coverage import costs, coverage, pairs_of
from mpcplan.report.read import read_all

HEAD = [
    "scenario", "cluster", "planner", "kind", "status", "valid", "TR1", "Jlon", "SR", "D", "LC",
    "R_G1", "R_G1_kept", "plan_p50_ms", "plan_p95_ms", "plan_max_ms", "cause",
]  # fmt: skip
MEGA = 1e6
LARGEST = 15 * MEGA  # bytes, of a page of 1,000 rows
COLLIDED = "collided at step 64; first fallback at step 12: the seed is driven: search, refined: x"


def row(scenario: str, tr1: float | None, cause: str = "", **others: object) -> dict[str, object]:
    """A row of results.csv, valid where there is a cost."""
    valid = tr1 is not None
    return {
        "scenario": scenario, "cluster": scenario.split("-")[0], "planner": "mpcplan",
        "kind": "recorded", "status": "solved" if valid else "not_solved", "valid": valid,
        "TR1": tr1 if valid else "", "Jlon": 1.0, "SR": 2.0, "D": 0.5, "LC": 0.1, "R_G1": 1.5,
        "R_G1_kept": "kept", "plan_p50_ms": 10.0, "plan_p95_ms": 20.0, "plan_max_ms": 90.0,
        "cause": cause, **others,
    }  # fmt: skip


def written(folder: Path, rows: list[dict[str, object]], head: list[str] = HEAD) -> Path:
    """A folder of results with a table."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "results.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, head, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    return folder


@pytest.fixture
def two(tmp_path) -> list[Path]:
    """Two runs: one solved by both, one by each alone, one by neither, and one that B lacks."""
    first = [
        row("ZAM_One-1_1_T-1", 2.0), row("ZAM_One-2_1_T-1", 4.0),
        row("DEU_Two-1_1_T-1", None, COLLIDED), row("DEU_Two-2_1_T-1", None),
        row("DEU_Two-3_1_T-1", 9.0),
    ]  # fmt: skip
    second = [
        row("ZAM_One-1_1_T-1", 1.0), row("ZAM_One-2_1_T-1", None, COLLIDED.replace("64", "9")),
        row("DEU_Two-1_1_T-1", 7.0), row("DEU_Two-2_1_T-1", None),
    ]  # fmt: skip
    return [written(tmp_path / "alpha", first), written(tmp_path / "beta", second)]


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    """Exit code and everything that a command says."""
    code = main([str(argument) for argument in arguments])
    out = capsys.readouterr()
    return code, out.out + out.err


# -- tables ---------------------------------------------------------------------------------------


def test_two_runs_against_each_other(two):
    (pair,) = pairs_of(read_all(two))
    assert (pair.both, pair.only_a) == (("ZAM_One-1_1_T-1",), ("ZAM_One-2_1_T-1",))
    assert (pair.only_b, pair.neither) == (("DEU_Two-1_1_T-1",), ("DEU_Two-2_1_T-1",))
    assert pair.common == 4 and pair.costs == ((2.0, 1.0),) and pair.cheaper == (0, 1, 0)
    assert coverage([pair]).rows == (("alpha", "beta", "4", "1", "1", "1", "1"),)
    (line,) = costs([pair]).rows
    assert line[:5] == ("alpha", "beta", "1", "2.00", "1.00") and "0.500" in line


def test_equal_costs_are_nobodys():
    runs = [
        type("Run", (), {"name": name, "by_scenario": {"a": entry}})
        for name, entry in (("x", _entry(3.0)), ("y", _entry(3.0 + 1e-9)))
    ]
    assert pairs_of(runs)[0].cheaper == (0, 0, 1)


def _entry(tr1: float) -> object:
    return type("Entry", (), {"valid": True, "numbers": {"TR1": tr1}})


def test_causes_of_one_kind_are_together(two):
    found = causes(read_all(two))
    kinds = {(one.what, one.before): one.scenarios for one in found}
    assert kinds[("collided", "first fallback: the seed is driven")] == (
        ("DEU_Two-1_1_T-1",), ("ZAM_One-2_1_T-1",),
    )  # fmt: skip
    assert kinds[(UNKNOWN, "")] == (("DEU_Two-2_1_T-1",), ("DEU_Two-2_1_T-1",))
    assert [one.count for one in found] == [2, 2]


@pytest.mark.parametrize(
    ("cause", "kind"),
    [
        ("the goal was not reached at step 165", ("the goal was not reached", "")),
        (
            "problem 12: collided at step 3; no plan reached the goal: 5 of 9 candidates",
            ("collided", "no plan reached the goal"),
        ),
        (
            "the scenario has no solution: its start is off the road by 0.1 m^2; on_road: x",
            ("the scenario has no solution: its start is off the road", ""),
        ),
        ("", (UNKNOWN, "")),
    ],
)
def test_kinds_of_causes(cause, kind):
    assert kind_of(cause) == kind


# -- command --------------------------------------------------------------------------------------


def test_the_command_writes_a_page_of_its_own(two, tmp_path, capsys):
    out = tmp_path / "deep" / "report.html"
    code, text = told(capsys, "report", *two, "--out", out)
    assert code == 0 and "alpha: 5 scenarios, 3 solved" in text and "beta: 4 scenarios" in text
    page = out.read_text(encoding="utf-8")
    bare = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert "<h1>" in bare and not re.search(r'(src|href)="(https?:)?//', bare)  # nothing from afar
    data = json.loads(re.search(r'id="table-data">(.*?)</script>', page, re.DOTALL)[1])
    assert len(data["rows"]) == 9
    told_again, _ = told(capsys, "report", *two, "--out", tmp_path / "again.html")
    assert told_again == 0
    assert len((tmp_path / "again.html").read_bytes()) == len(out.read_bytes())


def test_names_and_title(two, tmp_path, capsys):
    out = tmp_path / "r.html"
    code, text = told(
        capsys, "report", *two, "--out", out, "--names", "ours,theirs", "--title", "A <test>"
    )
    assert code == 0 and "ours: 5" in text and "theirs: 4" in text
    assert "<title>A &lt;test&gt;</title>" in out.read_text(encoding="utf-8")
    code, text = told(capsys, "report", *two, "--out", out, "--names", "one")
    assert code == 2 and "2 different names are needed" in text and text.count("\n") == 1


def test_what_is_wrong_is_told_in_one_line(two, tmp_path, capsys):
    out = tmp_path / "r.html"
    (tmp_path / "empty").mkdir()
    lacking = written(tmp_path / "lacking", [row("a", 1.0)], ["scenario", "valid"])
    odd = written(tmp_path / "odd", [row("a", 1.0, plan_p50_ms="fast")])
    twice = written(tmp_path / "twice", [row("a", 1.0), row("a", 2.0)])
    binary = tmp_path / "binary"
    binary.mkdir()
    (binary / "results.csv").write_bytes(b"\xff\xfe\x00")
    for folder, words in (
        (tmp_path / "none", "none"), (tmp_path / "empty", "results.csv"), (lacking, "TR1"),
        (odd, "plan_p50_ms"), (twice, "twice"), (binary, "results.csv"),
    ):  # fmt: skip
        code, text = told(capsys, "report", folder, "--out", out)
        assert code == 2 and words in text and text.count("\n") == 1, text
        assert "Traceback" not in text and not out.exists()
    code, text = told(capsys, "report", two[0], "--out", tmp_path)
    assert code == 2 and "is a folder" in text


def test_a_thousand_rows_stay_small(tmp_path, capsys):
    rows = [row(f"ZAM_Many-{i}_1_T-1", 0.01 * i or None, COLLIDED) for i in range(1000)]
    out = tmp_path / "r.html"
    code, _ = told(capsys, "report", written(tmp_path / "many", rows), "--out", out)
    assert code == 0 and MEGA < out.stat().st_size < LARGEST


# -- browser --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def browser():
    """A Chromium of the machine, without a window."""
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        pytest.skip("there is no Chromium on this machine")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as driver:
        flags = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        started = driver.chromium.launch(executable_path=program, args=flags)
        yield started
        started.close()


@pytest.mark.slow
def test_the_page_in_a_browser(two, tmp_path, capsys, browser):
    """Sorts, filters, picks and opens a row; the console stays silent and the network unused."""
    out = tmp_path / "r.html"
    assert told(capsys, "report", *two, "--out", out)[0] == 0
    page = browser.new_page(viewport={"width": 1366, "height": 768})
    said, asked = [], []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(out.as_uri())
    page.wait_for_selector("html[data-table=ready]")

    def scenarios() -> list[str]:
        return page.locator("#rows .open-row").all_inner_texts()

    assert len(scenarios()) == 9 and "9 of 9 rows" in page.inner_text("#count")
    head = page.locator("#rows th button", has_text=re.compile("^TR1$"))
    head.click()
    assert scenarios()[0] == "ZAM_One-1_1_T-1" and scenarios()[4] == "DEU_Two-3_1_T-1"
    assert head.locator("..").get_attribute("aria-sort") == "ascending"
    head.click()
    assert scenarios()[0] == "DEU_Two-3_1_T-1"  # the dearest; those without a cost stay last
    page.fill("#search", "collided")
    assert sorted(scenarios()) == ["DEU_Two-1_1_T-1", "ZAM_One-2_1_T-1"]
    page.click("#clear")
    page.select_option("select[data-column=status]", "not_solved")
    assert len(scenarios()) == 4
    page.click("#clear")
    page.locator(".pick").first.click()  # the scenarios solved by both
    assert set(scenarios()) == {"ZAM_One-1_1_T-1"}
    page.locator("#rows .open-row").first.click()
    assert "There is no picture of this run." in page.inner_text("#rows .detail")
    page.locator("#against, #costs, [data-figure='0']").first.scroll_into_view_if_needed()
    page.wait_for_selector("[data-figure='0'] svg.main-svg")
    assert said == [] and all(url.startswith(("file:", "data:", "blob:")) for url in asked)
    page.close()
