"""Reading of pickles from strangers: a machine for the few instructions that settings need.

A pickle is a program, and Python's unpickler runs whatever it names. This reader executes no
Python object at all: it walks the instructions (:func:`pickletools.genops` takes them apart without
running them), knows a short list of classes by name, and builds inert :class:`Record` values of
them. Every other class or function, every other instruction (persistent ids, extension codes, ...)
and every size beyond the limits is refused. The stock unpickler with a restricted ``find_class``
would still allocate memory as a hostile file likes (memo indices, lengths) and hash nested tuples
for exponential time.
"""

import pickletools
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpcplan.errors import InputError

MAX_BYTES = 100_000  # the genuine files have 1,500 to 2,500
MAX_INSTRUCTIONS = 100_000
_SHOWN = 80  # characters
_SHOWN_INT = 2**63


@dataclass(frozen=True, eq=False)
class Class:
    """A class that a pickle names; it is known by its name only."""

    name: str


@dataclass(eq=False)
class Record:
    """What a pickle says of an object: its class's name, its arguments and its attributes."""

    name: str
    arguments: tuple[Any, ...] = ()
    fields: dict[str, Any] = field(default_factory=dict)


class _Mark:
    """Where a group of values begins on the stack."""


@dataclass(frozen=True, eq=False)
class _Dtype:
    """numpy.dtype with the little-endian format of :mod:`struct`."""

    code: str


# numpy's names of the scalars that settings hold, and their formats
_FORMATS = {"f8": "d", "f4": "f", "i8": "q", "i4": "i", "i2": "h", "i1": "b", "u8": "Q"} | {
    "u4": "I",
    "u2": "H",
    "u1": "B",
    "b1": "?",
}


def read(path: Path, records: frozenset[str], values: frozenset[str]) -> Any:
    """The value that a pickle file describes, with :class:`Record` in place of objects.

    Args:
        path: the file.
        records: full names of classes whose instances have attributes.
        values: full names of classes that are called with one plain value, such as enumerations;
            the record's ``arguments`` hold it.

    Raises:
        InputError: unreadable, no pickle, too large, or it names anything else; the message says
            which class.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        if len(data) > MAX_BYTES:
            raise InputError(f"longer than {MAX_BYTES} bytes, which settings are not")
        return _Machine(records, values).run(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (ValueError, IndexError, KeyError, TypeError, struct.error, OverflowError) as error:
        detail = f"{type(error).__name__}: {error}"
        raise InputError(f"{path}: no valid pickle ({detail})") from error


class _Machine:
    """The stack and the memo of one pickle."""

    def __init__(self, records: frozenset[str], values: frozenset[str]) -> None:
        self._records, self._values = records, values
        self._stack: list[Any] = []
        self._memo: dict[int, Any] = {}
        self._count = 0

    def run(self, data: bytes) -> Any:
        """Executes the instructions up to STOP."""
        for opcode, argument, _ in pickletools.genops(data):
            self._count += 1
            if self._count > MAX_INSTRUCTIONS:
                raise InputError(
                    f"more than {MAX_INSTRUCTIONS} instructions, which settings are not"
                )
            if opcode.name == "STOP":
                return self._pop()
            self._step(opcode.name, argument)
        raise InputError("no valid pickle (no end)")

    def _step(self, name: str, argument: Any) -> None:
        if name in _IGNORED:
            return
        if name in _PLAIN:
            self._stack.append(argument)
        elif name in _CONSTANTS:
            self._stack.append(_CONSTANTS[name]())
        elif name in _METHODS:
            _METHODS[name](self, argument)
        else:
            raise InputError(f"the pickle instruction {name} is refused")

    def _pop(self) -> Any:
        value = self._stack.pop()
        if isinstance(value, _Mark):
            raise InputError("no valid pickle (mark out of place)")
        return value

    def _pop_to_mark(self) -> list[Any]:
        group: list[Any] = []
        while not isinstance(value := self._stack.pop(), _Mark):
            group.append(value)
        return group[::-1]

    def _top(self, kind: type) -> Any:
        """The uppermost value, which must be of a kind."""
        if not isinstance(self._stack[-1], kind):
            raise InputError(f"no valid pickle ({kind.__name__} expected)")
        return self._stack[-1]

    # ------------------------------------------------------------ containers

    def tuple_of(self, count: int) -> None:
        """TUPLE1 to TUPLE3."""
        values = [self._pop() for _ in range(count)]
        self._stack.append(tuple(values[::-1]))

    def tuple_to_mark(self) -> None:
        """TUPLE."""
        self._stack.append(tuple(self._pop_to_mark()))

    def append(self, values: list[Any]) -> None:
        """APPEND, APPENDS."""
        self._top(list).extend(values)

    def set_items(self, values: list[Any]) -> None:
        """SETITEM, SETITEMS."""
        target = self._top(dict)
        for key, value in zip(values[::2], values[1::2], strict=True):
            target[_key(key)] = value

    def remember(self, index: int) -> None:
        """PUT in its forms; memo indices count up, a table need not be larger than the file."""
        self._memo[index] = self._stack[-1]

    # --------------------------------------------------------------- objects

    def name_class(self, module: Any, name: Any) -> None:
        """GLOBAL, STACK_GLOBAL: a class by name, nothing is imported."""
        if not (isinstance(module, str) and isinstance(name, str)):
            raise InputError("no valid pickle (a class without a name)")
        full = f"{module}.{name}"
        if full not in self._records | self._values and full not in _NUMPY:
            raise InputError(f"it names {full}, which settings do not need; refused")
        self._stack.append(Class(full))

    def new(self, arguments: Any, cls: Any) -> None:
        """NEWOBJ: an instance without arguments."""
        if not (isinstance(cls, Class) and cls.name in self._records and arguments == ()):
            raise InputError(f"an object of {_name(cls)} made with arguments is refused")
        self._stack.append(Record(cls.name))

    def call(self, arguments: Any, cls: Any) -> None:
        """REDUCE: an enumeration's member, or a numpy scalar."""
        if not (isinstance(cls, Class) and isinstance(arguments, tuple)):
            raise InputError(f"a call of {_name(cls)} is refused")
        if cls.name in self._values and len(arguments) == 1 and isinstance(arguments[0], str | int):
            self._stack.append(Record(cls.name, arguments))
        elif cls.name in _NUMPY:
            self._stack.append(_NUMPY[cls.name](*arguments))
        else:
            raise InputError(f"a call of {cls.name} with {len(arguments)} values is refused")

    def build(self, state: Any) -> None:
        """BUILD: attributes of a record; the state of a dtype says its byte order."""
        target = self._stack[-1]
        if isinstance(target, Record) and isinstance(state, dict):
            target.fields.update({_key(key): value for key, value in state.items()})
        elif isinstance(target, _Dtype):
            if not (isinstance(state, tuple) and len(state) > 1 and state[1] in ("<", "|")):
                raise InputError("a numpy dtype that is not little-endian is refused")
        else:
            raise InputError(f"attributes for {_name(target)} are refused")


