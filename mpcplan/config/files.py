"""Configuration files: YAML with sections, checked value by value, and written with comments.

A file may hold any part of the parameters; the rest keep their defaults. Every mistake is a
:class:`ConfigError` that names the file (or ``--set``), the dotted key, the value and what is
allowed.
"""

import difflib
import math
import reprlib
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError
from pydantic.fields import FieldInfo

from mpcplan.config import Config, Section
from mpcplan.config.parse import parse
from mpcplan.config.text import allowed, unit
from mpcplan.errors import ConfigError

OVERRIDE = "--set"  # the command line's option, named in messages
_WIDTH = 100  # characters of a line in written files
_Key = tuple[str, str]  # section and parameter


def load_config(path: str | Path | None = None, overrides: Sequence[str] = ()) -> Config:
    """The configuration of a file, with overrides.

    Args:
        path: YAML file with sections; None for the defaults.
        overrides: 'section.key=value' with the value in YAML, the last of equal keys wins.

    Raises:
        ConfigError: the file cannot be read, or a key or value is at fault.
    """
    values: dict[_Key, Any] = {}
    sources: dict[_Key, str] = {}
    settings = [] if path is None else [(str(path), _read_file(Path(path)))]
    settings += [(OVERRIDE, _read_override(text)) for text in overrides]
    for source, setting in settings:
        for key, value in _flat(setting, source):
            values[key], sources[key] = _plain(value, key, source), source
    return _validated(values, sources)


def _read_file(path: Path) -> Any:
    if path.is_dir():
        raise ConfigError(f"{path}: this is a folder; give one configuration file (.yaml)")
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise ConfigError(f"{path}: no such file") from error
    except (OSError, UnicodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    return parse(text, str(path))


def _read_override(text: str) -> dict[str, dict[str, Any]]:
    dotted, equals, value = text.partition("=")
    section, dot, key = dotted.strip().partition(".")
    if not (equals and dot and section and key):
        raise ConfigError(f"{OVERRIDE} {text!r}: expected section.key=value")
    return {section: {key: parse(value, f"{OVERRIDE} {section}.{key}")}}


def _flat(setting: Any, source: str) -> Iterable[tuple[_Key, Any]]:
    """The parameters of a file or override; raises ConfigError for unknown keys."""
    for section, entries in _mapping(setting, source, "the file").items():
        if section not in Config.model_fields:
            raise ConfigError(f"{source}: unknown section {section!r}{_nearest(section)}")
        known = section_type(section).model_fields
        for key, value in _mapping(entries, source, f"section {section!r}").items():
            if key not in known:
                raise ConfigError(f"{source}: unknown key {section}.{key}{_nearest(key, section)}")
            yield (section, key), value


def _mapping(value: Any, source: str, what: str) -> dict[Any, Any]:
    """A mapping; an empty file or section counts as one without entries."""
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise ConfigError(f"{source}: {what} must hold 'key: value' lines, got {value!r}")
    return value


def section_type(section: str) -> type[Section]:
    """The model of a section."""
    annotation = Config.model_fields[section].annotation
    assert isinstance(annotation, type)
    assert issubclass(annotation, Section)
    return annotation


def _nearest(wrong: object, section: str | None = None) -> str:
    """'; did you mean ...?' with the nearest name in the section, else with the same key elsewhere,
    else what there is.
    """
    wrong = str(wrong)
    known = list(section_type(section).model_fields if section else Config.model_fields)
    close = difflib.get_close_matches(wrong, known, n=1)
    if not close:
        everything = ((s, k) for s in Config.model_fields for k in section_type(s).model_fields)
        close = [f"{s}.{k}" for s, k in everything if k == wrong]
    if close:
        return f"; did you mean {' or '.join(close)}?"
    return f"; known are {', '.join(known)}"


def _plain(value: Any, key: _Key, source: str) -> Any:
    """The value with tuples for lists; raises ConfigError for numbers that are not finite."""
    if isinstance(value, list):
        return tuple(_plain(entry, key, source) for entry in value)
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(_complaint(key, value, source))
    return value


def _validated(values: dict[_Key, Any], sources: dict[_Key, str]) -> Config:
    nested: dict[str, dict[str, Any]] = {}
    for (section, key), value in values.items():
        nested.setdefault(section, {})[key] = value
    try:
        # strict: neither true nor '3' passes as a number
        return Config.model_validate(nested, strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        place = tuple(str(part) for part in first["loc"][:2])
        for parameter, source in sources.items():
            if parameter == place:
                raise ConfigError(_complaint(parameter, values[parameter], source)) from error
        # a rule about several parameters
        where = ", ".join(dict.fromkeys(sources.values()))
        raise ConfigError(f"{where}: {'.'.join(place)}: {first['msg']}") from error


def _complaint(key: _Key, value: Any, source: str) -> str:
    section, name = key
    shown = reprlib.repr(list(value) if isinstance(value, tuple) else value)
    field = section_type(section).model_fields[name]
    return f"{source}: {section}.{name} is {shown}; allowed is {allowed(field, in_unit=True)}"


def dump_config(config: Config) -> str:
    """YAML text of all parameters, each below a comment with its meaning, range and unit."""
    lines = _comment(Config.__doc__, "")
    for section, field in Config.model_fields.items():
        entries = getattr(config, section)
        lines += ["", *_comment(type(entries).__doc__ or field.description, ""), f"{section}:"]
        for key, parameter in type(entries).model_fields.items():
            lines += _comment(_meaning(parameter), "  ")
            lines.append(f"  {key}: {_scalar(getattr(entries, key))}")
    return "\n".join(lines) + "\n"


def _meaning(parameter: FieldInfo) -> str:
    """'weight of the jerk [s^5/m^2]: a number in [0, 1000]'."""
    brackets = f" [{unit(parameter)}]" if unit(parameter) else ""
    return f"{parameter.description}{brackets}: {allowed(parameter)}"


def _comment(text: str | None, indent: str) -> list[str]:
    flat = " ".join((text or "").split())
    prefix = f"{indent}# "
    return textwrap.wrap(flat, _WIDTH, initial_indent=prefix, subsequent_indent=prefix)


def _scalar(value: Any) -> str:
    """A value as YAML on one line."""
    value = list(value) if isinstance(value, tuple) else value
    text: str = yaml.safe_dump(value, default_flow_style=True, width=math.inf)
    text = text.removesuffix("...\n").strip()
    if isinstance(value, str) and parse(text, "") != value:  # a number to us, not to PyYAML: 0E0
        text = yaml.safe_dump(value, default_style='"', width=math.inf).strip()
    return text
