"""The comparison of solvers as the command line prints it."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import get_args

from mpcplan.bench.table import align
from mpcplan.config import Backend, Config, KnownBackend
from mpcplan.config.base import CLASS
from mpcplan.errors import InputError
from mpcplan.solvers.compare import lines, try_solvers
from mpcplan.solvers.record import GOES_ON, TO_GOAL, Recorded, chosen, record_problems

DEFAULT: tuple[Backend, ...] = ("osqp", "piqp multistage", "hpipm", "fatrop", "ipopt")
GROUPS = ((GOES_ON, (30, 30)), (TO_GOAL, (30, 40)), (TO_GOAL, (80, 130)))


def known_backends(text: str | None) -> list[Backend]:
    """The solvers named in a list 'A,B', the default ones without a list; raises InputError."""
    if text is None:
        return list(DEFAULT)
    known, names = get_args(KnownBackend), [name.strip() for name in text.split(",")]
    for name in names:
        if name not in known and not re.fullmatch(CLASS, name):
            raise InputError(
                f"no solver {name!r}; there are: {', '.join(known)}, and classes of yours as "
                "package.module:Class"
            )
    return list(names)


def compare_solvers(
    paths: Sequence[Path], backends: Sequence[Backend], config: Config, most: int,
    tell: Callable[[str], None],
) -> list[str]:  # fmt: skip
    """Tables of all groups of problems that come up in the scenarios.

    Args:
        paths: scenarios.
        backends: the solvers' names.
        config: the planner's.
        most: problems of each group.
        tell: is told what is being done.

    Raises:
        InputError: a scenario cannot be read, or a solver is not installed.
    """
    problems: list[Recorded] = []
    for path in paths:
        tell(f"driving {path.stem}")
        problems += record_problems(path, config)
    printed: list[str] = []
    for kind, steps in GROUPS:
        group = chosen(problems, kind, steps, most)
        if not group:
            continue
        scenarios = len({recorded.scenario for recorded in group})
        length = f"{steps[0]} to {steps[1]}" if steps[0] < steps[1] else f"{steps[0]}"
        head = f"{kind}, {length} steps: {len(group)} problems of {scenarios} scenarios"
        columns = try_solvers(group, backends, config, lambda name, n: tell(f"{name}: problem {n}"))
        printed += [head, align(lines(columns)), ""]
    if not printed:
        raise InputError("no problem of these scenarios has 30 to 40 or 80 to 130 steps")
    return printed
