"""Roles in docstrings, :class:`mpcplan.plan.Plan`, as links of the API reference."""

from __future__ import annotations

import re
from typing import Any

import griffe

ROLE = re.compile(r":(?:class|func|mod|data|meth|attr|exc):`~?([^`]+)`")


class Roles(griffe.Extension):
    """Rewrites the roles of every docstring."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Called for every module, class and function."""
        if obj.docstring is not None:
            docstring = obj.docstring
            docstring.value = ROLE.sub(lambda role: _link(role[1], obj), docstring.value)


def _link(name: str, obj: griffe.Object) -> str:
    """A link where the reference has the name, else the name alone."""
    return f'<autoref optional identifier="{_path(name, obj)}"><code>{name}</code></autoref>'


def _path(name: str, obj: griffe.Object) -> str:
    """The full path of a name as it is seen from an object."""
    if name.startswith("mpcplan."):
        return name
    module = obj.module
    if name.startswith("."):
        package = module if module.is_package or module.parent is None else module.parent
        return f"{package.path}{name}"
    return f"{module.path}.{name}"
