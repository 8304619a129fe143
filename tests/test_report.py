"""The report: what its tables say, and the command as a user calls it."""

import os
import subprocess
import sys
from pathlib import Path

import made_results as made
import pytest

from mpcplan.errors import InputError
from mpcplan.report import coverage, tables
from mpcplan.report.causes import UNKNOWN, causes, kind_of
from mpcplan.report.files import files_of, link
from mpcplan.report.picks import Picks
from mpcplan.report.read import read_all
from mpcplan.report.settings import differences
from mpcplan.report.tables import Table
from mpcplan.report.write import write_report

ROOT = Path(__file__).resolve().parents[1]
MOST_MB = 15.0  # of a page of 1,000 rows
MANY = 1000


@pytest.fixture
def folders(tmp_path):
    return made.two_runs(tmp_path)


@pytest.fixture
def runs(folders):
    return read_all(folders)


def _named(table: Table, row: int = 0) -> dict[str, str]:
    """A row by the names of its columns; of names that are there twice the last."""
    return dict(zip(table.head, table.rows[row], strict=True))


def test_summary_counts_and_averages_valid_solutions_only(runs):
    first, second = (_named(tables.summary(runs), row) for row in (0, 1))
    assert first["run"] == "first" and first["scenarios"] == "5"
    assert first["solved"] == "3 of 5 (60.0 %)" and second["solved"] == "4 of 6 (66.7 %)"
    assert float(first["TR1 mean"]) == pytest.approx(13 / 3, abs=0.01)
    assert float(first["worst"]) == 10 and float(second["worst"]) == 100
    assert float(second["median"]) == 7


def test_maps_have_each_runs_own_scenarios_and_means_where_all_solved(runs):
    table = tables.maps(runs)
    rows = {row[0]: row[1:] for row in table.rows}
    assert list(rows) == ["DEU_Town", "DEU_Village", tables.ALL]
    assert rows["DEU_Town"][0] == "2 of 4" and rows["DEU_Town"][4] == "4 of 5"
    assert rows["DEU_Village"][4:8] == ("0 of 1", *[tables.NOTHING] * 3)
    assert rows["DEU_Village"][-3:] == ("0", tables.NOTHING, tables.NOTHING)
    common, first, second = rows[tables.ALL][-3:]
    assert common == "2" and float(first) == 6.0 and float(second) == 5.5
    assert table.last_is_all and all(len(row) == len(table.head) for row in table.rows)
    assert sum(span for _, span in table.groups) == len(table.head) - 1
    assert table.starts == {1, 5, 9}


def test_a_pair_is_covered_on_the_scenarios_in_common(runs):
    (pair,) = coverage.pairs_of(runs)
    assert pair.both == (made.id_of(1), made.id_of(2))
    assert pair.only_a == (made.id_of(3, "Village"),) and pair.only_b == (made.id_of(4),)
    assert pair.neither == (made.id_of(5),) and pair.common == 5
    assert pair.costs == ((2.0, 1.0), (10.0, 10.0)) and pair.ratios == [0.5, 1.0]
    assert pair.cheaper == (0, 1, 1)
    assert coverage.coverage([pair]).rows == (("first", "second", "5", "2", "1", "1", "1"),)
    row = _named(coverage.costs([pair]))
    assert (row["A cheaper"], row["B cheaper"], row["equal"]) == ("0", "1", "1")
    assert float(row["median of B / A"]) == 0.75 and float(row["A worst"]) == 10


def test_every_two_of_three_runs_are_a_pair(folders, tmp_path):
    other = made.write(tmp_path / "other", [made.solved(made.id_of(9), 1.0)])
    pairs = coverage.pairs_of(read_all([*folders, other]))
    names = [(pair.a, pair.b) for pair in pairs]
    assert names == [("first", "second"), ("first", "other"), ("second", "other")]
    assert [pair.common for pair in pairs] == [5, 0, 0]


