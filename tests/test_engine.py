"""Engines: attempts in order, shipped scenarios, stopping; and a Dask cluster of two workers."""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path

import fake_worker
import pytest
from dask_cluster import running_cluster

from mpcplan.bench import bench
from mpcplan.bench.attempt import Attempt, Outcome, run_attempt, ship
from mpcplan.bench.engine import LocalEngine, open_engine, run_all
from mpcplan.bench.job import Job, Limits
from mpcplan.bench.process import Processes
from mpcplan.bench.store import empty_row
from mpcplan.errors import InputError, MpcplanError

BUNDLED = Path(__file__).parents[1] / "scenarios"


def _scenario(folder: Path, name: str) -> Path:
    path = folder / f"{name}.xml"
    path.write_text(f"<commonRoad benchmarkID='{name}'/>")
    return path


def _attempt(scenario: Path, command, timeout_s: float = 60.0, kind: str = "recorded") -> Attempt:
    limits = Limits(timeout_s, 4000.0)
    return Attempt(
        scenario.stem, scenario.stem, scenario, kind, "a: 1\n", limits=limits, command=command
    )


@pytest.fixture
def notes(tmp_path: Path) -> Path:
    path = tmp_path / "notes"
    path.mkdir()
    return path


class _Instant:
    """An engine that has every outcome at once, except those named 'wait'."""

    slots = 2

    def __init__(self) -> None:
        self.submitted: list[str] = []
        self.stops = 0

    def submit(self, attempt: Attempt) -> "Future[Outcome]":
        self.submitted.append(attempt.name)
        future: Future[Outcome] = Future()
        if attempt.name != "wait":
            row = empty_row(attempt.name)
            future.set_result(Outcome(attempt.name, row, {}, b"", False, attempt.limits))
        return future

    def stop(self) -> None:
        self.stops += 1

    def close(self) -> None:
        self.stop()


def _attempts(*names: str) -> Iterator[Attempt]:
    return (Attempt(name, name, Path(name), "recorded", "") for name in names)


def test_no_more_attempts_are_taken_than_there_are_slots():
    engine, names = _Instant(), iter(("wait", "a", "b", "c"))
    taken = []

    def next_attempt() -> Attempt | None:
        name = next(names, None)
        taken.append(name)
        return None if name is None else next(_attempts(name))

    outcomes = run_all(engine, next_attempt, lambda: len(engine.submitted) == 4)
    assert next(outcomes).name == "a" and taken == ["wait", "a"]
    assert [outcome.name for outcome in (next(outcomes), next(outcomes))] == ["b", "c"]
    outcomes.close()
    assert engine.stops == 1


def test_an_exception_of_the_caller_stops_the_engine():
    engine, attempts = _Instant(), _attempts("a", "wait")
    outcomes = run_all(engine, lambda: next(attempts, None))
    next(outcomes)
    with pytest.raises(ZeroDivisionError):
        outcomes.throw(ZeroDivisionError())
    assert engine.stops == 1


def test_attempts_put_back_after_the_last_outcome_are_taken():
    engine, names = _Instant(), ["a"]
    outcomes = run_all(engine, lambda: next(_attempts(names.pop())) if names else None)
    assert next(outcomes).name == "a"
    names.append("again")
    assert next(outcomes).name == "again"
    assert list(outcomes) == []


def test_stop_ends_running_processes_and_gives_their_outcomes(tmp_path, notes):
    engine, stop = LocalEngine(2), threading.Event()
    names = ("ZAM_hang-1", "ZAM_candidatehang-1", "ZAM_hang-2")
    attempts = iter([_attempt(_scenario(tmp_path, n), fake_worker.command(notes)) for n in names])
    threading.Timer(1.5, stop.set).start()
    outcomes = {o.name: o for o in run_all(engine, lambda: next(attempts, None), stop.is_set)}
    engine.close()
    assert set(outcomes) == set(names[:2]) and all(o.stopped for o in outcomes.values())
    candidate = outcomes["ZAM_candidatehang-1"]
    assert candidate.row["status"] == "unjudged" and len(candidate.files) == 1
    assert not any(map(fake_worker.alive, fake_worker.pids(notes)))


def test_what_cannot_be_started_is_a_row(tmp_path):
    scenario = _scenario(tmp_path, "ZAM_a-1")
    outcome = run_attempt(_attempt(scenario, lambda job: ["/no/such/program"]), Processes())
    assert outcome.row["status"] == "aborted" and "No such file" in outcome.row["cause"]


COPY = """
import json, shutil, sys
from pathlib import Path
from mpcplan.bench.store import empty_row
scenario, out, row = map(Path, sys.argv[1:4])
copy = shutil.copytree if scenario.is_dir() else shutil.copy
copy(scenario, out / "copy")
Path(out, ".half").write_text("")
cells = empty_row("x", "bad_input", f"{scenario}: of a test")
row.write_text(json.dumps(cells))
"""


def _copy(job: Job) -> list[str]:
    return [sys.executable, "-c", COPY, str(job.scenario), str(job.out), str(job.row)]


