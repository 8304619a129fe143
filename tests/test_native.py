"""Functions as machine code: the same bits, kept for the next time, and done without."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from mpcplan.config import Config
from mpcplan.refine import native
from mpcplan.refine.compiled import Functions
from mpcplan.refine.native import as_machine_code, cache_folder


@pytest.fixture
def cache(monkeypatch, tmp_path) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "mpcplan"


@pytest.fixture
def made() -> list[ca.Function]:
    x = ca.SX.sym("x", 3)
    return [
        ca.Function("first", [x], [ca.sin(x) * ca.exp(x), ca.fmax(x[0], x[1])]),
        ca.Function("second", [x], [ca.sqrt(ca.sumsqr(x)) / 3]),
    ]


needs_compiler = pytest.mark.skipif(
    not any(map(native.shutil.which, native.COMPILERS)), reason="there is no C compiler"
)


def is_compiled(function: ca.Function) -> bool:
    return "External" in function.class_name()


@needs_compiler
def test_compiled_functions_give_the_same_bits(cache, made):
    found = as_machine_code(made)
    assert all(map(is_compiled, found))
    random = np.random.default_rng(3)
    for x in random.normal(size=(50, 3)):
        for one, other in zip(made, found, strict=True):
            for a, b in zip(one.call([x]), other.call([x]), strict=True):
                assert np.array_equal(np.asarray(a), np.asarray(b))


@needs_compiler
def test_the_problems_functions_give_the_same_bits(cache):
    dt, refine = 0.1, Config().refine.model_copy(update={"compile": False})
    slow = Functions(Config().model_copy(update={"refine": refine}), dt)
    fast = Functions(Config(), dt)
    assert is_compiled(fast.model) and not is_compiled(slow.model)
    random = np.random.default_rng(0)
    for name in ("values", "model"):
        one, other = getattr(slow, name), getattr(fast, name)
        for _ in range(20):
            given = [random.normal(size=one.size_in(i)) for i in range(one.n_in())]
            for a, b in zip(one.call(given), other.call(given), strict=True):
                assert np.array_equal(np.asarray(a), np.asarray(b), equal_nan=True)


@needs_compiler
def test_what_is_compiled_is_kept(cache, made, monkeypatch):
    as_machine_code(made)
    (library,) = cache.iterdir()
    before = library.stat().st_mtime_ns

    def never(*_: object) -> None:
        raise AssertionError("compiled again")

    monkeypatch.setattr(native, "_compile", never)
    assert all(map(is_compiled, as_machine_code(made)))
    assert library.stat().st_mtime_ns == before


def test_without_a_compiler_the_functions_are_as_they_were(cache, made, monkeypatch):
    monkeypatch.setattr(native.shutil, "which", lambda name: None)
    assert as_machine_code(made) == made
    assert not cache.exists()


@needs_compiler
def test_a_compiler_that_fails_is_done_without(cache, made, monkeypatch):
    monkeypatch.setattr(native, "FLAGS", ("--no-such-flag",))
    assert as_machine_code(made) == made
    assert list(cache.iterdir()) == []  # nothing half done is left


@needs_compiler
def test_a_broken_file_is_removed(cache, made):
    as_machine_code(made)
    (library,) = cache.iterdir()
    library.unlink()
    library.write_bytes(b"no library")
    assert not any(map(is_compiled, as_machine_code(made)))
    assert all(map(is_compiled, as_machine_code(made)))  # made anew


def test_a_folder_that_cannot_be_written_is_done_without(made, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert as_machine_code(made) == made


def test_results_of_other_bits_are_refused(made):
    x = ca.SX.sym("x", 3)
    other = ca.Function("first", [x], [ca.sin(x) * ca.exp(x) * (1 + 1e-15), ca.fmax(x[0], x[1])])
    assert native._agree(made[0], made[0]) and not native._agree(made[0], other)


def test_the_folder(monkeypatch, tmp_path):
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "mpcplan"
