"""Interactive twins of recorded scenarios: the same map, start and goal, with traffic that reacts.

A twin is a folder of the kind of 2021 (:mod:`mpcplan.sumo.folder`): the scenario's map as a SUMO
net, and its .cr.xml, whose recorded obstacles are where the traffic starts
(:mod:`mpcplan.sumo.inserted`).
"""

import re
import shutil
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from commonroad.scenario.scenario import ScenarioID

from mpcplan import scenario_xml
from mpcplan.errors import InputError
from mpcplan.scenario import load
from mpcplan.scenario_xml import name
from mpcplan.sumo.folder import CONFIG, NET, SCENARIO
from mpcplan.sumo.map_conversion import check_installed, convert_map

ROUTES = ".vehicles.rou.xml"
_ID = re.compile(r"(C-)?[A-Z]{3}_\w+-\d+(_\d+(_[A-Z]-\d+(-\d+)*)?)?")
_NO_ROUTES = "<routes/>\n"
_SETTINGS = """<configuration>
    <input>
        <net-file value="{net}"/>
        <route-files value="{routes}"/>
    </input>
    <time>
        <begin value="0"/>
        <step-length value="0.1"/>
    </time>
</configuration>
"""


@dataclass(frozen=True)
class Twin:
    """What was made.

    Attributes:
        id: the twin's benchmark id.
        folder: where it lies.
        notes: what differs from the original, one sentence each.
    """

    id: str
    folder: Path
    notes: tuple[str, ...]


def make_twin(scenario: Path, out: Path) -> Twin:
    """Makes an interactive scenario out of a recorded one.

    Args:
        scenario: CommonRoad file.
        out: folder to write, which must not exist or be empty.

    Raises:
        InputError: the scenario cannot be used, its map cannot be converted, the converter is not
            installed, or the folder cannot be written; says why and what to do.
    """
    _check_free(out)
    check_installed()
    loaded = load(scenario)
    if loaded.interactive:
        raise InputError(f"{scenario}: this is the folder of an interactive scenario already")
    with tempfile.TemporaryDirectory(prefix="mpcplan-") as folder:
        try:
            made = _make(scenario, Path(folder))
        except InputError as error:
            raise InputError(f"{scenario}: {error}") from error
        _copy(Path(folder), out)
    return Twin(made.id, out, (*loaded.notes, *made.notes))


def twin_id(benchmark_id: str) -> str:
    """The interactive twin's id: 'DEU_A9-1_1_I-1-2' of 'DEU_A9-1_1_T-2'.

    Raises:
        InputError: it is no benchmark id.
    """
    if not _ID.fullmatch(benchmark_id):
        raise InputError(
            f"the benchmarkID {benchmark_id!r} has not the form of 'DEU_Name-1_1_T-1', from which "
            "the new scenario's id is made"
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        known = ScenarioID.from_benchmark_id(benchmark_id, "2020a")
    prediction = known.prediction_id
    known.prediction_id = prediction if isinstance(prediction, list) else [1, prediction or 1]
    known.cooperative, known.obstacle_behavior = False, "I"
    known.configuration_id = known.configuration_id or 1
    return str(known)


def _check_free(out: Path) -> None:
    try:
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise InputError(f"{out}: there is something already; name a new or an empty folder")
    except OSError as error:
        raise InputError(f"{out}: cannot be read: {error.strerror}") from error


def _make(scenario: Path, folder: Path) -> Twin:
    """Writes all files into a folder."""
    root = scenario_xml.parse(scenario)
    own = twin_id(root.get("benchmarkID", ""))
    root.set("benchmarkID", own)
    notes = (*_keep_one_problem(root), *_drop_lights(root))
    target = folder / f"{own}{SCENARIO}"
    ElementTree.ElementTree(root).write(target, encoding="utf-8", xml_declaration=True)
    convert_map(target, folder / f"{own}{NET}")
    (folder / f"{own}{ROUTES}").write_text(_NO_ROUTES, encoding="utf-8")
    settings = _SETTINGS.format(net=f"{own}{NET}", routes=f"{own}{ROUTES}")
    (folder / f"{own}{CONFIG}").write_text(settings, encoding="utf-8")
    load(folder)  # what we wrote must be what we accept
    return Twin(own, folder, notes)


def _keep_one_problem(root: Element) -> list[str]:
    """Interactive scenarios have one ego vehicle."""
    others = root.findall("planningProblem")[1:]
    for problem in others:
        root.remove(problem)
    return [f"left out {name(problem)}: an interactive scenario has one" for problem in others]


def _drop_lights(root: Element) -> list[str]:
    """Takes out traffic lights, which the converter fails on: nobody heeds them in the twin."""
    lights = root.findall("trafficLight")
    for light in lights:
        root.remove(light)
    for owner in (*root.iterfind("lanelet"), *root.iterfind("lanelet/stopLine")):
        for reference in owner.findall("trafficLightRef"):
            owner.remove(reference)
    return [f"left out {len(lights)} traffic lights, which cannot be converted"] if lights else []


def _copy(made: Path, out: Path) -> None:
    """Copies the files, the .cr.xml last: before, a folder is no scenario's."""
    files = sorted(made.iterdir(), key=lambda file: (file.name.endswith(SCENARIO), file.name))
    try:
        out.mkdir(parents=True, exist_ok=True)
        for file in files:
            shutil.copyfile(file, out / file.name)
    except OSError as error:
        raise InputError(f"cannot write the folder {out}: {error.strerror}") from error
