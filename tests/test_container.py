"""The competition's image: what is pinned, what the Dockerfile says, how .ci/container judges."""

import csv
import fnmatch
import importlib.machinery
import importlib.util
import re
from importlib.metadata import requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

from mpcplan.cli.arguments import parser
from mpcplan.cli.many import compete

ROOT = Path(__file__).resolve().parents[1]
PINS = sorted((ROOT / "requirements").glob("*.txt"))
LOADER = importlib.machinery.SourceFileLoader("container", str(ROOT / ".ci" / "container"))


@pytest.fixture(scope="module")
def container():
    """The script as a module."""
    spec = importlib.util.spec_from_loader("container", LOADER)
    module = importlib.util.module_from_spec(spec)
    LOADER.exec_module(module)
    return module


@pytest.fixture(scope="module")
def image(container):
    """What the Dockerfile says."""
    return container.Image((ROOT / "Dockerfile").read_text(encoding="utf-8"))


@pytest.fixture
def root(container):
    """A scratch folder laid out like the image."""
    made = container.Root()
    yield made
    made.remove()


def _pinned(path: Path) -> dict[str, Version]:
    lines = path.read_text(encoding="utf-8").splitlines()
    pairs = [re.fullmatch(r"([A-Za-z0-9_.-]+)==([0-9a-z.]+)", line) for line in lines]
    assert all(pairs), f"{path.name}: name==version lines only"
    return {canonicalize_name(pair[1]): Version(pair[2]) for pair in pairs}


@pytest.mark.parametrize("path", PINS, ids=lambda path: path.stem)
def test_pins_meet_the_declared_dependencies(path):
    python, sumo = re.fullmatch(r"python([0-9.]+)-sumo([0-9.]+)", path.stem).groups()
    pinned = _pinned(path)
    declared = [Requirement(line) for line in requires("mpcplan")]
    needed = [one for one in declared if not (one.marker and "extra" in str(one.marker))]
    assert len(needed) > 10
    for one in needed:
        if one.marker is None or one.marker.evaluate({"python_version": python}):
            assert pinned[canonicalize_name(one.name)] in one.specifier, one
    assert pinned["libsumo"] == pinned["traci"] == pinned["sumolib"] == Version(sumo)
    assert {"pip", "setuptools", "wheel"} <= set(pinned)


def test_default_and_organisers_versions_are_pinned(image):
    stems = [path.stem for path in PINS]
    assert f"python{image.args['PYTHON']}-sumo{image.args['SUMO']}" in stems
    assert "python3.10-sumo1.12.0" in stems


def test_image_runs_the_competition_command(image):
    program, *arguments = image.command
    args = parser().parse_args(arguments)
    assert program == "mpcplan" and args.run is compete
    assert str(args.scenarios) == "/commonroad/scenarios"
    assert str(args.out) == "/commonroad/solutions"


def test_what_is_copied_into_the_image_is_there_and_not_ignored():
    dockerfile = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    copied = re.findall(r"^COPY (?!--from)(.+) \S+$", dockerfile, re.MULTILINE)
    words = [word.rstrip("/") for line in copied for word in line.split()]
    rules = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    assert rules[0] == "*"
    allowed = {rule[1:] for rule in rules if rule.startswith("!")}
    for word in words:
        assert (ROOT / word).exists()
        assert word.split("/")[0] in allowed
    assert allowed == {word.split("/")[0] for word in words}
    assert any(fnmatch.fnmatch("mpcplan/road/__pycache__", rule) for rule in rules[1:])


def test_package_lists_hold_names_only():
    for path in sorted((ROOT / "docker").glob("*-packages.txt")):
        names = path.read_text(encoding="utf-8").splitlines()
        assert names == sorted(names) and all(re.fullmatch(r"[a-z0-9.+-]+", n) for n in names)


@pytest.mark.parametrize("command", ["CMD mpcplan compete", "", "CMD []\nCMD []"])
def test_a_command_that_signals_do_not_reach_is_refused(container, command):
    with pytest.raises(container.ImageError, match="CMD in exec form"):
        container.Image(f'ENTRYPOINT ["mpcplan"]\n{command}\n')


def test_variables_and_continued_lines_are_read(container):
    text = 'ARG A=1\nRUN x \\\n    ENV B=2\nENV C=3=4\nENTRYPOINT ["a"]\nCMD ["b", "c d"]\n'
    read = container.Image(text)
    assert read.args == {"A": "1"} and read.env == {"C": "3=4"}
    assert read.command == ["a", "b", "c d"]


