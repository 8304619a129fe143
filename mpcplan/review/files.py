"""The files of a run, as `solve` and `bench` leave them: trace, solution, scenario.

A trace holds no trajectories. What was driven is read from the solution; the scenario of an
interactive run is the one that was written with its traffic, that of a recorded run lies where the
trace says, or where the user does.
"""

from dataclasses import dataclass
from pathlib import Path

from mpcplan.errors import InputError
from mpcplan.explain.read import Trace, read_trace, trace_file
from mpcplan.review.places import PICTURES, SOLUTIONS, TRACES
from mpcplan.scenario import LoadedScenario, load

SIMULATED = ".simulated.cr.xml"


@dataclass(frozen=True, eq=False)
class RunFiles:
    """What is known of a run.

    Attributes:
        trace: the trace.
        solution: what was driven; None: there is no such file.
        loaded: the scenario; of an interactive run with the traffic that was simulated.
        simulated: whether nobody knew the others' motion when this was planned.
        pictures: the folder for pictures of the run.
    """

    trace: Trace
    solution: Path | None
    loaded: LoadedScenario
    simulated: bool
    pictures: Path


def find_files(run: Path, scenario: Path | None = None) -> RunFiles:
    """The files of a run.

    Args:
        run: the folder of `solve`, or a trace of `bench`.
        scenario: the run's scenario; None: where the trace says that it was.

    Raises:
        InputError: it is no run, its scenario is not there, or is another one.
    """
    trace, file = read_trace(run), trace_file(run)
    of_bench = file.parent.name == TRACES
    name = str(trace.get("scenario", ""))
    folder = file.parent.parent / SOLUTIONS if of_bench else file.parent
    solutions = sorted(folder.glob(f"solution_*:{name}:*.xml"))
    traffic = folder / f"{name}{SIMULATED}"
    path = traffic if traffic.is_file() else _scenario(trace, file, scenario)
    loaded = load(path)
    if loaded.id != name:
        raise InputError(f"{path} is the scenario {loaded.id}, but {file} is a run of {name}")
    return RunFiles(
        trace, solutions[0] if solutions else None, loaded,
        loaded.interactive or traffic.is_file(),
        file.parent.parent / PICTURES if of_bench else file.parent,
    )  # fmt: skip


def _scenario(trace: Trace, file: Path, given: Path | None) -> Path:
    """The scenario that the user names, or the trace."""
    if given is not None:
        return given
    noted = trace.get("file")
    if noted is None:
        raise InputError(f"{file} does not say where its scenario lies; name it with --scenario")
    if not Path(noted).exists():
        raise InputError(
            f"the scenario of {file} is not at {noted} any more; name it with --scenario"
        )
    inside = Path(noted).parent
    interactive = Path(noted).name.endswith(".cr.xml") and any(inside.glob("*.sumo.cfg"))
    return inside if interactive else Path(noted)
