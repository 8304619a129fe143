"""HPIPM called as the library that CasADi brings: quadratic problems in stages k = 0..N,

    min  sum_k  1/2 x_k' Q_k x_k + u_k' S_k x_k + 1/2 u_k' R_k u_k + q_k' x_k + r_k' u_k
    s.t. x_{k+1} = A_k x_k + B_k u_k + b_k,
         lbx_k <= x_k[idxbx_k] <= ubx_k,  lbu_k <= u_k[idxbu_k] <= ubu_k,
         lg_k <= C_k x_k + D_k u_k <= ug_k,

each stage with numbers of states, inputs and constraints of its own. An interior-point method whose
steps are found by a Riccati recursion. Through CasADi's own plugin most of the time would go into
bringing the problem into sparse matrices and out of them again.

Source: Frison, Diehl: HPIPM, a high-performance quadratic programming framework for model
predictive control (IFAC 2020).
"""

import ctypes
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from mpcplan.errors import InputError

LIBRARY = "libhpipm.so"
ALIGNMENT = 64  # bytes, as BLASFEO's kernels want it
RELATIVE = 1  # the library's mode "speed" with steps relative to the iterate
STATUS = (
    "solved",
    "maximum iterations reached",
    "smallest step reached",
    "not a number",
    "inconsistent",
)
_SIZES = ("nx", "nu", "nbx", "nbu", "ng")
_MATRICES = ("A", "B", "C", "D", "Q", "S", "R")
_VECTORS = ("b", "q", "r", "lbx", "ubx", "lbu", "ubu", "lg", "ug")
_INDICES = ("idxbx", "idxbu")
_ORDER = (
    *("A", "B", "b", "Q", "S", "R", "q", "r", "idxbx", "lbx", "ubx", "idxbu", "lbu", "ubu"),
    *("C", "D", "lg", "ug"),
)  # of the library's arguments; those of its soft constraints follow
_N_SOFT = 8
_FOUND = ("u", "x", "sl", "su", "pi", "lam_lb", "lam_ub", "lam_lg", "lam_ug", "lam_ls", "lam_us")

Pointer = ctypes.c_void_p


@dataclass(frozen=True)
class Settings:
    """Of the interior-point method.

    Attributes:
        iterations: at most.
        tolerance: of all residuals.
        mu0: complementarity at the start.
    """

    iterations: int
    tolerance: float
    mu0: float


@dataclass(frozen=True)
class Sizes:
    """Numbers of every stage, (N + 1,) each: states, inputs, bounds of states and of inputs, and
    other constraints."""

    nx: tuple[int, ...]
    nu: tuple[int, ...]
    nbx: tuple[int, ...]
    nbu: tuple[int, ...]
    ng: tuple[int, ...]

    @property
    def n(self) -> int:
        """N."""
        return len(self.nx) - 1

    @cached_property
    def of(self) -> dict[str, NDArray[np.int64]]:
        """Numbers of entries that a quantity has in every stage; of what leads to the next stage
        the last has none."""
        nx, nu, nbx, nbu, ng = (np.array(getattr(self, name)) for name in _SIZES)
        following = np.append(nx[1:], 0)
        none = np.zeros_like(nx)
        return {
            "A": following * nx, "B": following * nu, "b": following, "Q": nx * nx, "S": nu * nx,
            "R": nu * nu, "q": nx, "r": nu, "C": ng * nx, "D": ng * nu, "lg": ng, "ug": ng,
            "idxbx": nbx, "lbx": nbx, "ubx": nbx, "idxbu": nbu, "lbu": nbu, "ubu": nbu,
            "u": nu, "x": nx, "pi": following, "lam_lb": nbu + nbx, "lam_ub": nbu + nbx,
            "lam_lg": ng, "lam_ug": ng, "sl": none, "su": none, "lam_ls": none, "lam_us": none,
        }  # fmt: skip


class Stacked:
    """One quantity of all stages, one after the other; matrices column by column.

    Attributes:
        values: of all stages.
        start: where each stage's begin.
    """

    def __init__(self, lengths: NDArray[np.int64], values: NDArray[Any]) -> None:
        self.start = np.concatenate([[0], np.cumsum(lengths)])[:-1]
        self.values = values
        places = values.ctypes.data + self.start * values.itemsize
        self._places = places.astype(np.uintp)
        self.pointers = Pointer(self._places.ctypes.data)