@pytest.mark.parametrize(
    ("cause", "kind"),
    [
        ("collided at step 64", ("collided", "")),
        ("problem 12: collided at step 64", ("collided", "")),
        (
            "the goal was not reached at step 165; first fallback at step 138: braking: no plan",
            ("the goal was not reached", "first fallback: braking"),
        ),
        ("needs more than 2000 MB of memory", ("needs more than … MB of memory", "")),
        ("", (UNKNOWN, "")),
    ],
)
def test_causes_that_differ_in_numbers_are_of_one_kind(cause, kind):
    assert kind_of(cause) == kind


def test_causes_are_grouped_over_all_runs_most_frequent_first(tmp_path):
    rows = [made.failed(made.id_of(n), f"collided at step {n}") for n in (1, 2, 3)]
    rows.append(made.failed(made.id_of(4), "off the road at step 3"))
    rows.append(made.failed(made.id_of(5), "collided at step 5", status="late"))
    first = made.write(tmp_path / "first", rows)
    second = made.write(tmp_path / "second", [*rows[:1], made.solved(made.id_of(2), 1.0)])
    found = causes(read_all([first, second]))
    assert [(one.status, one.what, one.count) for one in found] == [
        ("invalid", "collided", 4),
        ("invalid", "off the road", 1),
        ("late", "collided", 1),
    ]
    assert found[0].scenarios == (tuple(map(made.id_of, (1, 2, 3))), (made.id_of(1),))
    assert found[0].example == "collided at step 1"


def test_counts_lead_to_the_rows_that_they_count(runs):
    (pair,) = coverage.pairs_of(runs)
    picks = Picks(runs)
    table = picks.of_pairs(coverage.coverage([pair]), [pair])
    lists = picks.as_lists()
    assert set(table.picks) == {(0, 3), (0, 4), (0, 5), (0, 6)}
    assert lists[table.picks[0, 3]]["rows"] == [0, 1, 5, 6]  # scenarios 1 and 2 in both runs
    assert lists[table.picks[0, 5]]["rows"] == [3, 8]
    told = picks.causes(causes(runs))
    for (row, column), which in told.picks.items():
        assert len(picks.as_lists()[which]["rows"]) == int(told.rows[row][column])


def test_only_differing_parameters_are_told(runs, folders):
    assert differences(runs) is None
    for folder, value in zip(folders, (1, 2), strict=True):
        text = f"drive:\n  replan: {value}\n  steps: 30\n"
        (folder / "config.yaml").write_text(text, encoding="utf-8")
    table = differences(runs)
    assert table is not None and table.rows == (("drive.replan", "1", "2"),)


def test_runs_of_equal_names_are_told_apart(tmp_path):
    rows = [made.solved(made.id_of(1), 1.0)]
    paths = [made.write(tmp_path / above / "run", rows) for above in ("old", "new")]
    assert [run.name for run in read_all(paths)] == ["old/run", "new/run"]
    assert [run.name for run in read_all([paths[0]] * 2)] == ["old/run", "old/run (2)"]
    assert [run.name for run in read_all(paths, ["a", "b"])] == ["a", "b"]
    with pytest.raises(InputError, match="2 different names are needed"):
        read_all(paths, ["a"])


def test_a_table_of_several_planners_is_several_runs(tmp_path):
    rows = [made.solved(made.id_of(1), 1.0), made.solved(made.id_of(1), 2.0, planner="idm")]
    assert [run.name for run in read_all([made.write(tmp_path / "all", rows)])] == [
        "mpcplan",
        "idm",
    ]


def test_files_of_a_run_are_linked_relative_to_the_page(runs, folders, tmp_path):
    name = made.id_of(1)
    picture = folders[0] / "pictures" / f"{name}.png"
    solution = folders[0] / "solutions" / f"solution_KS1:TR1:{name}:2020a.xml"
    for path in (picture, solution):
        path.parent.mkdir(exist_ok=True)
        path.touch()
    found = files_of(runs[0], name)
    assert (found.picture, found.solution, found.trace) == (picture, solution, None)
    assert link(found.picture, tmp_path / "pages" / "r.html") == f"../first/pictures/{name}.png"
    assert ":" not in link(found.solution, folders[0] / "r.html")  # no protocol for a browser


