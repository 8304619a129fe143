"""How long a scenario will take, from a look at its file: what the order of work is made of.

    t = START + DRIVE * duration + TRAFFIC * duration * obstacles + MAP * lanelets

The duration is the time until the goal's last time step, summed over the problems. The factors are
a non-negative least-squares fit to the processes' times on 17 recorded public scenarios of many
maps (one core, default configuration, rank correlation of estimated and measured times 0.96). On 17
others the rank correlation is 0.84. Only the order matters: an estimate limits nothing.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from mpcplan import scenario_xml
from mpcplan.bench.find import main_file
from mpcplan.errors import InputError

START = 2.3  # s: imports, reading, the official checker's start
DRIVE = 0.38  # s per second of the goal's time
TRAFFIC = 0.0020  # s per second of the goal's time and obstacle
MAP = 0.0092  # s per lanelet
_OPEN_END_STEPS = 200  # time steps where the goal sets no time
_OBSTACLES = scenario_xml.OBSTACLES


@dataclass(frozen=True)
class Estimate:
    """What is known of a scenario before it is run.

    Attributes:
        seconds: the time that it will take [s]; infinite for files that cannot be read.
        benchmark: its id in the file, by which its solution is named; '' when there is none.
    """

    seconds: float
    benchmark: str


def estimate(scenario: Path) -> Estimate:
    """The estimate for a scenario file or an interactive scenario's folder."""
    try:
        root = scenario_xml.parse(main_file(scenario))
        return Estimate(_seconds(root), root.get("benchmarkID", ""))
    except (InputError, ValueError):  # its own attempt will say what is wrong
        return Estimate(math.inf, "")


def _seconds(root: Element) -> float:
    duration = sum(_duration(problem) for problem in root.iterfind("planningProblem"))
    duration *= float(root.get("timeStepSize", "nan"))
    obstacles = sum(element.tag in _OBSTACLES for element in root)
    lanelets = len(root.findall("lanelet"))
    seconds = START + DRIVE * duration + TRAFFIC * duration * obstacles + MAP * lanelets
    return seconds if math.isfinite(seconds) else math.inf


def _duration(problem: Element) -> float:
    """Time steps from the start to the goal's last."""
    first = float(problem.findtext("initialState/time/exact", "0"))
    ends = [_end(goal, first) for goal in problem.iterfind("goalState")]
    return max(ends, default=first) - first


def _end(goal: Element, first: float) -> float:
    """The last time step of one goal state."""
    for name in ("time/intervalEnd", "time/exact"):
        text = goal.findtext(name)
        if text is not None:
            return float(text)
    return first + _OPEN_END_STEPS
