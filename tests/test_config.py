"""Configuration: files and overrides in, commented files out, an error for every mistake."""

import math
from pathlib import Path
from typing import Annotated, Literal

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pydantic import BaseModel, Field

from mpcplan.config import Config, Section, par
from mpcplan.config import files as config_files
from mpcplan.config.files import dump_config, load_config
from mpcplan.config.text import allowed, unit
from mpcplan.errors import ConfigError

CONFIGS = Path(__file__).parent.parent / "configs"
PARAMETERS = [
    (section, name, field)
    for section in Config.model_fields
    for name, field in config_files.section_type(section).model_fields.items()
]


class Toy(Section):
    """A section with every type of parameter."""

    gain: float = par(1.5, "1/m", "a number with a range", gt=0, le=10)
    count: int = par(3, "1", "a whole number with a range", ge=1, le=100000)
    floor: float = par(0.0, "s", "a number with one limit", ge=0)
    ceiling: float = par(0.0, "s", "a number with the other limit", lt=1e6)
    free: float = par(1e-7, "m", "a number without limits")
    on: bool = par(True, "", "a switch")
    kind: Literal["fast", "good"] = par("good", "", "a choice")
    horizon: Annotated[float, Field(gt=0, le=60)] | Literal["goal"] = par(3.0, "s", "a union")
    times: tuple[Annotated[float, Field(gt=0)], ...] = par(
        (1.0, 2.0), "s", "a list", min_length=1, max_length=3
    )


class Other(Section):
    """A second section, whose docstring is long enough to need more than one line of a hundred
    characters in the written file.
    """

    width: float = par(2.0, "m", "a width", ge=0)
    unit_free: str = par("no", "", "a text")


class ToyConfig(Section):
    """Stands in for the package's configuration, so that its parameters may change."""

    toy: Toy = par(Toy(), "", "first")
    other: Other = par(Other(), "", "second")


@pytest.fixture
def toy(monkeypatch):
    """Makes the machinery work on the toy configuration."""
    monkeypatch.setattr(config_files, "Config", ToyConfig)


def written(folder: Path, text: str) -> Path:
    """A configuration file with the text."""
    path = folder / "my.yaml"
    path.write_text(text)
    return path


# ---------------------------------------------------------------- the package's parameters


@pytest.mark.parametrize(("section", "name", "field"), PARAMETERS)
def test_every_parameter_has_a_unit_and_a_meaning(section, name, field):
    assert field.description, f"{section}.{name} has no meaning"
    assert "unit" in (field.json_schema_extra or {}), f"{section}.{name} has no unit"
    numbers = "number" in allowed(field)
    assert bool(unit(field)) == numbers, f"{section}.{name}: '1' if dimensionless, '' for no number"


@pytest.mark.parametrize("section", Config.model_fields)
def test_every_section_is_described(section):
    model = config_files.section_type(section)
    assert model.__doc__
    assert model.__doc__ != BaseModel.__doc__


def test_defaults_round_trip(tmp_path):
    assert load_config() == Config()
    assert load_config(written(tmp_path, dump_config(Config()))) == Config()


def test_default_file_is_up_to_date():
    shipped = (CONFIGS / "default.yaml").read_text()
    assert shipped == dump_config(Config()), "run: mpcplan config > configs/default.yaml"


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.name)
def test_shipped_files_load(path):
    load_config(path)


@pytest.mark.parametrize(("section", "name", "field"), PARAMETERS)
def test_every_parameter_refuses_nonsense(section, name, field):
    with pytest.raises(ConfigError, match=rf"--set: {section}\.{name} is .*; allowed is "):
        load_config(overrides=[f"{section}.{name}={{a: b}}"])


# ---------------------------------------------------------------- what is read


def test_partial_file_and_overrides(toy, tmp_path):
    path = written(tmp_path, "toy:\n  gain: 2\n  times: [1, 2.5]\nother:\n")
    config = load_config(path, ["toy.gain=4", "toy.count = 7", "toy.gain=5"])
    assert config.toy == Toy(gain=5.0, count=7, times=(1.0, 2.5))
    assert isinstance(config.toy.gain, float)
    assert config.other == Other()