def shown(value: Any) -> str:
    """A value from a pickle as messages may show it: short, and without walking through it."""
    if isinstance(value, str | float | bool | None):
        return repr(value)[:_SHOWN]
    if isinstance(value, int) and abs(value) < _SHOWN_INT:
        return repr(value)
    return f"a {type(value).__name__}"


def _key(key: Any) -> Any:
    """A dictionary's key: plain values and records, which are told apart by identity."""
    if isinstance(key, str | int | float | Record):
        return key
    raise InputError(f"a dictionary's key of type {type(key).__name__} is refused")


def _name(value: Any) -> str:
    return value.name if isinstance(value, Class | Record) else shown(value)


def _dtype(code: Any, *_: Any) -> _Dtype:
    if not (isinstance(code, str) and code in _FORMATS):
        raise InputError(f"the numpy dtype {shown(code)} is refused")
    return _Dtype("<" + _FORMATS[code])


def _scalar(dtype: Any, data: Any = b"") -> float | int | bool:
    if not (isinstance(dtype, _Dtype) and isinstance(data, bytes)):
        raise InputError("a numpy scalar of something else than a number is refused")
    value: float | int | bool = struct.unpack(dtype.code, data)[0]
    return value


def _latin1(text: Any, encoding: Any = None) -> bytes:
    """How protocols below 3 write bytes."""
    if not (isinstance(text, str) and encoding == "latin1"):
        raise InputError("an encoding other than latin1 is refused")
    return text.encode("latin1")


_NUMPY: dict[str, Callable[..., Any]] = {
    "numpy.dtype": _dtype,
    "numpy.core.multiarray.scalar": _scalar,  # numpy before 2
    "numpy._core.multiarray.scalar": _scalar,
    "_codecs.encode": _latin1,
}
_IGNORED = ("PROTO", "FRAME")
_PLAIN = ("INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "FLOAT", "BINFLOAT") + (
    "UNICODE",
    "BINUNICODE",
    "SHORT_BINUNICODE",
    "BINBYTES",
    "SHORT_BINBYTES",
)
_CONSTANTS: dict[str, Callable[[], Any]] = {
    "NONE": lambda: None,
    "NEWTRUE": lambda: True,
    "NEWFALSE": lambda: False,
    "EMPTY_LIST": list,
    "EMPTY_DICT": dict,
    "EMPTY_TUPLE": tuple,
    "MARK": _Mark,
}
_METHODS: dict[str, Callable[[_Machine, Any], None]] = {
    "TUPLE1": lambda m, _: m.tuple_of(1),
    "TUPLE2": lambda m, _: m.tuple_of(2),
    "TUPLE3": lambda m, _: m.tuple_of(3),
    "TUPLE": lambda m, _: m.tuple_to_mark(),
    "APPEND": lambda m, _: m.append([m._pop()]),
    "APPENDS": lambda m, _: m.append(m._pop_to_mark()),
    "SETITEM": lambda m, _: m.set_items([m._pop(), m._pop()][::-1]),
    "SETITEMS": lambda m, _: m.set_items(m._pop_to_mark()),
    "MEMOIZE": lambda m, _: m.remember(len(m._memo)),
    "PUT": lambda m, index: m.remember(index),
    "BINPUT": lambda m, index: m.remember(index),
    "LONG_BINPUT": lambda m, index: m.remember(index),
    "GET": lambda m, index: m._stack.append(m._memo[index]),
    "BINGET": lambda m, index: m._stack.append(m._memo[index]),
    "LONG_BINGET": lambda m, index: m._stack.append(m._memo[index]),
    "GLOBAL": lambda m, name: m.name_class(*name.split(" ", 1)),
    "STACK_GLOBAL": lambda m, _: m.name_class(*[m._pop(), m._pop()][::-1]),
    "NEWOBJ": lambda m, _: m.new(m._pop(), m._pop()),
    "REDUCE": lambda m, _: m.call(m._pop(), m._pop()),
    "BUILD": lambda m, _: m.build(m._pop()),
}
