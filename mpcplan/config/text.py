"""What a parameter allows, in words: 'a number in (0, 10]', 'one of recorded, constant_input'."""

import types
from collections.abc import Iterable
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

_TYPES = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a text",
}


def unit(field: FieldInfo) -> str:
    """The unit, '1' for dimensionless numbers and '' for what is no number."""
    extra = field.json_schema_extra
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


def allowed(field: FieldInfo, *, in_unit: bool = False) -> str:
    """The type and range, or the choices, that a parameter allows, with the unit if asked for."""
    text = _describe(field.annotation, field.metadata)
    return f"{text}, in {unit(field)}" if in_unit and unit(field) not in ("", "1") else text


def _describe(annotation: Any, limits: Iterable[Any] = ()) -> str:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _describe(arguments[0], [*limits, *_flat(annotation.__metadata__)])
    if origin is Literal:
        return _choices(arguments)
    if origin in (Union, types.UnionType):
        return " or ".join(_describe(option, limits) for option in arguments)
    if origin is tuple:
        return f"a list{_length(limits)}, each {_describe(arguments[0])}"
    if annotation is str and _limit(limits, "pattern") is not None:
        return "the name of a class of yours, package.module:Class"
    numeric = annotation in (int, float)
    return _TYPES[annotation] + (_range(limits) if numeric else "")


def _flat(metadata: Iterable[Any]) -> list[Any]:
    """The limits within an annotation's metadata, where pydantic's Field groups several."""
    limits: list[Any] = []
    for item in metadata:
        limits += item.metadata if isinstance(item, FieldInfo) else [item]
    return limits


def _choices(values: tuple[Any, ...]) -> str:
    names = ", ".join(str(value) for value in values)
    return f"one of {names}" if len(values) > 1 else names


def _limit(limits: Iterable[Any], name: str) -> Any:
    found = [getattr(limit, name) for limit in limits if hasattr(limit, name)]
    return found[0] if found else None


def _length(limits: Iterable[Any]) -> str:
    least, most = _limit(limits, "min_length"), _limit(limits, "max_length")
    words = [f"at least {least}"] if least else []
    words += [f"at most {most}"] if most else []
    return f" of {' and '.join(words)}" if words else ""


def _range(limits: Iterable[Any]) -> str:
    """' in [0, 1)', ' > 0', ... or '' without limits."""
    limits = list(limits)
    gt, ge, lt, le = (_limit(limits, name) for name in ("gt", "ge", "lt", "le"))
    low, high = (ge if gt is None else gt), (le if lt is None else lt)
    if low is not None and high is not None:
        left, right = "[" if gt is None else "(", "]" if lt is None else ")"
        return f" in {left}{low:.12g}, {high:.12g}{right}"
    if low is not None:
        return f" {'>=' if gt is None else '>'} {low:.12g}"
    if high is not None:
        return f" {'<=' if lt is None else '<'} {high:.12g}"
    return ""
