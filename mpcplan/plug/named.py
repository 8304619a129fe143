"""The class behind a name 'package.module:Class', and what its exceptions say in one line."""

import importlib
import inspect
import os
import re
import sys
import traceback
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from mpcplan.config.base import CLASS
from mpcplan.errors import InputError, PlannerError

LONGEST = 300  # characters of a foreign message that are told
_HERE = Path(__file__).parent
OURS = tuple(str(_HERE.parent / folder) for folder in (_HERE.name, "simulate"))
"""Folders of code that only hands on calls: an error's place is not there."""


@dataclass(frozen=True)
class Part:
    """What a class can be named for.

    Attributes:
        name: in messages.
        method: that the class must have.
        arguments: of that method, in words.
        others: short names that may stand for a class, in words.
    """

    name: str
    method: str
    arguments: str
    others: str = ""


def class_named(spec: str, part: Part) -> type[Any]:
    """The class that 'package.module:Class' means.

    Modules are found as by ``python -m``: installed, or in the current directory.

    Raises:
        InputError: the spec is malformed, its module or class is missing, or lacks the method.
    """
    match = re.fullmatch(CLASS, spec)
    if match is None:
        other = f", or one of {part.others}" if part.others else ""
        raise InputError(f"{part.name} {spec!r}: expected package.module:Class{other}")
    name = match[2]
    module = _import(match[1], spec, part)
    found = getattr(module, name, None)
    if found is None:
        known = _candidates(module, part)
        raise InputError(f"{part.name} {spec!r}: module {match[1]} has no {name}{known}")
    if not inspect.isclass(found):
        kind = type(found).__name__
        raise InputError(f"{part.name} {spec!r}: {name} is a {kind}, not a class")
    if not has_method(found, part.method):
        wanted = f"{part.method}({part.arguments})"
        raise InputError(f"{part.name} {spec!r}: class {name} has no method {wanted}")
    return found


def asked(part: Part, spec: str, made: type[Any], when: str, call: Any, *arguments: Any) -> Any:
    """What a call of foreign code answers.

    Args:
        part: what its class is named for; spec: by which name; made: the class.
        when: the occasion, for the message; '' for none.
        call: what is called, with the arguments.

    Raises:
        PlannerError: it raised something; one line says what and where.
    """
    try:
        return call(*arguments)
    except Exception as error:
        place = f"{part.name} {spec!r}, {when}" if when else f"{part.name} {spec!r}"
        raise PlannerError(f"{place}: {brief(error, made)}") from error


def has_method(found: type[Any], name: str) -> bool:
    """Whether a class, or one that it is derived from, has a method of a name."""
    return any(callable(vars(one).get(name)) for one in found.__mro__)


def _import(name: str, spec: str, part: Part) -> ModuleType:
    """A module, installed or in the current directory."""
    here = os.getcwd()
    if here not in sys.path:
        sys.path.insert(0, here)  # as python -m does
    importlib.invalidate_caches()
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{name}.".startswith(f"{error.name}."):
            raise InputError(f"{part.name} {spec!r}: its import failed: {brief(error)}") from error
        raise InputError(
            f"{part.name} {spec!r}: there is no module {error.name}; install it, or start in the "
            f"folder that holds it (now {here})"
        ) from error
    except (Exception, SystemExit) as error:
        raise InputError(f"{part.name} {spec!r}: its import failed: {brief(error)}") from error


def _candidates(module: ModuleType, part: Part) -> str:
    """The classes of a module that could have been meant, in words."""
    classes = [
        name
        for name, value in vars(module).items()
        if inspect.isclass(value)
        and value.__module__ == module.__name__
        and has_method(value, part.method)
    ]
    return f"; it has {', '.join(classes)}" if classes else ""


def brief(error: BaseException, owner: type[Any] | None = None) -> str:
    """An exception in one line: class, message, file and line.

    The place is the innermost one within the folder of ``owner``'s module, else the innermost.
    """
    text = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")
    if len(text) > LONGEST:
        text = f"{text[:LONGEST]}..."
    return f"{text}{_place(error, owner)}"


def _place(error: BaseException, owner: type[Any] | None) -> str:
    """' (file:line)'; '' where no line of foreign code was reached."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if not _is_machinery(f)]
    if not frames:
        return ""
    module = sys.modules.get(owner.__module__) if owner is not None else None
    home = getattr(module, "__file__", None)
    near = [f for f in frames if home and f.filename.startswith(str(Path(home).parent))]
    last = (near or frames)[-1]
    return f" ({Path(last.filename).name}:{last.lineno})"


def _is_machinery(frame: traceback.FrameSummary) -> bool:
    """Whether a frame belongs to what hands on calls or to the import system."""
    return (
        frame.filename.startswith((*OURS, "<frozen importlib"))
        or Path(frame.filename).parent == Path(importlib.__file__).parent
    )