class StageQp:
    """A solver for problems of the same sizes: fill in what is in ``data``, then :meth:`solve`.

    Attributes:
        data: the problem's quantities by name.
        matrices: the values of all matrices together: A, B, C, D, Q, S, R; ``first`` says where
            each of them begins.
        found: x, u, pi (multipliers of the dynamics), and lam_lb, lam_ub (of the bounds: the
            inputs' first), lam_lg, lam_ug of the last solution.
    """

    def __init__(self, sizes: Sizes, settings: Settings) -> None:
        """Raises:
        InputError: the library is missing, or not the one that we know.
        """
        self._library = library()
        self._sizes, of = sizes, sizes.of
        lengths = [int(of[name].sum()) for name in _MATRICES]
        starts = np.concatenate([[0], np.cumsum(lengths)])
        self.first = dict(zip(_MATRICES, starts[:-1].tolist(), strict=True))
        self.matrices = np.zeros(starts[-1])
        self.data = {
            name: Stacked(of[name], self.matrices[start : start + length])
            for (name, start), length in zip(self.first.items(), lengths, strict=True)
        }
        for names, kind in ((_VECTORS, np.float64), (_INDICES, np.int32)):
            for name in names:
                self.data[name] = Stacked(of[name], np.zeros(of[name].sum(), kind))
        self.found = {name: Stacked(of[name], np.zeros(of[name].sum())) for name in _FOUND}
        self._create(settings)

    def _create(self, settings: Settings) -> None:
        """The library's own structures, in memory of ours."""
        lib, n = self._library, self._sizes.n
        self._kept: list[NDArray[Any]] = []
        dim = self._structure("ocp_qp_dim", n)
        numbers = [np.array(getattr(self._sizes, name), np.int32) for name in _SIZES]
        numbers.append(np.zeros(n + 1, np.int32))  # soft constraints
        lib.d_ocp_qp_dim_set_all(*(Pointer(array.ctypes.data) for array in numbers), dim)
        self._qp = self._structure("ocp_qp", dim)
        self._solution = self._structure("ocp_qp_sol", dim)
        self._settings = self._structure("ocp_qp_ipm_arg", dim)
        lib.d_ocp_qp_ipm_arg_set_default(RELATIVE, self._settings)
        tolerance = {f"tol_{name}": settings.tolerance for name in ("stat", "eq", "ineq", "comp")}
        for name, value in {**tolerance, "mu0": settings.mu0}.items():
            self._set(name, ctypes.c_double(value))
        self._set("iter_max", ctypes.c_int(settings.iterations))
        self._set("comp_res_pred", ctypes.c_int(0))  # residuals of predictors, which decide nothing
        self._workspace = self._structure("ocp_qp_ipm_ws", dim, self._settings)
        soft = [Pointer(self.found["sl"].pointers.value)] * _N_SOFT  # of no stage anything
        self._given = [*(self.data[name].pointers for name in _ORDER), *soft, self._qp]
        self._wanted = [self._solution, *(self.found[name].pointers for name in _FOUND)]
        self._status, self._iterations = ctypes.c_int(), ctypes.c_int()

    def _structure(self, name: str, *of: Any) -> Pointer:
        """One of the library's structures, created in memory that is kept."""
        lib = self._library
        structure = self._memory(getattr(lib, f"d_{name}_strsize")())
        memory = self._memory(getattr(lib, f"d_{name}_memsize")(*of))
        getattr(lib, f"d_{name}_create")(*of, structure, memory)
        return structure

    def _memory(self, size: int) -> Pointer:
        kept = np.zeros(size + ALIGNMENT, np.uint8)
        self._kept.append(kept)
        return Pointer(-(-kept.ctypes.data // ALIGNMENT) * ALIGNMENT)

    def _set(self, name: str, value: ctypes.c_int | ctypes.c_double) -> None:
        getattr(self._library, f"d_ocp_qp_ipm_arg_set_{name}")(ctypes.byref(value), self._settings)

    def ask(self, name: str, stage: int, which: NDArray[np.bool_]) -> None:
        """Which of a stage's bounds count; ``name`` is lbx, ubx, lbu, ubu, lg or ug."""
        mask = np.array(which, float)
        place = Pointer(mask.ctypes.data)
        getattr(self._library, f"d_ocp_qp_set_{name}_mask")(stage, place, self._qp)

    def solve(self) -> tuple[str, int]:
        """Solves what is in ``data``; returns one of :data:`STATUS` and the iterations."""
        lib = self._library
        lib.d_ocp_qp_set_all(*self._given)
        lib.d_ocp_qp_ipm_solve(self._qp, self._solution, self._settings, self._workspace)
        lib.d_ocp_qp_sol_get_all(*self._wanted)
        lib.d_ocp_qp_ipm_get_status(self._workspace, ctypes.byref(self._status))
        lib.d_ocp_qp_ipm_get_iter(self._workspace, ctypes.byref(self._iterations))
        return STATUS[self._status.value], self._iterations.value


def _load() -> ctypes.CDLL:
    """The library of the installed CasADi.

    Raises:
        InputError: there is none, or its interface is older than the one that we know.
    """
    path = Path(casadi.__file__).parent / LIBRARY
    told = f"refine backend 'hpipm': CasADi {version('casadi')}"
    try:
        lib = ctypes.CDLL(str(path))
    except OSError as error:
        raise InputError(f"{told} does not bring {LIBRARY} ({error}); install its wheel") from error
    if not hasattr(lib, "d_ocp_qp_set_idxs_rev"):
        raise InputError(f"{told} brings another interface of HPIPM; install 3.8")
    for name in ("ocp_qp_dim", "ocp_qp", "ocp_qp_sol", "ocp_qp_ipm_arg", "ocp_qp_ipm_ws"):
        for size in ("strsize", "memsize"):
            getattr(lib, f"d_{name}_{size}").restype = ctypes.c_size_t
    return lib


library = cache(_load)
"""The library, loaded once."""
