"""The class behind the name of a planner, and what its exceptions say in one line."""

import importlib
import inspect
import os
import re
import sys
import traceback
from pathlib import Path
from types import ModuleType
from typing import Any

from mpcplan.errors import InputError

SHIPPED = {  # short names
    "mpcplan": "mpcplan.planner:Planner",
    "constant_velocity": "mpcplan.baselines.constant_velocity:ConstantVelocity",
    "idm": "mpcplan.baselines.idm:IdmPurePursuit",
}
SPEC = re.compile(r"([^\W\d]\w*(?:\.[^\W\d]\w*)*):([^\W\d]\w*)")
LONGEST = 300  # characters of a foreign message that are told


def find_class(spec: str) -> type[Any]:
    """The class that 'package.module:Class' or a short name of :data:`SHIPPED` means.

    Raises:
        InputError: the spec is malformed, its module or class is missing, or has no ``plan``.
    """
    match = SPEC.fullmatch(SHIPPED.get(spec, spec))
    if match is None:
        raise InputError(
            f"planner {spec!r}: expected package.module:Class, or one of {', '.join(SHIPPED)}"
        )
    name = match[2]
    module = _import(match[1], spec)
    found = getattr(module, name, None)
    if found is None:
        raise InputError(f"planner {spec!r}: module {match[1]} has no {name}{_candidates(module)}")
    if not inspect.isclass(found):
        raise InputError(f"planner {spec!r}: {name} is a {type(found).__name__}, not a class")
    if not callable(getattr(found, "plan", None)):
        raise InputError(f"planner {spec!r}: class {name} has no method plan(observation)")
    return found


def _import(name: str, spec: str) -> ModuleType:
    """A module, installed or in the current directory."""
    here = os.getcwd()
    if here not in sys.path:
        sys.path.insert(0, here)  # as python -m does
    importlib.invalidate_caches()
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{name}.".startswith(f"{error.name}."):
            raise InputError(f"planner {spec!r}: its import failed: {brief(error)}") from error
        raise InputError(
            f"planner {spec!r}: there is no module {error.name}; install it, or start in the "
            f"folder that holds it (now {here})"
        ) from error
    except (Exception, SystemExit) as error:
        raise InputError(f"planner {spec!r}: its import failed: {brief(error)}") from error


def _candidates(module: ModuleType) -> str:
    """The classes of a module that could have been meant, in words."""
    classes = [
        name
        for name, value in vars(module).items()
        if inspect.isclass(value) and value.__module__ == module.__name__ and hasattr(value, "plan")
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
    ours = str(Path(__file__).parent)
    frames = [f for f in traceback.extract_tb(error.__traceback__) if not _is_machinery(f, ours)]
    if not frames:
        return ""
    module = sys.modules.get(owner.__module__) if owner is not None else None
    home = getattr(module, "__file__", None)
    near = [f for f in frames if home and f.filename.startswith(str(Path(home).parent))]
    last = (near or frames)[-1]
    return f" ({Path(last.filename).name}:{last.lineno})"


def _is_machinery(frame: traceback.FrameSummary, ours: str) -> bool:
    """Whether a frame belongs to this folder or to the import system."""
    return (
        frame.filename.startswith((ours, "<frozen importlib"))
        or Path(frame.filename).parent == Path(importlib.__file__).parent
    )
