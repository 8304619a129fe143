"""The class behind the name of a planner."""

from typing import Any

from mpcplan.plug.named import Part, class_named

SHIPPED = {  # short names
    "mpcplan": "mpcplan.planner:Planner",
    "constant_velocity": "mpcplan.baselines.constant_velocity:ConstantVelocity",
    "idm": "mpcplan.baselines.idm:IdmPurePursuit",
}
PLANNER = Part("planner", "plan", "observation", ", ".join(SHIPPED))


def find_class(spec: str) -> type[Any]:
    """The class that 'package.module:Class' or a short name of :data:`SHIPPED` means.

    Raises:
        InputError: the spec is malformed, its module or class is missing, or has no ``plan``.
    """
    return class_named(SHIPPED.get(spec, spec), PLANNER)
