"""A solver of quadratic problems that is not ours: found by name, and its answers checked."""

from typing import Any

import numpy as np

from mpcplan.errors import PlannerError
from mpcplan.plug.named import Part, asked, class_named
from mpcplan.refine.layout import Layout
from mpcplan.trajectory import Array

BACKEND = Part("refine backend", "__call__", "problem, y")


class ForeignBackend:
    """Solves by a class 'package.module:Class'.

    It is built as ``Class(layout)`` with :class:`mpcplan.refine.layout.Layout`, once for all
    problems of a sparsity, then called as :class:`mpcplan.refine.backends.QpBackend` is and answers
    a :class:`mpcplan.refine.backends.Answer`.
    """

    levelled = True

    def __init__(self, spec: str, layout: Layout) -> None:
        """Builds the solver.

        Raises:
            InputError: the name leads to no usable class.
            PlannerError: the class could not be built.
        """
        self._spec, self._make = spec, class_named(spec, BACKEND)
        self._shapes = {"p": (layout.n_vars,), "y": (layout.n_rows,)}
        self._solver = self._ask(self._make, layout)

    def __call__(self, problem: Any, y: Array | None) -> Any:
        """Its answer.

        Raises:
            PlannerError: it failed, or answered what is no answer.
        """
        answer = self._ask(self._solver, problem, y)
        for name, shape in self._shapes.items():
            found = getattr(answer, name, None)
            if not isinstance(found, np.ndarray) or found.shape != shape:
                told = found.shape if isinstance(found, np.ndarray) else type(found).__name__
                raise PlannerError(
                    f"{BACKEND.name} {self._spec!r}: {name} of its answer is {told}, expected an "
                    f"array {shape}"
                )
        if not isinstance(getattr(answer, "status", None), str):
            raise PlannerError(f"{BACKEND.name} {self._spec!r}: its answer has no status")
        return answer

    def _ask(self, call: Any, *arguments: Any) -> Any:
        return asked(BACKEND, self._spec, self._make, "", call, *arguments)
