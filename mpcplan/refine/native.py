"""CasADi functions as machine code: written as C, compiled once, and kept.

CasADi evaluates a function operation by operation; compiled, the same operations in the same order
take a tenth of the time. No contraction of operations is allowed and no fast mathematics, so that
the results are the same bits, which is tried out before a compiled function is taken. Without a
compiler everything works as before, only slower.
"""

import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import casadi as ca
import numpy as np

COMPILERS = ("cc", "gcc", "clang")
FLAGS = ("-O2", "-ffp-contract=off", "-fno-builtin", "-fPIC", "-shared")
NAME = "mpcplan"
SECONDS = 120  # for the compiler at most
PROBE = 7  # seed of the arguments with which results are compared


def as_machine_code(made: Sequence[ca.Function]) -> list[ca.Function]:
    """The same functions compiled, or as they are where that is not possible."""
    library = _compiled(_source(made))
    if library is None:
        return list(made)
    try:
        found = [ca.external(function.name(), str(library)) for function in made]
    except RuntimeError:  # a file that is none of ours, or broken
        library.unlink(missing_ok=True)
        return list(made)
    same = all(_agree(one, other) for one, other in zip(made, found, strict=True))
    return found if same else list(made)


def cache_folder() -> Path:
    """Where compiled functions are kept; $XDG_CACHE_HOME/mpcplan or ~/.cache/mpcplan."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / NAME


def _source(made: Sequence[ca.Function]) -> str:
    generator = ca.CodeGenerator(f"{NAME}.c")
    for function in made:
        generator.add(function)
    text: str = generator.dump()
    return text


def _compiled(source: str) -> Path | None:
    """The library of a source; None where there is no compiler, or it fails."""
    compiler = next((path for path in map(shutil.which, COMPILERS) if path), None)
    if compiler is None:
        return None
    told = "\0".join([source, compiler, *FLAGS, platform.machine()])
    try:
        folder = cache_folder()
        library = folder / f"{hashlib.sha256(told.encode()).hexdigest()[:32]}.so"
        if not library.exists():
            folder.mkdir(parents=True, exist_ok=True)
            _compile(compiler, source, library)
    except (OSError, RuntimeError, subprocess.SubprocessError):
        return None
    return library


def _compile(compiler: str, source: str, library: Path) -> None:
    """Writes the library whole or not at all: others may want it at the same time."""
    handle, name = tempfile.mkstemp(suffix=".so", dir=library.parent)
    os.close(handle)
    try:
        command = [compiler, *FLAGS, "-x", "c", "-", "-o", name, "-lm"]
        subprocess.run(
            command, input=source.encode(), check=True, capture_output=True, timeout=SECONDS
        )
        os.replace(name, library)
    finally:
        Path(name).unlink(missing_ok=True)


def _agree(one: ca.Function, other: ca.Function) -> bool:
    """Whether two functions give the same bits for the same arguments."""
    random = np.random.default_rng(PROBE)
    arguments = [random.uniform(0.1, 1.0, one.size_in(i)) for i in range(one.n_in())]
    results = [function.call(arguments) for function in (one, other)]
    return all(np.array_equal(np.asarray(a), np.asarray(b)) for a, b in zip(*results, strict=True))
