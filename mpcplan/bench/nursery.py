"""The nursery: a process that has loaded everything and forks one worker after another.

Usage: python -m mpcplan.bench.nursery

It is spoken to in JSON lines over its standard input and output, and works on one request at a
time. After ``{"ready": true}``:

    -> {"arguments": [...], "scratch": FOLDER, "log": FILE}    start a worker
    <- {"pid": ...}, or {"error": why not}
    <- {"ended": true}                                         it has ended and keeps its id
    -> {}                                                      its id is needed no more
    <- {"code": ..., "peak_mb": ...}

It has one thread only, and so have the libraries that it loads, which makes forking safe. It ends
with its standard input.
"""

import gc
import importlib
import json
import os
import signal
import sys
import tempfile
import traceback
from contextlib import suppress
from typing import Any, TextIO

LOADED = (
    "mpcplan.bench.worker",
    "mpcplan.bench.candidate",
    "mpcplan.config.files",
    "mpcplan.scenario",
    "mpcplan.simulate.loop",
    "mpcplan.simulate.rules",
    "rtamt",
    "mpcplan.sumo.traffic",
    "mpcplan.score.judge",
    "mpcplan.score.locate",
    "mpcplan.score.official",
    "commonroad_dc.costs.evaluation",
)
"""What workers, and the checker that they fork, import sooner or later."""


def main() -> None:
    """Load, then serve until nobody asks any more."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    _load()
    gc.freeze()  # the children share these pages as long as nobody touches them
    with suppress(BrokenPipeError):
        _say(answers, {"ready": True})
        while line := sys.stdin.readline():
            _serve(json.loads(line), answers)


def _load() -> None:
    """Import everything; what cannot be imported is a worker's failure where it is needed."""
    for name in LOADED:
        with suppress(Exception):
            importlib.import_module(name)


def _serve(request: dict[str, Any], answers: TextIO) -> None:
    """One worker, from its start to its end."""
    try:
        pid = os.fork()
    except OSError as error:
        _say(answers, {"error": error.strerror or str(error)})
        return
    if pid == 0:
        answers.close()
        _become_worker(request)
    _say(answers, {"pid": pid})
    os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
    _say(answers, {"ended": True})
    sys.stdin.readline()
    _, status, usage = os.wait4(pid, 0)
    code = os.waitstatus_to_exitcode(status)
    _say(answers, {"code": code, "peak_mb": usage.ru_maxrss / 1024})


def _say(answers: TextIO, message: dict[str, Any]) -> None:
    answers.write(json.dumps(message) + "\n")


def _become_worker(request: dict[str, Any]) -> None:
    """In the child: the worker from its first line to its last, as in a process of its own."""
    code = 1
    try:
        os.setsid()
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        log = os.open(request["log"], os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
        for stream in (1, 2):
            os.dup2(log, stream)
        os.environ["TMPDIR"] = request["scratch"]
        tempfile.tempdir = None
        from mpcplan.bench import worker

        worker.main(request["arguments"])
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)  # skips the extension modules' leak reports


if __name__ == "__main__":
    main()
    os._exit(0)