def test_what_the_tables_say_cannot_break_the_page(tmp_path):
    nasty = "</script><script>alert(1)</script>"
    run = made.write(tmp_path / "run", [made.failed(made.id_of(1), nasty)])
    page = tmp_path / "r.html"
    write_report([run], page, title="<b>&")
    text = page.read_text(encoding="utf-8")
    assert nasty not in text and "<script>alert" not in text
    assert "<title>&lt;b&gt;&amp;</title>" in text


def test_runs_without_anything_solved_or_in_common_make_a_page(tmp_path):
    paths = [
        made.write(tmp_path / name, [made.failed(made.id_of(n), "")])
        for n, name in enumerate(("first", "second"))
    ]
    write_report(paths, tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "The runs have no scenario in common." in text
    assert "No scenario is solved with a cost." in text


def test_a_page_of_1000_rows_is_not_too_large(tmp_path):
    long = "the goal was not reached at step 165; first fallback at step 138: braking: no plan"
    rows = [
        made.failed(made.id_of(n), long) if n % 10 == 0 else made.solved(made.id_of(n), 0.01 * n)
        for n in range(MANY)
    ]
    written = write_report([made.write(tmp_path / "run", rows)], tmp_path / "r.html")
    assert len(written.runs[0].entries) == MANY
    size = (tmp_path / "r.html").stat().st_size / 1e6
    assert written.size_mb == pytest.approx(size) and 1.0 < size < MOST_MB


def _call(*args: object) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, "-m", "mpcplan", "report", *map(str, args)], capture_output=True,
        text=True, timeout=120, env={**os.environ, "PYTHONPATH": path}, check=False,
    )  # fmt: skip


def test_the_command_writes_a_page_that_loads_nothing(folders, tmp_path):
    page = tmp_path / "new" / "report.html"
    done = _call(*folders, "--out", page, "--names", "old, new", "--title", "Two runs")
    assert done.returncode == 0 and done.stderr == ""
    lines = done.stdout.splitlines()
    assert lines[:2] == ["old: 5 scenarios, 3 solved", "new: 6 scenarios, 4 solved"]
    assert lines[2].startswith(f"{page} (") and len(lines) == 3
    text = page.read_text(encoding="utf-8")
    assert "<title>Two runs</title>" in text
    assert "<script src" not in text and '<link rel="stylesheet"' not in text


def _broken(folder: Path, content: str | bytes | None) -> Path:
    folder.mkdir()
    if content is not None:
        data = content if isinstance(content, bytes) else content.encode()
        (folder / "results.csv").write_bytes(data)
    return folder


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (None, "has no results.csv"),
        ("", "has no column scenario, valid, TR1"),
        ("scenario,valid\nA,True\n", "has no column TR1"),
        ("scenario,valid,TR1\n", "has no rows"),
        ('scenario,valid,TR1\nA,True,"1.0\n', "is not a CSV table"),
        (b"scenario,valid,TR1\n\xff\xfe,True,1.0\n", "is not a CSV table"),
        ("scenario,valid,TR1\nA,True,1.0,2\n", "line 2: the row has more cells"),
        ("scenario,valid,TR1\nA,True\n", "line 2: the row is incomplete"),
        ("scenario,valid,TR1\nA,True,cheap\n", "line 2: TR1 is 'cheap', not a number"),
        ("scenario,valid,TR1\nA,maybe,1.0\n", "line 2: valid is 'maybe'"),
        ("scenario,valid,TR1\nA,True,1\nA,True,1\n", "line 3: the scenario A is there twice"),
    ],
)
def test_broken_results_are_one_line_and_exit_code_2(content, told, folders, tmp_path):
    page = tmp_path / "r.html"
    done = _call(folders[0], _broken(tmp_path / "broken", content), "--out", page)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1
    assert told in done.stderr and str(tmp_path / "broken") in done.stderr
    assert not page.exists()


def test_a_page_that_cannot_be_written_is_one_line_and_exit_code_2(folders, tmp_path):
    done = _call(*folders, "--out", tmp_path)
    assert done.returncode == 2 and "is a folder: name the file" in done.stderr
    (tmp_path / "file").touch()
    done = _call(*folders, "--out", tmp_path / "file" / "r.html")
    assert done.returncode == 2 and done.stderr.startswith("error: cannot write")
    assert done.stderr.count("\n") == 1
