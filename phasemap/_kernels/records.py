"""Records of named numbers that kernels pass to each other: a state, the nodes of an orbit, scratch memory.

A class whose fields are annotated becomes a record by the decorator `record`:

    @record
    class State:
        amplitude: float  # [m]
        theta: np.ndarray = column(16)  # [rad], at each node

``State()`` in a kernel makes one filled with zeros, on the stack of that kernel: it must not be returned, but is passed
down by its address, so that what is called can change it. numba checks the names of its fields, mypy their types.
In Python ``State()`` is a `numpy.record` with the same fields, which kernels take and change as well.

What is returned, or too large for a stack, lies in an array of words that a named tuple holds; `rows_of` names its
numbers.
"""

from __future__ import annotations

import ctypes
import typing
from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    intrinsic,
    lower_builtin,
    lower_getattr_generic,
    lower_setattr_generic,
    models,
    register_model,
    type_callable,
    typeof_impl,
    unbox,
)

T = TypeVar("T")

MOST_BYTES = 1 << 17  # of a record: the stack of a thread has half a megabyte and more
WORD = 8  # bytes of each number
NUMBERS = {float: types.float64, int: types.int64}
COLUMN = types.Array(types.float64, 1, "C")


class RecordType(types.Type):
    """The numba type of a record: names, types and places [words] of its fields."""

    def __init__(self, name: str, fields: dict[str, tuple[types.Type, int, int]], words: int) -> None:
        self.fields, self.words = fields, words  # of each field its type, first word, and how many there are
        super().__init__(name)

    @property
    def key(self) -> tuple[Any, ...]:
        """What makes two of them the same."""
        return self.name, tuple(self.fields.items())

    @property
    def mangling_args(self) -> tuple[str, tuple[()]]:
        """By what name compiled code is linked: the same in every process."""
        return self.name, ()


@register_model(RecordType)
class _Address(models.PrimitiveModel):
    """A record is passed by its address."""

    def __init__(self, manager: Any, kind: RecordType) -> None:
        super().__init__(manager, kind, ir.ArrayType(ir.IntType(8 * WORD), kind.words).as_pointer())


@infer_getattr
class _Fields(AttributeTemplate):
    """Types of the fields."""

    key = RecordType

    def generic_resolve(self, kind: RecordType, name: str) -> Any:
        """Type of the field of this name; None without one."""
        return kind.fields.get(name, (None,))[0]


def _place(builder: Any, address: Any, first: int, kind: Any) -> Any:
    """Pointer to the field that begins at a word."""
    return builder.bitcast(cgutils.gep_inbounds(builder, address, 0, first), kind.as_pointer())


@lower_getattr_generic(RecordType)
def _get(context: Any, builder: Any, kind: RecordType, address: Any, name: str) -> Any:
    """A number, a view of a column, or the address of a record in this one."""
    of, first, count = kind.fields[name]
    if isinstance(of, RecordType):
        return _place(builder, address, first, context.get_value_type(of).pointee)
    place = _place(builder, address, first, context.get_data_type(types.float64 if of is COLUMN else of))
    if of is not COLUMN:
        return builder.load(place)
    return _view(context, builder, place, count)


def _view(context: Any, builder: Any, place: Any, count: int) -> Any:
    """Array of the numbers at a place on the stack, which counts no references."""
    view = context.make_array(COLUMN)(context, builder)
    view.data, view.meminfo = place, cgutils.get_null_value(view.meminfo.type)
    view.parent = cgutils.get_null_value(view.parent.type)
    view.nitems, view.itemsize = cgutils.intp_t(count), cgutils.intp_t(WORD)
    view.shape, view.strides = (cgutils.pack_array(builder, [cgutils.intp_t(n)]) for n in (count, WORD))
    return view._getvalue()


@lower_setattr_generic(RecordType)
def _set(context: Any, builder: Any, signature: Any, arguments: Any, name: str) -> None:
    """Give a number another value."""
    (address, value), (kind, given) = arguments, signature.args
    of, first, _ = kind.fields[name]
    place = _place(builder, address, first, context.get_data_type(of))
    builder.store(context.cast(builder, value, given, of), place)


@unbox(RecordType)
def _unbox(kind: RecordType, one: Any, c: Any) -> NativeValue:
    """Address of a record that Python gives."""
    buffer = c.pyapi.alloca_buffer()
    address = c.builder.bitcast(c.pyapi.extract_record_data(one, buffer), c.context.get_value_type(kind))
    missing = cgutils.is_null(c.builder, address)
    return NativeValue(address, cleanup=lambda: c.pyapi.release_buffer(buffer), is_error=missing)


# What Python holds of a record of any kind. Its numba type is registered here once: a module that is imported while
# another thread compiles may add no class to those that numba tells apart, for it is going through them.
InPython: Any = type("InPython", (np.record,), {})
typeof_impl.register(InPython)(lambda one, _context: type(one).record_type)


def column(count: int) -> Any:
    """Declare a field that has this many numbers."""
    return count


