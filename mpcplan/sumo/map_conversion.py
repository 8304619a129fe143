"""Maps made into SUMO nets by commonroad-sumo's converter, in a child process.

The converter needs two packages that nothing else here needs (the extra ``twin``), prints a lot,
and can fail, hang or die on a map; so it never runs in the caller's process.
"""

import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from mpcplan.environment import before, child_environment
from mpcplan.errors import InputError

TIME_LIMIT = 300.0  # s; maps take 0.2 to 2 s
INSTALL = "pip install commonroad-sumo==2025.1.4 eclipse-sumo==1.28.0"
_CHILD = "mpcplan.sumo.map_child"


def check_installed() -> None:
    """Raises InputError, with the command that helps, where the converter is not installed."""
    missing = []
    if importlib.util.find_spec("commonroad_sumo") is None:
        missing.append("the package commonroad-sumo")
    if _netconvert() is None:
        missing.append("SUMO's program netconvert")
    if missing:
        raise InputError(
            f"maps are converted by {' and '.join(missing)}, not installed here: {INSTALL}"
        )


def convert_map(scenario: Path, net: Path, time_limit: float = TIME_LIMIT) -> None:
    """Writes the SUMO net of a scenario's map, in the file's coordinates.

    Args:
        scenario: CommonRoad file without traffic lights (the converter fails on them).
        net: file to write.
        time_limit: [s].

    Raises:
        InputError: the converter is not installed, or the map cannot be converted; says why.
    """
    check_installed()
    with tempfile.TemporaryDirectory(prefix="mpcplan-") as folder:
        answer, log = Path(folder, "answer.json"), Path(folder, "log.txt")
        how = _run(scenario, net, answer, log, time_limit)
        error = _error(answer)
        if error is None:
            error = f"the converter {how}{_last_words(log)}"
    if error:
        raise InputError(f"the map cannot be converted: {error}")


def _netconvert() -> Path | None:
    """SUMO's converter: that of the package eclipse-sumo, else one on the system."""
    package = importlib.util.find_spec("sumo")
    homes = [Path(package.origin).parent] if package and package.origin else []
    homes += [Path(os.environ["SUMO_HOME"])] if os.environ.get("SUMO_HOME") else []
    for home in homes:
        if os.access(home / "bin" / "netconvert", os.X_OK):
            return home / "bin" / "netconvert"
    found = shutil.which("netconvert")
    return Path(found) if found else None


def _run(scenario: Path, net: Path, answer: Path, log: Path, time_limit: float) -> str:
    """Runs the child; how it ended, in words."""
    with log.open("wb") as noise:
        child = subprocess.Popen(
            [sys.executable, "-m", _CHILD, str(scenario), str(net), str(answer)],
            stdin=subprocess.DEVNULL,
            stdout=noise,
            stderr=noise,
            env=_environment(),
            start_new_session=True,  # a group of its own: netconvert ends with it
        )
        try:
            code = child.wait(time_limit)
        except BaseException as error:  # the time limit, or the user's interrupt
            os.killpg(child.pid, signal.SIGKILL)
            child.wait()
            if not isinstance(error, subprocess.TimeoutExpired):
                raise
            return f"did not finish within {time_limit:g} s"
    return f"ended with code {code}" if code >= 0 else f"crashed (signal {-code})"


def _environment() -> dict[str, str]:
    """The child's environment: netconvert to be found first, sets always in the same order (the
    converter writes them)."""
    netconvert = _netconvert()
    assert netconvert is not None  # checked before
    return {
        **child_environment(),
        "PATH": before("PATH", str(netconvert.parent)),
        "SUMO_HOME": str(netconvert.parents[1]),
        "PYTHONHASHSEED": "0",
    }


def _error(answer: Path) -> str | None:
    """The child's answer: '' for done; None where it has not come to an answer."""
    try:
        return str(json.loads(answer.read_text(encoding="utf-8"))["error"])
    except (OSError, ValueError, KeyError):
        return None


def _last_words(log: Path) -> str:
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    words = [line.strip() for line in lines if line.strip() and not line.startswith("nanobind")]
    return f": {words[-1][:200]}" if words else ""
