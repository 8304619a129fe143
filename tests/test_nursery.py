"""The nursery: workers forked by a loaded process behave as those started as programs."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import fake_worker
import pytest

from mpcplan.bench import bench
from mpcplan.bench.child import Nursery
from mpcplan.bench.job import WORKER, Job, worker_command
from mpcplan.bench.process import Processes

BUNDLED = Path(__file__).parents[1] / "scenarios"
SCENARIO = BUNDLED / "ZAM_FreeRoad-1_1_T-1.xml"


def _as_program(job: Job) -> list[str]:
    """The same worker, as a command that no nursery takes."""
    arguments = worker_command(job)[len(WORKER) :]
    code = f"from mpcplan.bench.worker import main; main({arguments!r})"
    return [sys.executable, "-c", code]


def _run(processes: Processes, folder: Path, name: str, timeout_s: float = 60.0):
    """One run of the worker, which hangs or fails as its name says."""
    config = folder / ("hang.yaml" if "hang" in name else "config.yaml")
    job = Job(name, folder / name, folder / "out", folder / f"{name}.json", config)
    return processes.run(worker_command(job), folder, folder / f"{name}.log", timeout_s, 4000.0)


@pytest.fixture
def hanging(tmp_path: Path) -> Path:
    """With a configuration that the worker never finishes reading: nobody writes to that pipe."""
    (tmp_path / "out").mkdir()
    (tmp_path / "config.yaml").write_text("")
    (tmp_path / "hang.xml").write_text("")
    os.mkfifo(tmp_path / "hang.yaml")
    return tmp_path


def _started(processes: Processes) -> int:
    fake_worker.until(lambda: processes._running)
    return next(iter(processes._running))


@pytest.mark.slow
def test_forked_workers_give_the_bytes_of_programs(tmp_path):
    _, forked = bench([SCENARIO], tmp_path / "forked")
    _, apart = bench([SCENARIO], tmp_path / "apart", command=_as_program)
    assert [row["status"] for row in (*forked, *apart)] == ["solved", "solved"]
    here, there = (
        next((tmp_path / x / "solutions").iterdir()).read_bytes() for x in ("forked", "apart")
    )
    assert here == there


def test_one_nursery_serves_one_worker_after_another(hanging):
    processes = Processes()
    (hanging / "broken.xml").write_text("<commonRoad")
    first = _run(processes, hanging, "broken.xml")
    nursery = processes._idle[0]
    second = _run(processes, hanging, "broken.xml")
    assert (first.code, second.code) == (0, 0) and processes._idle == [nursery]
    assert "bad_input" in (hanging / "broken.xml.json").read_text()
    assert second.wall_s < 5.0 and first.peak_mb > 50
    processes.stop()
    assert not fake_worker.alive(nursery._process.pid)


def test_a_killed_worker_leaves_the_nursery_alive(hanging):
    processes = Processes()
    killer = threading.Thread(target=lambda: os.kill(_started(processes), signal.SIGKILL))
    killer.start()
    end = _run(processes, hanging, "hang.xml")
    assert end.code == -signal.SIGKILL and not end.timed_out
    assert len(processes._idle) == 1
    processes.stop()


def test_a_forked_worker_ends_at_its_time_limit_and_says_where(hanging):
    processes = Processes()
    end = _run(processes, hanging, "hang.xml", timeout_s=1.0)
    assert end.timed_out and end.code == -signal.SIGTERM
    assert "before the drive" in (hanging / "hang.xml.json").read_text()
    processes.stop()


def test_a_nursery_that_dies_takes_its_worker_with_it_and_is_replaced(hanging):
    processes, workers = Processes(), []

    def kill() -> None:
        workers.append(_started(processes))
        parent = Path(f"/proc/{workers[0]}/stat").read_text().rpartition(")")[2].split()[1]
        os.kill(int(parent), signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    end = _run(processes, hanging, "hang.xml")
    killer.join()
    assert end.code == -signal.SIGKILL and processes._idle == []
    fake_worker.until(lambda: not fake_worker.alive(workers[0]))
    (hanging / "broken.xml").write_text("<commonRoad")
    assert _run(processes, hanging, "broken.xml").code == 0
    processes.stop()


def test_a_nursery_that_died_while_nobody_needed_it_is_replaced(hanging):
    processes = Processes()
    (hanging / "broken.xml").write_text("<commonRoad")
    assert _run(processes, hanging, "broken.xml").code == 0
    first = processes._idle[0]
    os.kill(first._process.pid, signal.SIGKILL)
    fake_worker.until(lambda: not fake_worker.alive(first._process.pid))
    assert _run(processes, hanging, "broken.xml").code == 0
    assert processes._idle != [first]
    processes.stop()


def test_a_nursery_that_cannot_start_is_told(hanging, monkeypatch):
    monkeypatch.setattr("mpcplan.bench.child._NURSERY", (sys.executable, "-c", "raise SystemExit"))
    with pytest.raises(OSError, match="the process that starts the workers has died"):
        _run(Processes(), hanging, "hang.xml")


def test_stopping_while_a_nursery_loads_starts_nothing(hanging, monkeypatch):
    loading = (sys.executable, "-c", "import time; time.sleep(600)")
    monkeypatch.setattr("mpcplan.bench.child._NURSERY", loading)
    processes = Processes()

    def stop() -> None:
        fake_worker.until(lambda: processes._loading)
        processes.stop()

    stopper = threading.Thread(target=stop)
    stopper.start()
    begun = time.monotonic()
    with pytest.raises(InterruptedError):
        _run(processes, hanging, "hang.xml")
    stopper.join()
    assert time.monotonic() - begun < 60 and processes._running == set()


def test_worker_and_nursery_end_with_their_parent(hanging):
    code = (
        "import sys; from pathlib import Path; sys.path.insert(0, sys.argv[2])\n"
        "from test_nursery import _run; from mpcplan.bench.process import Processes\n"
        "import threading, test_nursery as t; p = Processes()\n"
        "threading.Thread(target=_run, args=(p, Path(sys.argv[1]), 'hang.xml'), daemon=True)"
        ".start()\n"
        "print(t._started(p), flush=True); import time; time.sleep(600)\n"
    )
    command = [sys.executable, "-c", code, str(hanging), str(Path(__file__).parent)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        worker = int(parent.stdout.readline())
        above = int(Path(f"/proc/{worker}/stat").read_text().rpartition(")")[2].split()[1])
        parent.kill()
    for pid in (worker, above):
        fake_worker.until(lambda pid=pid: not fake_worker.alive(pid))


def test_closing_twice_does_no_harm():
    nursery = Nursery()
    nursery.ready()
    assert nursery.alive
    nursery.close()
    nursery.close()
    assert not nursery.alive