def record(cls: type[T]) -> type[T]:
    """Make a class of annotated fields a record: of float, int, columns of numbers, or other records."""
    fields: dict[str, tuple[types.Type, int, int]] = {}
    layout: list[tuple[str, Any]] = []
    words = 0
    for name, annotated in typing.get_type_hints(cls).items():
        if hasattr(np.record, name):
            raise TypeError(f"{cls.__name__}.{name}: in Python that is a method of every record")
        count = cls.__dict__.get(name)
        inner = getattr(annotated, "record_type", None)
        kind = inner or (NUMBERS[annotated] if count is None else COLUMN)
        size = inner.words if inner else count or 1
        fields[name] = kind, words, size
        layout.append((name, annotated.layout if inner else (np.float64, (count,)) if count else annotated))
        words += size
        if count is not None:
            delattr(cls, name)
    if words * WORD > MOST_BYTES:
        raise TypeError(f"{cls.__name__} takes {words * WORD} bytes, more than a stack may be asked for")
    made: Any = cls
    made.record_type = RecordType(f"{cls.__module__}.{cls.__name__}", fields, words)
    own = {
        "__doc__": cls.__doc__,
        "__reduce__": lambda one: (_from_bytes, (cls, one.tobytes())),
        "record_type": made.record_type,
    }
    in_python = type(cls.__name__, (InPython,), own)
    made.layout = np.dtype((in_python, np.dtype(layout)))
    made.__new__ = lambda *_: np.zeros(1, made.layout)[0]
    _declare(made, made.record_type)
    return cls


def words_of(cls: type) -> int:
    """Number of words [8 bytes] of a record of this class."""
    return int(cls.record_type.words)  # type: ignore[attr-defined]


def rows_of(cls: type[T], holder: type, field: str) -> Callable[..., T]:
    """Make a function (one, i = 0) that has row i of the array `field` of a named tuple as a record of this class.

    The record is the memory of the array, of words, and valid as long as that is.
    """
    made: Any = cls
    kind, place = made.record_type, list(holder.__annotations__).index(field)

    def row(one: Any, i: int = 0) -> T:
        return getattr(one, field).view(made.layout)[i, 0]

    @lower_builtin(row, types.BaseTuple)
    @lower_builtin(row, types.BaseTuple, types.Integer)
    def address(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        one, *rows = arguments
        array = context.make_array(signature.args[0][place])(context, builder, builder.extract_value(one, place))
        data = builder.bitcast(array.data, context.get_value_type(kind))
        at = [context.cast(builder, i, signature.args[1], types.intp) for i in rows] or [cgutils.intp_t(0)]
        return builder.gep(data, at)

    type_callable(row)(lambda _context: lambda one, i=None: kind)
    return row


def _from_bytes(cls: Any, content: bytes) -> Any:
    """A record of this class, for pickle: numpy would make a plain one, which kernels do not know."""
    return np.frombuffer(bytearray(content), cls.layout)[0]


def _declare(cls: Any, kind: RecordType) -> None:
    """Let kernels make a record of this class, as `numba.extending` does it for a class of one's own."""

    @type_callable(cls)
    def made(_context: Any) -> Any:
        return lambda: kind

    @lower_builtin(cls)
    def make(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        with builder.goto_entry_block():  # `alloca_once` has LLVM zero one word after the other, for seconds
            address = builder.alloca(context.get_value_type(kind).pointee)
        _zero(builder, address, kind)
        return address


def _zero(builder: Any, address: Any, kind: RecordType) -> None:
    cgutils.memset(builder, builder.bitcast(address, cgutils.voidptr_t), cgutils.intp_t(kind.words * WORD), 0)


@intrinsic
def assign(_context: Any, to: Any, source: Any) -> Any:
    """Copy all fields of one record into another of the same class."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        into, out_of = (builder.bitcast(one, cgutils.voidptr_t) for one in arguments)
        cgutils.raw_memcpy(builder, into, out_of, cgutils.intp_t(to.words * WORD), 1)

    return (types.void(to, source), generate) if isinstance(to, RecordType) and to == source else None


@intrinsic
def clear(_context: Any, one: Any) -> Any:
    """Set all fields of a record to zero."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        _zero(builder, arguments[0], one)

    return (types.void(one), generate) if isinstance(one, RecordType) else None


@intrinsic
def numbers_of(_context: Any, one: Any) -> Any:
    """All numbers of a record of floats in their order, as an array that is its memory."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        place = builder.bitcast(arguments[0], ir.DoubleType().as_pointer())
        return _view(context, builder, place, one.words)

    return (COLUMN(one), generate) if isinstance(one, RecordType) else None


def _assign(to: Any, source: Any) -> None:
    for name in to.dtype.names:
        to[name] = source[name]


def _clear(one: Any) -> None:
    for name in one.dtype.names:
        one[name] = np.zeros_like(one[name])


def _numbers_of(one: Any) -> np.ndarray:
    place, _ = one.__array_interface__["data"]
    return np.ctypeslib.as_array((ctypes.c_double * (one.nbytes // WORD)).from_address(place))


if numba.config.DISABLE_JIT:
    assign, clear, numbers_of = _assign, _clear, _numbers_of
