"""Interactive folders: what is read, and that hostile ones are refused without harm."""

import codecs
import os
import pickle
import subprocess
import sys
from pathlib import Path

import made
import made_sumo
import numpy as np
import pytest
from commonroad.common.util import Interval

from mpcplan.errors import InputError
from mpcplan.scenario import load
from mpcplan.sumo import safe_xml
from mpcplan.sumo.folder import is_folder, read_folder
from mpcplan.sumo.safe_pickle import MAX_BYTES, Record, read
from mpcplan.sumo.settings import read_settings

NAME = made_sumo.NAME
SHARED = Path(__file__).resolve().parents[2] / "shared" / "scenarios"
INTERVAL = "commonroad.common.util.Interval"
BOMB = (
    '<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">'
    '<!ENTITY c SYSTEM "file:///etc/hostname">]>'
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A presimulated folder."""
    return made_sumo.write(tmp_path / "folder")


def refused(path: Path, *words: str) -> str:
    """The message with which a folder is refused; it must hold the words."""
    with pytest.raises(InputError) as caught:
        load(path)
    message = str(caught.value)
    for word in words:
        assert word in message, message
    return message


def rewrite(file: Path, old: str, new: str) -> None:
    """Replaces a text that must occur."""
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


# ---------------------------------------------------------------- what is read


def test_presimulated_folder(folder):
    loaded = load(folder)
    found = loaded.folder
    assert loaded.interactive
    assert loaded.path == folder / f"{NAME}.cr.xml"
    assert found.name == NAME
    assert found.presimulated
    assert found.ego == made_sumo.EGO
    assert found.net == folder / f"{NAME}.net.xml"
    assert found.routes == (folder / f"{NAME}.vehicle.rou.xml",)
    assert found.additional == (folder / f"{NAME}.add.xml",)
    assert found.options == (("time-to-teleport", "-1"),)
    assert found.settings.presimulation_steps == 20
    assert found.settings.random_seed == made_sumo.SEED
    assert found.settings.vehicle_parameters["length"] == {"car": (4.0, 5.5), "bicycle": 2.0}


def test_folder_without_ego_vehicle_starts_from_the_record(folder):
    rewrite(folder / f"{NAME}.vehicle.rou.xml", made_sumo.EGO, "2")
    (folder / "simulation_config.p").write_bytes(b"never opened")
    found = load(folder).folder
    assert not found.presimulated
    assert found.settings is None
    assert found.ego == ""


def test_net_and_scenario_are_enough(folder):
    for ending in ("sumo.cfg", "vehicle.rou.xml", "add.xml"):
        (folder / f"{NAME}.{ending}").unlink()
    found = load(folder).folder
    assert found.net == folder / f"{NAME}.net.xml"
    assert found.routes == found.additional == found.options == ()


def test_a_file_is_not_interactive(tmp_path):
    loaded = load(made.write(tmp_path))
    assert loaded.folder is None
    assert not loaded.interactive


def test_which_folders_are_scenarios(folder, tmp_path):
    assert is_folder(folder)
    assert not is_folder(tmp_path)
    assert not is_folder(folder / f"{NAME}.cr.xml")
    (folder / "other.cr.xml").write_text("")
    assert not is_folder(folder)


def test_other_folders_are_refused(tmp_path):
    refused(tmp_path, str(tmp_path), "not one of an interactive scenario")
    with pytest.raises(InputError, match="no such folder"):
        read_folder(tmp_path / "missing")


def test_two_planning_problems_are_refused(folder):
    problems = [made.problem(k, made.state(40 * (k - 99), made.LANE / 2, 10)) for k in (100, 101)]
    written = made.write(folder, *problems, obstacles=[])
    written.replace(folder / f"{NAME}.cr.xml")
    refused(folder, "2 planning problems")


@pytest.mark.parametrize("ending", ["net.xml", "vehicle.rou.xml", "add.xml"])
def test_missing_files_are_named(folder, ending):
    (folder / f"{NAME}.{ending}").unlink()
    refused(folder, f"{NAME}.{ending}", "no such file")


def test_missing_settings_are_named(folder):
    (folder / "simulation_config.p").unlink()
    refused(folder, "simulation_config.p", "no such file")


def test_two_configurations_are_ambiguous(folder):
    (folder / "b.sumo.cfg").write_text("<configuration/>")
    refused(folder, "exactly one *.sumo.cfg")


def test_two_ego_vehicles_are_refused(folder):
    rewrite(folder / f"{NAME}.vehicle.rou.xml", 'id="3"', 'id="egoVehicle3"')
    refused(folder, "2 ego vehicles")


@pytest.mark.parametrize("name", ["a,b", "a${HOME}b"])
def test_folder_names_that_sumo_cannot_read(tmp_path, name):
    refused(made_sumo.write(tmp_path / name), "SUMO cannot read")


@pytest.mark.parametrize("kind", ["competition", "interactive"])
def test_published_folders_load(kind):
    folders = sorted((SHARED / kind).glob("*/")) if (SHARED / kind).is_dir() else []
    if not folders:
        pytest.skip(f"the public {kind} folders are not here")
    for path in folders[:20]:
        loaded = load(path)
        assert loaded.folder.presimulated == (kind == "competition")
        assert loaded.id == loaded.folder.name


@pytest.mark.slow
def test_all_published_folders_load():
    folders = sorted(SHARED.glob("interactive/*/"))
    if not folders:
        pytest.skip("the public interactive folders are not here")
    for path in folders:
        assert load(path).interactive


# ---------------------------------------------------------------- paths


@pytest.mark.parametrize("ending", ["net.xml", "vehicle.rou.xml", "add.xml"])
@pytest.mark.parametrize("where", ["absolute", "above", "hidden"])
def test_paths_out_of_the_folder_are_refused(folder, ending, where):
    name = f"{NAME}.{ending}"
    outside = folder.parent / name
    (folder / name).rename(outside)
    (folder / "sub").mkdir()
    path = {"absolute": str(outside), "above": f"../{name}", "hidden": f"sub/../../{name}"}[where]
    rewrite(folder / f"{NAME}.sumo.cfg", f'"{name}"', f'"{path}"')
    refused(folder, "leads out of the folder", path)


@pytest.mark.parametrize(
    "name", [f"{NAME}.cr.xml", f"{NAME}.sumo.cfg", f"{NAME}.net.xml", f"{NAME}.vehicle.rou.xml",
             f"{NAME}.add.xml", "simulation_config.p"],
)  # fmt: skip
def test_links_out_of_the_folder_are_refused(folder, name):
    outside = folder.parent / name
    (folder / name).rename(outside)
    (folder / name).symlink_to(outside)
    refused(folder, name, "a link that leads out of the folder")


def test_folders_linked_into_the_folder_are_refused(folder):
    outside = folder.parent / "outside"
    outside.mkdir()
    (folder / f"{NAME}.add.xml").rename(outside / "a.add.xml")
    (folder / "inside").symlink_to(outside)
    rewrite(folder / f"{NAME}.sumo.cfg", f"{NAME}.add.xml", "inside/a.add.xml")
    refused(folder, "a link that leads out of the folder")


def test_links_within_the_folder_are_fine(folder):
    name = folder / f"{NAME}.add.xml"
    name.rename(folder / "real.xml")
    name.symlink_to(folder / "real.xml")
    assert load(folder).interactive


def test_pipes_are_refused(folder):
    name = folder / f"{NAME}.add.xml"
    name.unlink()
    os.mkfifo(name)
    refused(folder, "not a regular file")


# ---------------------------------------------------------------- XML


@pytest.mark.parametrize("ending", ["cr.xml", "sumo.cfg", "net.xml", "vehicle.rou.xml", "add.xml"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_entities_are_refused(folder, ending, encoding):
    file = folder / f"{NAME}.{ending}"
    text = file.read_text()
    text = BOMB + text[text.index("?>") + 2 if text.startswith("<?xml") else 0 :]
    file.write_text(
        text.replace('version="1.0"?', f'version="1.0" encoding="{encoding}"?'), encoding
    )
    refused(folder, file.name, "document type")


@pytest.mark.parametrize("ending", ["sumo.cfg", "net.xml", "vehicle.rou.xml", "add.xml"])
@pytest.mark.parametrize("text", ["", "<broken", "<other/>", "\x1f\x8b\x08"])
def test_other_xml_is_refused(folder, ending, text):
    file = folder / f"{NAME}.{ending}"
    file.write_text(text)
    refused(folder, file.name)


def test_long_files_are_refused(folder, monkeypatch):
    monkeypatch.setattr(safe_xml, "MAX_BYTES", 100)
    refused(folder, "longer than 100 bytes")


HARMFUL = [
    '<include href="/etc/hostname"/>',
    '<inductionLoop id="d" lane="road_0" pos="5" freq="1" file="{out}"/>',
    '<e1Detector id="d" lane="road_0" pos="5" freq="1" file="{out}"/>',
    '<laneAreaDetector id="d" lane="road_0" pos="5" endPos="9" freq="1" file="{out}"/>',
    '<entryExitDetector id="d" freq="1" file="{out}"/>',
    '<instantInductionLoop id="d" lane="road_0" pos="5" file="{out}"/>',
    '<edgeData id="d" file="{out}"/>',
    '<laneData id="d" file="{out}"/>',
    '<timedEvent type="SaveTLSStates" source="a" dest="{out}"/>',
    '<routeProbe id="d" edge="road" file="{out}"/>',
    '<vTypeProbe id="d" type="t" freq="1" file="{out}"/>',
    '<calibrator id="d" lane="road_0" output="{out}"/>',
    '<rerouter id="d" edges="road" file="{out}"/>',
    '<variableSpeedSign id="d" lanes="road_0" file="{out}"/>',
    '<tracker id="d" file="{out}"/>',
    '<poi id="d" x="0" y="0" imgFile="{out}"/>',
    '<tlLogic id="a" type="actuated" programID="0"><param key="file" value="{out}"/></tlLogic>',
    '<vType id="t" imgFile="{out}"/>',
    '<vType id="t" emissionClass="PHEMlight/zero"/>',
    '<vType id="t"><param key="device.ssm.file" value="{out}"/></vType>',
    '<vType id="t"><param key="has.toc.device" value="1"/></vType>',
    '<x:edgeData xmlns:x="http://a" id="d" file="{out}"/>',
]


@pytest.mark.parametrize("where", ["routes", "additional"])
@pytest.mark.parametrize("element", HARMFUL)
def test_what_reads_or_writes_files_is_refused(tmp_path, element, where):
    out = tmp_path / "written.xml"
    path = made_sumo.write(tmp_path / "folder", **{where: element.format(out=out)})
    refused(path, "refused")


@pytest.mark.parametrize(
    "element",
    [
        '<tlLogic id="a" type="sotl_wave" programID="0" offset="0"/>',
        '<tlLogic id="a" programID="0"><param key="file" value="x"/></tlLogic>',
        '<include href="/etc/hostname"/>',
        '<edge id="e" from="a" to="b" file="x"/>',
        '<location projParameter="+proj=utm +nadgrids=/etc/hostname"/>',
    ],
)
def test_what_reads_or_writes_files_is_refused_in_nets(tmp_path, element):
    refused(made_sumo.write(tmp_path / "folder", net=element), "refused")


def test_options_cannot_bring_further_options(tmp_path):
    """SUMO takes the word after a switch for the next option if it is no truth value."""
    option = '<a><collision.check-junctions value="--fcd-output=x"/></a>'
    refused(made_sumo.write(tmp_path / "folder", config=option), "--fcd-output=x")


def tree(folder: Path) -> dict[str, tuple[bytes, int]]:
    """All files with their contents and times."""
    return {str(p): (p.read_bytes(), p.stat().st_mtime_ns) for p in folder.iterdir()}


def test_output_options_have_no_effect(tmp_path):
    out = tmp_path / "outside.xml"
    options = "".join(
        f'<{name} value="{value}"/>'
        for name, value in {
            "lanechange-output": "changes.txt", "fcd-output": str(out), "log": "log.txt",
            "summary-output": "summary.xml", "save-config": "saved.cfg", "error-log": "error.txt",
        }.items()
    )  # fmt: skip
    path = made_sumo.write(tmp_path / "folder", config=f"<output>{options}</output>")
    before = tree(path)
    run = (
        "import sys; from mpcplan.scenario import load;"
        "from mpcplan.sumo.presimulated import PresimulatedTraffic as T;"
        "loaded = load(sys.argv[1]); problem = loaded.problems[0]; t = T(loaded, problem);"
        "[t.advance(k, problem.start) for k in range(1, 10)]; t.close()"
    )
    working = tmp_path / "working"
    working.mkdir()
    subprocess.run([sys.executable, "-c", run, str(path)], check=True, cwd=working)
    assert tree(path) == before
    assert not out.exists()
    assert not list(working.iterdir())


# ---------------------------------------------------------------- pickles


class Calls:
    """Pickled as the call of a function."""

    def __init__(self, function: object, *arguments: object) -> None:
        self.call = function, arguments

    def __reduce__(self) -> object:
        return self.call


class WithState:
    """Pickled as a call whose result gets a state."""

    def __init__(self, function: object, arguments: tuple, state: object) -> None:
        self.call = function, arguments, state

    def __reduce__(self) -> object:
        return self.call


def hostile(marker: Path) -> dict[str, bytes]:
    """Pickles that do something; what they do is to create a file."""
    shell = f"touch {marker}"
    python = f"open({str(marker)!r}, 'w')"
    nested = pickle.dumps(Calls(os.system, shell))
    object_type = WithState(np.dtype, ("O8", False, True), (3, "|", None, None, None, -1, -1, 63))
    scalar = np.float64(0).__reduce__()[0]
    return {
        "system": pickle.dumps(Calls(os.system, shell)),
        "system in a list": pickle.dumps([1, {"a": Calls(os.system, shell)}]),
        "system in settings": made_sumo.settings(random_seed=Calls(os.system, shell)),
        "eval": pickle.dumps(Calls(eval, python)),
        "exec": pickle.dumps(Calls(exec, python)),
        "protocol 0": pickle.dumps(Calls(eval, python), 0),
        "open": pickle.dumps(Calls(open, str(marker), "w")),
        "popen": pickle.dumps(Calls(subprocess.Popen, ["touch", str(marker)])),
        "getattr chain": b"cbuiltins\ngetattr\n(cbuiltins\n__import__\n(S'os'\ntRS'system'"
        b"\ntR(S'%s'\ntR." % shell.encode(),
        "codecs": pickle.dumps(Calls(codecs.decode, b"636f", "hex")),
        "other encoding": pickle.dumps(Calls(codecs.encode, "x", "zlib")),
        "unpickler in numpy": pickle.dumps(Calls(scalar, object_type, nested)),
        "numpy load": pickle.dumps(Calls(np.load, str(marker), None, True)),
        "numpy runstring": b"cnumpy.testing._private.utils\nrunstring\n(S'%s'\n}tR."
        % python.encode().replace(b"'", b'"'),
        "numpy array": pickle.dumps(np.array([1.0])),
        "INST": b"(S'%s'\nios\nsystem\n." % shell.encode(),
        "OBJ": b"(cos\nsystem\nS'%s'\no." % shell.encode(),
        "NEWOBJ_EX": b"\x80\x04\x8c\x02os\x8c\x06system\x93(\x8c\x01xt}\x92.",
        "build": b"cos\nsystem\n}S'a'\nK\x01sb.",
        "dotted name": b"\x80\x04\x8c\x0fsumocr.sumo_config.default\x8c\x10DefaultConfig.x.y\x93.",
        "call of a record class": b"c%b\n(U\x01xtR." % INTERVAL.encode().replace(b"l.I", b"l\nI"),
        "persistent": b"Pan id\n.",
        "binary persistent": b"\x80\x02X\x01\x00\x00\x00aQ.",
        "extension": b"\x80\x02\x82\x01.",
        "extension 4": b"\x80\x02\x84\x01\x00\x00\x00.",
        "next buffer": b"\x80\x05\x97.",
        "bytearray": b"\x80\x05\x96\xff\xff\xff\xff\x00\x00\x00\x00a.",
        "long bytes": b"\x80\x04\x8e\xff\xff\xff\xff\xff\x00\x00\x00a.",
        "long text": b"\x80\x04\x8d\xff\xff\xff\xff\xff\x00\x00\x00a.",
        "far memo without value": b"\x80\x04r\xff\xff\xff\x7f.",
        "no end": b"\x80\x04K\x01",
        "empty": b"",
        "text": b"hello",
        "stack underflow": b"\x80\x04\x85.",
        "unknown memo": b"\x80\x04h\x07.",
        "mark at the end": b"\x80\x04(.",
        "odd items": b"\x80\x04}(K\x01u.",
        "too long": b"\x80\x04" + b"N" * MAX_BYTES + b".",
        "hash of nested tuples": b"\x80\x04})\x94" + b"h\x00h\x00\x86\x940" * 40 + b".",
        "tuple as key": b"\x80\x04})K\x01s.",
        "deep": b"\x80\x04" + b"(" * 5000 + b"K\x01" + b"t" * 5000 + b".",
        "deep in settings": b"\x80\x02csumocr.sumo_config.default\nDefaultConfig\n)\x81}"
        + b"X\x02\x00\x00\x00dt"
        + b"(" * 5000
        + b"K\x01"
        + b"t" * 5000
        + b"sb.",
        "huge number": b"\x80\x04I" + b"9" * 5000 + b"\n.",
    }


@pytest.mark.parametrize("name", list(hostile(Path("x"))))
def test_hostile_pickles_run_nothing(folder, name):
    marker = folder.parent / "ran"
    (folder / "simulation_config.p").write_bytes(hostile(marker)[name])
    message = refused(folder, "simulation_config.p")
    assert len(message) < 1000
    assert not marker.exists()


@pytest.mark.parametrize("name", ["system", "eval", "exec", "protocol 0", "open", "getattr chain"])
def test_the_hostile_pickles_would_run(tmp_path, name):
    """Python's own unpickler runs them: the test above is not about harmless files."""
    marker = tmp_path / "ran"
    try:
        pickle.loads(hostile(marker)[name])
    finally:
        assert marker.exists()


@pytest.mark.parametrize(
    ("name", "culprit"),
    [("system", "posix.system"), ("eval", "builtins.eval"), ("getattr chain", "builtins.getattr")],
)
def test_the_class_is_named(folder, name, culprit):
    (folder / "simulation_config.p").write_bytes(hostile(folder)[name])
    refused(folder, culprit)


def test_memory_stays_small_with_far_memo_indices(tmp_path):
    """The stock unpickler makes a table up to the largest index: 16 GB here."""
    path = tmp_path / "a.p"
    path.write_bytes(b"\x80\x04K\x05r\xff\xff\xff\x7f.")
    assert read(path, frozenset(), frozenset()) == 5


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
def test_genuine_settings_in_all_protocols(tmp_path, protocol):
    path = tmp_path / "a.p"
    path.write_bytes(made_sumo.settings(protocol, random_seed=12))
    found = read_settings(path, 0.1)
    assert found.random_seed == 12
    assert found.vehicle_parameters["accel"]["bicycle"] == (1.0, 1.4)


@pytest.mark.parametrize("protocol", [2, 4])
@pytest.mark.parametrize("module", ["numpy._core.multiarray", "numpy.core.multiarray"])
@pytest.mark.parametrize(
    "value",
    [np.float64(0.3), np.float32(0.25), np.int64(-4), np.int32(7), np.uint8(3), np.bool_(1)],
)
def test_numpy_scalars_of_both_generations(tmp_path, protocol, module, value):
    path = tmp_path / "a.p"
    data = pickle.dumps(value, protocol)
    own = type(value).__reduce__(value)[0].__module__
    if protocol == 4:  # lengths precede names, so only names written as lines can be exchanged
        module = own
    path.write_bytes(data.replace(own.encode(), module.encode()))
    assert read(path, frozenset(), frozenset()) == value


def test_records_are_inert(tmp_path):
    path = tmp_path / "a.p"
    path.write_bytes(pickle.dumps(Interval(1, 2)))
    found = read(path, frozenset({INTERVAL}), frozenset())
    assert isinstance(found, Record)
    assert (found.name, found.fields) == (INTERVAL, {"_start": 1, "_end": 2})


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("dt", 0.2), ("presimulation_steps", -1), ("presimulation_steps", 10**30),
        ("presimulation_steps", 1.5), ("random_seed", "7"), ("random_seed", 10**500),
        ("lateral_resolution", float("nan")), ("delta_steps", 0), ("delta_steps", True),
        ("veh_params", None), ("veh_params", {"length": 4}), ("veh_params", {1: {}}),
        ("veh_params", {"length": {"car": 4.0}}),
    ],
)  # fmt: skip
def test_bad_settings_are_named(folder, field, value):
    (folder / "simulation_config.p").write_bytes(made_sumo.settings(**{field: value}))
    refused(folder, "simulation_config.p", field)


@pytest.mark.parametrize("ends", [(-1, 2), (0.0, 1.0), (1, "a"), (1, 10**400)])
def test_bad_intervals_are_named(folder, ends):
    interval = Interval(0, 1)
    interval._start, interval._end = ends
    changed = {"length": {made_sumo.ObstacleType.CAR: interval}}
    (folder / "simulation_config.p").write_bytes(made_sumo.settings(veh_params=changed))
    refused(folder, "simulation_config.p", "'length'")


def test_broken_settings_never_end_in_a_traceback(folder):
    """Genuine settings cut short, or with bytes exchanged, load or are refused."""
    data = made_sumo.settings()
    random = np.random.default_rng(1)
    file = folder / "a.p"
    outcomes = set()
    for _ in range(600):
        broken = bytearray(data)
        for place in random.integers(0, len(data), 1 + random.integers(3)):
            broken[place] = random.integers(256)
        file.write_bytes(bytes(broken[: random.integers(1, len(data) + 1)]))
        try:
            read_settings(file, 0.1)
            outcomes.add("read")
        except InputError as error:
            outcomes.add("refused")
            assert len(str(error)) < 1000
    assert "refused" in outcomes
