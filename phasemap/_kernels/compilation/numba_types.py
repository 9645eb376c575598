"""The numba types of records, and of functions that are chosen by their first argument."""

from __future__ import annotations

from typing import Any

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

WORD = 8  # bytes of each number
COLUMN = types.Array(types.float64, 1, "C")
FIELD_TYPES = {float: types.float64, int: types.int64, np.ndarray: COLUMN}


class RecordType(types.Type):
    """The numba type of a record: names, types and places [words] of its fields."""

    def __init__(self, name: str, fields: dict[str, tuple[types.Type, int, int]], words: int) -> None:
        self.fields, self.words = fields, words  # of each field its type, first word, and how many there are
        super().__init__(name)

    @property
    def key(self) -> tuple[Any, ...]:
        """Name and fields, by which two types are the same."""
        return self.name, tuple(self.fields.items())

    @property
    def mangling_args(self) -> tuple[str, tuple[()]]:
        """Name by which compiled code is linked: the same in every process."""
        return self.name, ()


@register_model(RecordType)
class _Address(models.PrimitiveModel):
    """Model of a record in LLVM: its address."""

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
    """Value of a field: a number, a view of a column, or the address of a record in this one."""
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


def declare_record(cls: Any) -> None:
    """Let kernels make a record of this class, as `numba.extending` does it for a class of one's own."""
    fields = {
        name: (getattr(kind, "record_type", None) or FIELD_TYPES[kind], first, count)
        for name, (kind, first, count) in cls.record_fields.items()
    }
    cls.record_type = kind = RecordType(f"{cls.__module__}.{cls.__name__}", fields, cls.record_words)

    @type_callable(cls)
    def made(_context: Any) -> Any:
        return lambda: kind

    @lower_builtin(cls)
    def make(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        with builder.goto_entry_block():  # `alloca_once` has LLVM zero one word after the other, for seconds
            address = builder.alloca(context.get_value_type(kind).pointee)
        _zero(builder, address, kind)
        return address


def declare_in_python(cls: Any) -> None:
    """Let numba know the type of what Python holds of a record of any kind."""
    typeof_impl.register(cls)(lambda one, _context: type(one).record_class.record_type)


def declare_rows(row: Any, cls: Any, place: int) -> None:
    """Let kernels have row i of the array that is member `place` of a named tuple as a record of this class."""
    kind = cls.record_type

    @lower_builtin(row, types.BaseTuple)
    @lower_builtin(row, types.BaseTuple, types.Integer)
    def address(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        one, *rows = arguments
        array = context.make_array(signature.args[0][place])(context, builder, builder.extract_value(one, place))
        data = builder.bitcast(array.data, context.get_value_type(kind))
        at = [context.cast(builder, i, signature.args[1], types.intp) for i in rows] or [cgutils.intp_t(0)]
        return builder.gep(data, at)

    type_callable(row)(lambda _context: lambda one, i=None: kind)


def _zero(builder: Any, address: Any, kind: RecordType) -> None:
    """Write the code that sets all words of a record to zero."""
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
    """Numbers of a record of floats in their order, as an array that is its memory."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        place = builder.bitcast(arguments[0], ir.DoubleType().as_pointer())
        return _view(context, builder, place, one.words)

    return (COLUMN(one), generate) if isinstance(one, RecordType) else None


class _ChosenType(types.Callable, types.Dummy):
    """The numba type of a function that is chosen by its first argument."""

    def __init__(self, function: Any) -> None:
        self.function = function
        super().__init__(f"chosen({function.__name__}, {id(function)})")

    def _kernel(self, args: Any) -> Any:
        """Numba type of the kernel registered for the class of the first argument."""
        return numba.typeof(self.function.kernels[args[0].instance_class])

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        """Numba's hook: the signature of a call, which is that of the chosen kernel."""
        return self._kernel(args).get_call_type(context, args, kws)

    def get_call_signatures(self) -> tuple[tuple[()], bool]:
        """Numba's hook: no signatures are known ahead, and any may come."""
        return (), True

    def get_impl_key(self, sig: Any) -> Any:
        """Numba's hook: where the code of a call is found, as of the chosen kernel."""
        return self._kernel(sig.args).get_impl_key(sig)


def declare_chosen(cls: Any) -> None:
    """Let kernels call an object of this class."""
    typeof_impl.register(cls)(lambda one, _context: _ChosenType(one))


register_model(_ChosenType)(models.OpaqueModel)