def test_empty_file_means_defaults(toy, tmp_path):
    assert load_config(written(tmp_path, "# nothing\n")) == ToyConfig()


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("gain=1e-3", 0.001),
        ("gain=.5", 0.5),
        ("gain=2.", 2.0),
        ("free=-1.5E+3", -1500.0),
        ("count=+12", 12),
        ("on=false", False),
        ("kind=fast", "fast"),
        ("kind='fast'", "fast"),
        ("horizon=goal", "goal"),
        ("horizon=2", 2.0),
        ("times=[3]", (3.0,)),
    ],
)
def test_values(toy, text, value):
    assert getattr(load_config(overrides=[f"toy.{text}"]).toy, text.split("=")[0]) == value


toys = st.builds(
    Toy,
    gain=st.floats(0, 10, exclude_min=True),
    count=st.integers(1, 100000),
    floor=st.floats(0, allow_infinity=False),
    free=st.floats(allow_nan=False, allow_infinity=False),
    on=st.booleans(),
    kind=st.sampled_from(["fast", "good"]),
    horizon=st.floats(0.001, 60) | st.just("goal"),
    times=st.lists(st.floats(1e-3, 1e9), min_size=1, max_size=3).map(tuple),
)
texts = st.text(st.characters(min_codepoint=32, max_codepoint=126))


@given(toys, texts)
@example(Toy(), "0E0")  # a number to YAML 1.2, a text to YAML 1.1
def test_every_configuration_round_trips(tmp_path_factory, toy_section, text):
    config = ToyConfig(toy=toy_section, other=Other(unit_free=text))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(config_files, "Config", ToyConfig)
        path = written(tmp_path_factory.getbasetemp(), dump_config(config))
        assert load_config(path) == config


def test_written_file(toy):
    text = dump_config(ToyConfig())
    assert "  # a number with a range [1/m]: a number in (0, 10]\n  gain: 1.5\n" in text
    assert "  # a choice: one of fast, good\n  kind: good\n" in text
    assert "  free: 1.0e-07\n" in text  # a number for YAML 1.1 readers, too
    assert max(map(len, text.splitlines())) <= 100


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("gain", "a number in (0, 10], in 1/m"),
        ("count", "a whole number in [1, 100000]"),
        ("floor", "a number >= 0, in s"),
        ("ceiling", "a number < 1000000, in s"),
        ("free", "a number, in m"),
        ("on", "true or false"),
        ("kind", "one of fast, good"),
        ("horizon", "a number in (0, 60] or goal, in s"),
        ("times", "a list of at least 1 and at most 3, each a number > 0, in s"),
    ],
)
def test_what_is_allowed(name, words):
    assert allowed(Toy.model_fields[name], in_unit=True) == words


# ---------------------------------------------------------------- errors