def test_shipped_scenarios_are_read_where_they_are_not(tmp_path):
    folder = tmp_path / "gone" / "ZAM_a-1_1_I-1"
    (folder / "deep").mkdir(parents=True)
    file = _scenario(tmp_path / "gone", "ZAM_b-1")
    for name in ("a.cr.xml", "a.net.xml", "deep/er.xml"):
        (folder / name).write_text(name)
    shipped = [ship(_attempt(file, _copy)), ship(_attempt(folder, _copy, kind="interactive"))]
    (tmp_path / "gone").rename(tmp_path / "elsewhere")
    outcomes = [run_attempt(attempt, Processes()) for attempt in shipped]
    assert dict(outcomes[0].files) == {"copy": b"<commonRoad benchmarkID='ZAM_b-1'/>"}
    assert dict(outcomes[1].files) == {
        f"copy/{name}": name.encode() for name in ("a.cr.xml", "a.net.xml", "deep/er.xml")
    }
    assert outcomes[0].row["cause"] == f"{file}: of a test"  # the path that the user knows


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("local", "tcp://127.0.0.1:1"), "belong together"),
        (("dask", None), "belong together"),
        (("grid", None), "no engine 'grid'"),
        (("local", None, 0), "positive"),
    ],
)
def test_engines_that_cannot_be(arguments, words):
    with pytest.raises(InputError, match=words):
        open_engine(*arguments)


def test_dask_that_is_not_installed_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'mpcplan\[dask\]'"):
        open_engine("dask", "tcp://127.0.0.1:1")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "no address", "tcp://"])
def test_dask_that_does_not_answer_is_named(monkeypatch, address, capfd):
    pytest.importorskip("distributed", reason="the extra dask is not installed")
    monkeypatch.setattr("mpcplan.bench.dask_engine.CONNECT_S", 1.0)
    with pytest.raises(InputError, match=f"no Dask scheduler answers at {address}"):
        open_engine("dask", address)
    assert capfd.readouterr() == ("", "")


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    pytest.importorskip("distributed", reason="the extra dask is not installed")
    with running_cluster(tmp_path_factory.mktemp("cluster"), 2) as made:
        yield made


@pytest.mark.slow
def test_dask_gives_what_local_processes_give(cluster, tmp_path):
    names = ("ZAM_FreeRoad-1_1_T-1", "ZAM_TimeOnly-1_1_T-1")
    paths = [BUNDLED / f"{name}.xml" for name in names]
    bench(paths, tmp_path / "here", 2)
    engine = open_engine("dask", cluster.address)
    assert engine.slots == 2
    _, rows = bench(paths, tmp_path / "there", engine=engine)
    assert [row["status"] for row in rows] == ["solved", "solved"]
    for kind in ("solutions", "traces"):
        here, there = (sorted((tmp_path / x / kind).iterdir()) for x in ("here", "there"))
        assert [file.name for file in here] == [file.name for file in there]
        if kind == "solutions":  # traces hold times
            assert [file.read_bytes() for file in here] == [file.read_bytes() for file in there]


@pytest.mark.slow
def test_limits_and_failures_on_dask(cluster, tmp_path, notes):
    names = ("good", "segfault", "hang", "memory", "candidatehang")
    folder = tmp_path / "scenarios"
    folder.mkdir()
    for name in names:
        _scenario(folder, f"ZAM_{name}-1")
    engine = open_engine("dask", cluster.address)
    command = fake_worker.command(notes)
    _, rows = bench([folder], tmp_path / "out", timeout_s=3, memory_mb=2000, engine=engine,
                    command=command)  # fmt: skip
    assert {row["cluster"][4:]: row["status"] for row in rows} == {
        "good": "solved", "segfault": "crash", "hang": "timeout", "memory": "memory",
        "candidatehang": "unjudged",
    }  # fmt: skip
    assert len(fake_worker.started(notes)) == len(names)


@pytest.mark.slow
def test_stopping_ends_the_processes_on_the_cluster(cluster, tmp_path, notes):
    attempts = iter(
        [_attempt(_scenario(tmp_path, f"ZAM_hang-{i}"), fake_worker.command(notes)) for i in "123"]
    )
    engine = open_engine("dask", cluster.address)
    outcomes = list(
        run_all(engine, lambda: next(attempts, None), lambda: len(fake_worker.started(notes)) == 2)
    )
    engine.close()
    assert len(outcomes) == 2 and all(outcome.stopped for outcome in outcomes)
    assert not any(map(fake_worker.alive, fake_worker.pids(notes)))


@pytest.mark.slow
def test_a_cluster_worker_that_dies_costs_nothing(cluster, tmp_path, notes):
    scenario = _scenario(tmp_path, "ZAM_later-1")  # hangs at first, is solved the second time
    engine = open_engine("dask", cluster.address)
    rows: list[dict] = []
    run = threading.Thread(
        target=lambda: rows.extend(
            bench([scenario], tmp_path / "out", engine=engine, command=fake_worker.command(notes))[
                1
            ]
        )
    )
    run.start()
    fake_worker.until(lambda: fake_worker.started(notes))
    first = fake_worker.pids(notes)[0]
    parent = int(Path(f"/proc/{first}/stat").read_text().rpartition(")")[2].split()[1])
    os.kill(parent, signal.SIGKILL)
    run.join(timeout=60)
    assert [row["status"] for row in rows] == ["solved"]
    assert fake_worker.started(notes) == ["ZAM_later-1"] * 2
    fake_worker.until(lambda: not fake_worker.alive(first))  # it had nobody to limit it


@pytest.mark.slow
def test_a_cluster_that_goes_away_is_an_error(tmp_path, notes):
    pytest.importorskip("distributed", reason="the extra dask is not installed")
    with running_cluster(tmp_path, 1) as made:
        engine = open_engine("dask", made.address)
        attempts = iter([_attempt(_scenario(tmp_path, "ZAM_hang-1"), fake_worker.command(notes))])
        threading.Timer(2.0, made.end).start()
        start = time.monotonic()
        with pytest.raises(MpcplanError, match=r"Dask cluster at tcp.* failed"):
            list(run_all(engine, lambda: next(attempts, None)))
        engine.close()
    assert time.monotonic() - start < 60
    fake_worker.until(lambda: not any(map(fake_worker.alive, fake_worker.pids(notes))))