def test_paths_of_the_image_lead_into_the_scratch_folder(root):
    assert root.rooted("/opt/mpcplan/bin:/usr/bin") == f"{root.path}/opt/mpcplan/bin:/usr/bin"
    assert root.rooted("/tmp/matplotlib") == f"{root.path}/tmp/matplotlib"
    assert root.rooted("compete") == "compete"


def test_scenarios_are_placed_read_only_and_named_by_their_ids(container, root):
    file = ROOT / "scenarios" / "ZAM_Follow-1_1_T-1.xml"
    folder = ROOT / "scenarios" / "interactive" / "ZAM_SlowTraffic-1_1_I-1-1"
    placed = container.place(root, [file, folder])
    assert list(placed) == [file.stem, folder.name]
    assert {path.parent for path in placed.values()} == {root.path / "commonroad" / "scenarios"}
    modes = {path.stat().st_mode & 0o222 for path in root.of("/commonroad/scenarios").rglob("*")}
    assert modes == {0}


def test_pinned_sumo_of_a_python_is_found(container):
    assert container.newest_sumo("3.10", "1.28.0") == "1.12.0"
    assert container.newest_sumo("3.11", "1.28.0") == "1.28.0"
    with pytest.raises(container.ImageError, match=r"nothing is pinned for Python 3\.9"):
        container.newest_sumo("3.9", "1.28.0")


def test_digest_sees_every_change(container, tmp_path):
    def digest():
        return container.digest(tmp_path)

    seen = {digest()}
    (tmp_path / "a").write_text("1")
    seen.add(digest())
    (tmp_path / "a").write_text("2")
    seen.add(digest())
    (tmp_path / "a").rename(tmp_path / "b")
    seen.add(digest())
    assert len(seen) == 4


@pytest.fixture
def judged(container, root, monkeypatch):
    """Judge two scenarios, of which an official checker refuses those that it is told to."""
    names = ["ZAM_Follow-1_1_T-1.xml", "interactive/ZAM_SlowTraffic-1_1_I-1-1"]
    placed = container.place(root, [ROOT / "scenarios" / name for name in names])
    out = root.of("/commonroad/solutions")
    asked = []

    class Image:
        command, env = ("mpcplan",), {}

    def judge(valid=("True", "True"), present=(True, True), surplus=(), refused=()):
        rows = []
        for name, word, there in zip(placed, valid, present, strict=True):
            file = f"solution_KS1:TR1:{name}:2020a.xml"
            rows.append({"scenario": name, "valid": word, "solution": file if there else ""})
            if there:
                (out / file).touch()
        for name in surplus:
            (out / name).touch()
        with (out / "report.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(rows)

        def run(root, command, env, prefix):
            asked.append(command)
            return int(any(name in command[2] for name in refused))

        monkeypatch.setattr(container, "run", run)
        return container.judge(root, Image(), placed, [])

    return judge, asked


def test_valid_solutions_are_accepted_on_the_traffic_they_were_driven_in(judged):
    judge, asked = judged
    assert judge() == []
    follow, slow = asked
    assert follow[:3] == ["mpcplan", "evaluate", "/commonroad/scenarios/ZAM_Follow-1_1_T-1.xml"]
    simulated = ".mpcplan/solutions/ZAM_SlowTraffic-1_1_I-1-1.simulated.cr.xml"
    assert slow[2] == f"/commonroad/solutions/{simulated}"


@pytest.mark.parametrize(
    ("case", "message"),
    [
        ({"present": (False, True)}, "ZAM_Follow-1_1_T-1: no solution"),
        ({"valid": ("True", "")}, "ZAM_SlowTraffic-1_1_I-1-1: report.csv does not call it valid"),
        ({"refused": ["SlowTraffic"]}, "ZAM_SlowTraffic-1_1_I-1-1: refused by the official"),
        ({"surplus": ["solution_KS1:TR1:X:2020a.xml"]}, "solution_KS1:TR1:X:2020a.xml: nobody"),
    ],
    ids=["missing", "not valid", "refused", "surplus"],
)
def test_what_is_wrong_is_named(judged, case, message):
    judge, _ = judged
    (wrong,) = judge(**case)
    assert message in wrong