def refused(words: list[str], path: Path | None = None, *overrides: str) -> None:
    """Asserts that loading fails with a message that holds all the words."""
    with pytest.raises(ConfigError) as caught:
        load_config(path, overrides)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("toi:\n  gain: 1\n", ["unknown section 'toi'", "did you mean toy?"]),
        ("gain: 1\n", ["unknown section 'gain'", "did you mean toy.gain?"]),
        ("1: 2\n", ["unknown section 1", "known are toy, other"]),
        ("toy:\n  gian: 1\n", ["unknown key toy.gian", "did you mean gain?"]),
        ("toy:\n  width: 1\n", ["unknown key toy.width", "did you mean other.width?"]),
        ("toy:\n  zzz: 1\n", ["unknown key toy.zzz", "known are gain, count"]),
        ("toy: 3\n", ["section 'toy' must hold", "got 3"]),
        ("- toy\n", ["the file must hold", "['toy']"]),
        ("toy:\n  gain: 0\n", ["toy.gain is 0;", "a number in (0, 10], in 1/m"]),
        ("toy:\n  gain: 11\n", ["toy.gain is 11;"]),
        ("toy:\n  gain: true\n", ["toy.gain is True;", "a number"]),
        ("toy:\n  gain: '3'\n", ["toy.gain is '3';"]),
        ("toy:\n  gain:\n", ["toy.gain is None;"]),
        ("toy:\n  gain: {a: 1}\n", ["toy.gain is {'a': 1};"]),
        ("toy:\n  free: .nan\n", ["toy.free is nan;"]),
        ("toy:\n  free: -.inf\n", ["toy.free is -inf;"]),
        ("toy:\n  free: 1e999\n", ["toy.free is inf;"]),
        ("toy:\n  times: [1, .nan]\n", ["toy.times is nan;"]),
        ("toy:\n  times: [1, true]\n", ["toy.times is [1, True];", "a list of at least 1"]),
        ("toy:\n  times: [1, -1]\n", ["toy.times is [1, -1];", "each a number > 0"]),
        ("toy:\n  times: []\n", ["toy.times is [];"]),
        ("toy:\n  times: 1\n", ["toy.times is 1;"]),
        ("toy:\n  count: 3.0\n", ["toy.count is 3.0;", "a whole number"]),
        ("toy:\n  count: true\n", ["toy.count is True;"]),
        ("toy:\n  on: 1\n", ["toy.on is 1;", "true or false"]),
        ("toy:\n  on: yes\n", ["toy.on is 'yes';"]),
        ("toy:\n  kind: slow\n", ["toy.kind is 'slow';", "one of fast, good"]),
        ("toy:\n  horizon: soon\n", ["toy.horizon is 'soon';", "or goal"]),
        ("toy:\n  gain: 1\n  gain: 2\n", ["line 3", "'gain' stands twice"]),
        ("toy:\n  gain: 1\ntoy:\n  on: true\n", ["line 3", "'toy' stands twice"]),
        ("toy:\n  gain: [1\nother:\n", ["line 3", "broken YAML"]),
        ("toy:\n\tgain: 1\n", ["line 2", "broken YAML"]),
        ("? [1]\n: 2\n", ["line 1", "broken YAML"]),
        ("toy: !!python/object:os.system {}\n", ["line 1", "broken YAML"]),
        ("a: 1\n---\nb: 2\n", ["line 2", "broken YAML"]),
        (f"toy:\n  count: 1{'0' * 5000}\n", ["broken YAML", "digits"]),
    ],
)
def test_broken_file(toy, tmp_path, text, words):
    refused(["my.yaml", *words], written(tmp_path, text))


def test_no_usable_file(tmp_path):
    refused(["nowhere.yaml", "no such file"], tmp_path / "nowhere.yaml")
    refused([str(tmp_path), "folder"], tmp_path)
    path = tmp_path / "latin.yaml"
    path.write_bytes(b"# \xfc\n")
    refused(["latin.yaml", "cannot be read"], path)


@pytest.mark.parametrize("text", ["", "toy", "toy.gain", "gain=1", ".gain=1", "toy.=1", "=1"])
def test_broken_override(toy, text):
    refused(["--set", repr(text), "section.key=value"], None, text)


def test_override_is_named_as_the_source(toy, tmp_path):
    path = written(tmp_path, "toy:\n  gain: 2\n")
    refused(["--set: toy.gain is -1;"], path, "toy.gain=-1")
    refused(["--set: unknown key toy.gaim"], path, "toy.gaim=1")
    refused(["--set toy.gain, line 1", "broken YAML"], path, "toy.gain=[")


def test_file_is_named_beside_sound_overrides(toy, tmp_path):
    path = written(tmp_path, "toy:\n  count: 0\n")
    refused(["my.yaml: toy.count is 0;"], path, "toy.gain=1")


@given(st.floats().filter(lambda x: not 0 < x <= 10 or math.isnan(x)))
def test_no_number_outside_the_range_passes(value):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(config_files, "Config", ToyConfig)
        with pytest.raises(ConfigError, match=r"toy\.gain"):
            load_config(overrides=[f"toy.gain={value!r}"])
