"""As much of numpy as the explorer's answers need, in plain Python: where there is no numpy for a browser.

Arrays hold their numbers in a list and are views of it as numpy's are. Results of no dimension are numbers of Python.
What is not here raises AttributeError. tests/explorer/test_numpy_of_the_page.py compares it with numpy.
"""

from __future__ import annotations

import builtins
import cmath
import math
import operator
from array import array as packed
from bisect import bisect_left, bisect_right
from contextlib import contextmanager
from itertools import combinations
from itertools import product as _product
from types import EllipsisType, SimpleNamespace

nan, inf, pi, newaxis = math.nan, math.inf, math.pi, None
LARGE = 1024  # numbers, of which a list would be too large


class dtype:
    """The type of the elements."""

    def __init__(self, name, kind, make, rank):
        self.name, self.kind, self.make, self.rank = name, kind, make, rank

    def __repr__(self):
        return self.name

    def __call__(self, value=0):
        return self.make(value)


def _whole(value):
    return int(value)


bool_ = dtype("bool", "b", builtins.bool, 0)
int8, uint8, int32, int64 = (
    dtype(name, "i", _whole, 1 + i) for i, name in enumerate(("int8", "uint8", "int32", "int64"))
)
intp = int_ = int64
float32, float64 = dtype("float32", "f", float, 5), dtype("float64", "f", float, 6)
complex128 = dtype("complex128", "c", complex, 7)
floating, integer = float64, int64
_TYPES = {float: float64, int: int64, builtins.bool: bool_, complex: complex128}


def _dtype(given):
    return _TYPES.get(given, given)


def _type_of(value):
    return (
        _TYPES[type(value)]
        if type(value) in _TYPES
        else _TYPES[next(one for one in (builtins.bool, int, float, complex) if isinstance(value, one))]
    )


def _common(*types):
    return builtins.max(types, key=lambda one: one.rank)


def _size(shape):
    return math.prod(shape)


def _strides(shape):
    found, step = [], 1
    for n in reversed(shape):
        found.append(step)
        step *= n
    return tuple(reversed(found))


def _places(shape, strides, offset):
    found = [offset]
    for n, step in zip(shape, strides):
        steps = range(0, n * step, step) if step else [0] * n
        found = [at + more for at in found for more in steps]
    return found


class ndarray:
    """An array."""

    __slots__ = ("data", "dtype", "offset", "shape", "strides")
    __hash__ = None

    def __init__(self, data, dtype, shape, strides=None, offset=0):
        self.data, self.dtype, self.shape, self.offset = data, dtype, tuple(shape), offset
        self.strides = _strides(self.shape) if strides is None else strides

    @property
    def size(self):
        return _size(self.shape)

    @property
    def ndim(self):
        return len(self.shape)

    @property
    def nbytes(self):
        return 8 * self.size

    def _contiguous(self):
        return self.strides == _strides(self.shape)

    def _list(self):
        if self._contiguous():
            found = self.data[self.offset : self.offset + self.size]
            return found if isinstance(found, list) else found.tolist()
        return [self.data[i] for i in _places(self.shape, self.strides, self.offset)]

    def __repr__(self):
        return f"array({self.tolist()!r})"

    def __len__(self):
        if not self.shape:
            raise TypeError("len() of unsized object")
        return self.shape[0]

    def __iter__(self):
        return (self[i] for i in range(len(self)))

    def __contains__(self, value):
        return value in self._list()

    def _one(self):
        if self.size != 1:
            raise ValueError("The truth value of an array with more than one element is ambiguous.")
        return self._list()[0]

    def __bool__(self):
        return builtins.bool(self._one())

    def __float__(self):
        return float(self._one())

    def __int__(self):
        return int(self._one())

    def __complex__(self):
        return complex(self._one())

    __index__ = __int__

    def item(self, *at):
        return self[at] if at else self._one()

    def tolist(self):
        if not self.shape:
            return self._list()[0]
        if self.ndim == 1:
            return self._list()
        return [part.tolist() for part in self]

    def tobytes(self):
        return packed(
            {"float64": "d", "float32": "f", "int8": "b", "uint8": "B", "int32": "i", "int64": "q", "bool": "B"}[
                self.dtype.name
            ],
            self._list(),
        ).tobytes()

    def setflags(self, **_):
        pass

    # ---- shapes

    @property
    def T(self):
        return ndarray(self.data, self.dtype, self.shape[::-1], self.strides[::-1], self.offset)

    @property
    def real(self):
        return self if self.dtype.kind != "c" else _made([z.real for z in self._list()], float64, self.shape)

    @property
    def imag(self):
        return _made([z.imag for z in map(complex, self._list())], float64, self.shape)

    def reshape(self, *shape):
        shape = shape[0] if len(shape) == 1 and not isinstance(shape[0], int) else shape
        if -1 in shape:
            known = -_size(shape)
            shape = tuple(self.size // known if n == -1 else n for n in shape)
        if self._contiguous():
            return ndarray(self.data, self.dtype, shape, None, self.offset)
        return ndarray(self._list(), self.dtype, shape)

    def ravel(self):
        return self.reshape(-1)

    flatten = ravel

    def copy(self):
        if self._contiguous():
            return ndarray(self.data[self.offset : self.offset + self.size], self.dtype, self.shape)
        return ndarray(self._list(), self.dtype, self.shape)

    def astype(self, kind, copy=True):
        kind = _dtype(kind)
        return ndarray(list(map(kind.make, self._list())), kind, self.shape)

    def view(self, *_):
        return self

    # ---- elements

    def _view(self, key):
        """A view, for a key without arrays."""
        shape, strides, offset, axis = [], [], self.offset, 0
        for one in key:
            if one is None:
                shape.append(1)
                strides.append(0)
                continue
            n, step = self.shape[axis], self.strides[axis]
            axis += 1
            if isinstance(one, slice):
                start, stop, by = one.indices(n)
                offset += start * step if len(range(start, stop, by)) else 0
                shape.append(len(range(start, stop, by)))
                strides.append(step * by)
            else:
                at = operator.index(one)
                if not -n <= at < n:
                    raise IndexError(f"index {at} is out of bounds for axis with size {n}")
                offset += (at % n) * step
        return ndarray(self.data, self.dtype, [*shape, *self.shape[axis:]], (*strides, *self.strides[axis:]), offset)

    def _key(self, key):
        """The key as a tuple without masks and ellipsis, and whether it has arrays."""
        key = key if isinstance(key, tuple) else (key,)
        found = []
        for one in key:
            if isinstance(one, (list, ndarray)):
                one = asarray(one)
                if one.dtype is bool_:
                    found += nonzero(one)
                    continue
                if not one.size:
                    one = one.astype(int64)
                found.append(one if one.shape else int(one))
            else:
                found.append(one)
        if builtins.any(isinstance(one, EllipsisType) for one in found):
            i = next(i for i, one in enumerate(found) if isinstance(one, EllipsisType))
            missing = self.ndim - builtins.sum(one is not None for one in found) + 1
            found[i : i + 1] = [slice(None)] * missing
        return tuple(found), builtins.any(isinstance(one, ndarray) for one in found)

    def _gathered(self, key):
        """Places in the data, and shape, for a key with arrays."""
        view = self._view([slice(None) if isinstance(one, (ndarray, int)) else one for one in key])
        axes = [i for i, one in enumerate(key) if isinstance(one, (ndarray, int))]
        arrays = broadcast_arrays(*(asarray(key[i]) for i in axes))
        together = axes == list(range(axes[0], axes[-1] + 1))
        steps = [
            builtins.sum((at % view.shape[i] if at < 0 else at) * view.strides[i] for i, at in zip(axes, ats))
            for ats in zip(*(one._list() for one in arrays))
        ]
        for one, i in zip(arrays, axes):
            if builtins.any(not -view.shape[i] <= at < view.shape[i] for at in one._list()):
                raise IndexError("index is out of bounds")
        rest = [i for i in range(view.ndim) if i not in axes]
        before = [i for i in rest if together and i < axes[0]]
        after = [i for i in rest if i not in before]

        def part(of):
            return _places([view.shape[i] for i in of], [view.strides[i] for i in of], 0)

        places = [view.offset + a + b + c for a in part(before) for b in steps for c in part(after)]
        return places, (*(view.shape[i] for i in before), *arrays[0].shape, *(view.shape[i] for i in after))

    def __getitem__(self, key):
        if isinstance(key, ndarray) and self.ndim == 1 and key.dtype.kind == "i":  # labels of an image, mostly
            values = self._list()
            return _made([values[i] for i in key._list()], self.dtype, key.shape)
        key, arrays = self._key(key)
        if arrays:
            places, shape = self._gathered(key)
            return ndarray([self.data[i] for i in places], self.dtype, shape)
        found = self._view(key)
        return found if found.shape or not self.shape else found.data[found.offset]

    def __setitem__(self, key, value):
        key, arrays = self._key(key)
        if arrays:
            places, shape = self._gathered(key)
        else:
            view = self._view(key)
            places, shape = _places(view.shape, view.strides, view.offset), view.shape
        make = self.dtype.make
        if isinstance(value, (ndarray, list, tuple)):
            values = _spread(asarray(value), shape)
            for i, one in zip(places, values):
                self.data[i] = make(one)
        else:
            value = make(value)
            for i in places:
                self.data[i] = value

    # ---- arithmetic

    def __neg__(self):
        return _each(operator.neg, self)

    def __abs__(self):
        return absolute(self)

    def __invert__(self):
        return _each(operator.not_, self, bool_)

    def __matmul__(self, other):
        return dot(self, asarray(other))

    def __rmatmul__(self, other):
        return dot(asarray(other), self)

    @property
    def ctypes(self):
        import compiled

        return SimpleNamespace(data=compiled.kept(self))

    # ---- reductions

    def any(self, axis=None):
        return any(self, axis)

    def all(self, axis=None):
        return all(self, axis)

    def sum(self, axis=None):
        return sum(self, axis)

    def min(self, axis=None, initial=None):
        return min(self, axis, initial)

    def max(self, axis=None, initial=None):
        return max(self, axis, initial)

    def mean(self, axis=None):
        return mean(self, axis)

    def argmax(self, axis=None):
        return argmax(self)

    def argmin(self, axis=None):
        return argmin(self)


def _made(values, kind, shape):
    """An array, or the number where it has no dimension."""
    return ndarray(values, kind, shape) if shape else values[0]


def _divided(a, b):
    try:
        return a / b
    except ZeroDivisionError:
        if isinstance(a, complex) or a == 0 or a != a:
            return nan
        return math.copysign(inf, a) * math.copysign(1.0, b)


def _power(a, b):
    try:
        found = a**b
    except ZeroDivisionError:
        return inf
    except OverflowError:
        return inf
    return nan if isinstance(found, complex) and not isinstance(a, complex) and not isinstance(b, complex) else found


def _floored(a, b):
    return a // b if b else (0 if isinstance(a, int) else nan)


def _left(a, b):
    return a % b if b else nan


def _spread(one, shape):
    """The numbers of an array in this shape."""
    if one.shape == tuple(shape):
        return one._list()
    if one.size == 1 and one.ndim <= len(shape):
        return one._list() * _size(shape)
    return broadcast_to(one, shape)._list()


def broadcast_to(one, shape):
    one, shape = asarray(one), (shape,) if isinstance(shape, int) else tuple(shape)
    old, strides = (1,) * (len(shape) - one.ndim) + one.shape, (0,) * (len(shape) - one.ndim) + one.strides
    if len(old) != len(shape) or builtins.any(n not in (1, m) for n, m in zip(old, shape)):
        raise ValueError(f"operands could not be broadcast together: {one.shape} {shape}")
    return ndarray(
        one.data,
        one.dtype,
        shape,
        tuple(0 if n == 1 and m != 1 else s for n, m, s in zip(old, shape, strides)),
        one.offset,
    )


def _shape(*arrays):
    dims = builtins.max(one.ndim for one in arrays)
    padded = [(1,) * (dims - one.ndim) + one.shape for one in arrays]
    return tuple(next((n for n in sizes if n != 1), 1) for sizes in zip(*padded))


def broadcast_arrays(*arrays):
    shape = _shape(*arrays)
    return [broadcast_to(one, shape) for one in arrays]


def _two(a, b, how, kind=None):
    """A function of two numbers for each pair of elements."""
    a, b = asarray(a), asarray(b)
    shape = _shape(a, b)
    found = list(map(how, _spread(a, shape), _spread(b, shape)))
    return _made(found, kind or _common(a.dtype, b.dtype), shape)


def _each(how, a, kind=None):
    """A function of one number for each element."""
    a = asarray(a)
    return _made(list(map(how, a._list())), kind or a.dtype, a.shape)


def _operators():
    arithmetic = {
        "add": operator.add,
        "sub": operator.sub,
        "mul": operator.mul,
        "pow": _power,
        "floordiv": _floored,
        "mod": _left,
    }
    logic = {"and": lambda a, b: a & b, "or": lambda a, b: a | b, "xor": operator.xor}
    for name, how in {**arithmetic, **logic}.items():
        setattr(ndarray, f"__{name}__", lambda self, other, how=how: _two(self, other, how))
        setattr(ndarray, f"__r{name}__", lambda self, other, how=how: _two(other, self, how))
    ndarray.__truediv__ = lambda self, other: divide(self, other)
    ndarray.__rtruediv__ = lambda self, other: divide(other, self)
    for name in (*arithmetic, *logic, "truediv"):

        def inplace(self, other, name=name):
            self[...] = getattr(self, f"__{name}__")(other)
            return self

        setattr(ndarray, f"__i{name}__", inplace)
    for how in (operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne):
        setattr(ndarray, f"__{how.__name__}__", lambda self, other, how=how: _two(self, other, how, bool_))


_operators()


# ---- arrays


def array(value, dtype=None, copy=True):
    kind = _dtype(dtype)
    if isinstance(value, ndarray):
        return value.copy() if kind in (None, value.dtype) else value.astype(kind)
    if not isinstance(value, (list, tuple, range)) and not hasattr(value, "__array__"):
        if not isinstance(value, (builtins.bool, int, float, complex)):
            value = float(value)
        kind = kind or _type_of(value)
        return ndarray([kind.make(value)], kind, ())
    parts = [one if isinstance(one, (int, float, complex)) else asarray(one) for one in value]
    if builtins.all(not isinstance(one, ndarray) for one in parts):
        kind = kind or (_common(*set(map(_type_of, parts))) if parts else float64)
        return ndarray(list(map(kind.make, parts)), kind, (len(parts),))
    return stack([asarray(one) for one in parts]).astype(kind or _common(*(asarray(one).dtype for one in parts)))


def asarray(value, dtype=None):
    kind = _dtype(dtype)
    return value if isinstance(value, ndarray) and kind in (None, value.dtype) else array(value, kind)


ascontiguousarray = asarray


def full(shape, value, dtype=None):
    shape = (shape,) if isinstance(shape, int) else tuple(shape)
    kind = _dtype(dtype) or _type_of(value)
    if isinstance(value, ndarray):
        return broadcast_to(value, shape).astype(kind)
    if kind is float64 and _size(shape) > LARGE:
        return ndarray(packed("d", [value]) * _size(shape), kind, shape)
    return ndarray([kind.make(value)] * _size(shape), kind, shape)


def zeros(shape, dtype=float64):
    return full(shape, 0, dtype)


empty = zeros


def ones(shape, dtype=float64):
    return full(shape, 1, dtype)


def full_like(one, value, dtype=None):
    return full(one.shape, value, dtype or one.dtype)


def zeros_like(one, dtype=None):
    return full_like(asarray(one), 0, dtype)


def empty_like(one, dtype=None):
    return zeros_like(one, dtype)


def arange(*ends, dtype=None):
    return array(list(range(*map(int, ends))), dtype or int64)


def linspace(start, stop, count=50):
    step = (stop - start) / (count - 1) if count > 1 else 0.0
    values = [start + i * step for i in range(count)]
    if count > 1:
        values[-1] = stop
    return array(list(map(float, values)), float64)


def geomspace(start, stop, count=50):
    low, high = math.log10(start), math.log10(stop)
    values = [10.0**x for x in linspace(low, high, count)._list()]
    values[0], values[-1] = start, stop
    return array(values, float64)


def eye(n, dtype=float64):
    return array([[i == j for j in range(n)] for i in range(n)], dtype)


def diag(numbers):
    return array([[x if i == j else 0.0 for j in range(len(numbers))] for i, x in enumerate(numbers)])


def outer(one, other):
    return array([[x * y for y in other] for x in one])


def concatenate(arrays, axis=0):
    arrays = [asarray(one) for one in arrays]
    kind = _common(*(one.dtype for one in arrays))
    if axis:
        return moveaxis(concatenate([moveaxis(one, axis, 0) for one in arrays]), 0, axis).copy()
    values = [kind.make(x) for one in arrays for x in one._list()]
    return ndarray(values, kind, (builtins.sum(len(one) for one in arrays), *arrays[0].shape[1:]))


def moveaxis(one, source, to):
    order = [i for i in range(one.ndim) if i != source % one.ndim]
    order.insert(to % one.ndim, source % one.ndim)
    return ndarray(one.data, one.dtype, [one.shape[i] for i in order], tuple(one.strides[i] for i in order), one.offset)


def stack(arrays, axis=0):
    arrays = [asarray(one) for one in arrays]
    kind = _common(*(one.dtype for one in arrays))
    whole = ndarray([kind.make(x) for one in arrays for x in one._list()], kind, (len(arrays), *arrays[0].shape))
    return whole if axis == 0 else moveaxis(whole, 0, axis if axis > 0 else whole.ndim + axis).copy()


def column_stack(arrays):
    return stack(arrays, axis=1)


def append(one, values):
    return concatenate([asarray(one).reshape(-1), asarray(values).reshape(-1)])


def repeat(one, times, axis=None):
    one = asarray(one)
    times = asarray(times)._list()
    times = times * len(one) if len(times) == 1 else times
    return one[array([i for i, n in enumerate(times) for _ in range(n)], int64)]


def tile(one, times):
    one = asarray(one)
    times = (times,) if isinstance(times, int) else tuple(times)
    shape = (1,) * (len(times) - one.ndim) + one.shape
    times = (1,) * (len(shape) - len(times)) + times
    found = one.reshape(shape)
    for axis, n in enumerate(times):
        found = moveaxis(concatenate([moveaxis(found, axis, 0)] * n), 0, axis).copy()
    return found


def delete(one, at, axis):
    n = one.shape[axis]
    return take(one, [i for i in range(n) if i != at % n], axis)


def take(one, at, axis):
    return one[(slice(None),) * (axis % one.ndim) + (asarray(at),)]


def pad(one, widths):
    found = zeros([n + before + after for n, (before, after) in zip(one.shape, widths)], one.dtype)
    found[tuple(slice(before, before + n) for n, (before, _) in zip(one.shape, widths))] = one
    return found


def atleast_1d(one):
    one = asarray(one)
    return one if one.shape else one.reshape(1)


def ndim(one):
    return one.ndim if isinstance(one, ndarray) else array(one).ndim if isinstance(one, (list, tuple)) else 0


def shape(one):
    return asarray(one).shape


def ndindex(*given):
    given = given[0] if len(given) == 1 and not isinstance(given[0], int) else given
    return _product(*map(range, given))


def unravel_index(at, given):
    found = []
    for n in reversed(given):
        at, rest = divmod(int(at), n)
        found.append(rest)
    return tuple(reversed(found))


# ---- numbers


def _function(how, complexly=None, kind=float64):
    def one(x):
        try:
            return (complexly or how)(x) if isinstance(x, complex) else how(x)
        except (ValueError, ZeroDivisionError):
            return nan
        except OverflowError:
            return inf

    def function(values):
        a = asarray(values)
        return _made(list(map(one, a._list())), complex128 if a.dtype is complex128 and complexly else kind, a.shape)

    return function


def _log(x):
    return -inf if x == 0 else math.log(x)


sin, cos, tan, exp = (_function(getattr(math, name), getattr(cmath, name)) for name in ("sin", "cos", "tan", "exp"))
sqrt, log = _function(math.sqrt, cmath.sqrt), _function(_log, cmath.log)
arctan, cbrt, degrees, radians = (_function(one) for one in (math.atan, math.cbrt, math.degrees, math.radians))
isfinite, isnan, isinf = (
    _function(getattr(math, name), getattr(cmath, name), bool_) for name in ("isfinite", "isnan", "isinf")
)
rad2deg, deg2rad = degrees, radians


def angle(values):
    return _each(lambda x: cmath.phase(x), values, float64)


def absolute(values):
    a = asarray(values)
    return _each(abs_, a, float64 if a.dtype is complex128 else None)


abs_ = builtins.abs
abs = absolute


def isneginf(values):
    return _each(lambda x: x == -inf, values, bool_)


def sign(values):
    return _each(lambda x: x if x != x else float((x > 0) - (x < 0)), values)


def divide(a, b, out=None, where=None):
    found = _two(a, b, _divided, None)
    if isinstance(found, ndarray) and found.dtype.kind in "bi":
        found.dtype = float64
    if out is None:
        return found
    out[where] = broadcast_to(asarray(found), out.shape)[where]
    return out


def _larger(a, b):
    return a if a != a or a > b else b


def _smaller(a, b):
    return a if a != a or a < b else b


def maximum(a, b):
    return _two(a, b, _larger)


def minimum(a, b):
    return _two(a, b, _smaller)


def clip(a, low, high):
    return minimum(maximum(a, low), high)


def where(condition, a, b):
    condition, a, b = asarray(condition), asarray(a), asarray(b)
    given, kind = _shape(condition, a, b), _common(a.dtype, b.dtype)
    found = [x if c else y for c, x, y in zip(*(_spread(one, given) for one in (condition, a, b)))]
    return _made(list(map(kind.make, found)), kind, given)


def isclose(a, b, rtol=1e-5, atol=1e-8):
    return _two(a, b, lambda x, y: x == y or builtins.abs(x - y) <= atol + rtol * builtins.abs(y), bool_)


def nan_to_num(a, nan=0.0, posinf=None):
    return _each(lambda x: nan if x != x else x, a)


def round(a, digits=0):
    a = asarray(a)
    return _made(
        [builtins.round(x * 10**digits) / 10**digits if math.isfinite(x) else x for x in a._list()], a.dtype, a.shape
    )


def dot(a, b):
    a, b = asarray(a), asarray(b)
    if a.ndim == 1 and b.ndim == 1:
        return sum(a * b)
    if b.ndim == 1:
        return stack([asarray(dot(row, b)) for row in a])
    return stack([asarray(dot(a, column)) for column in b.T], axis=-1)


# ---- reductions


def _reduced(how, kind=None):
    def function(a, axis=None, initial=None):
        a = asarray(a)
        more = [] if initial is None else [initial]
        if axis is None:
            return how(a._list() + more)
        moved = moveaxis(a, axis, -1 % a.ndim)
        n, flat = a.shape[axis], moved._list()
        found = (
            [how(flat[i : i + n] + more) for i in range(0, len(flat), n)]
            if n
            else [how(more)] * _size(moved.shape[:-1])
        )
        return _made(found, kind or a.dtype, moved.shape[:-1])

    return function


def _extreme(pick):
    def function(values):
        return nan if builtins.any(x != x for x in values) else pick(values)

    return function


any, all = _reduced(builtins.any, bool_), _reduced(builtins.all, bool_)
sum = _reduced(builtins.sum)
mean = _reduced(lambda values: builtins.sum(values) / len(values) if values else nan, float64)
max, min = _reduced(_extreme(builtins.max)), _reduced(_extreme(builtins.min))
prod = _reduced(math.prod)


def _known(values):
    return [x for x in values if x == x]


nanmin = _reduced(lambda values: builtins.min(_known(values), default=nan))
nanmax = _reduced(lambda values: builtins.max(_known(values), default=nan))


def ptp(a):
    return max(a) - min(a)


def count_nonzero(a):
    return builtins.sum(map(builtins.bool, asarray(a)._list()))


def argmax(a):
    values = asarray(a)._list()
    return next((i for i, x in enumerate(values) if x != x), None) or values.index(builtins.max(values))


def argmin(a):
    values = asarray(a)._list()
    return values.index(builtins.min(values))


def nanargmin(a):
    values = asarray(a)._list()
    return values.index(builtins.min(_known(values)))


def diff(a, axis=-1, prepend=None):
    a = asarray(a)
    if prepend is not None:
        a = concatenate([asarray(prepend), a])
    rest = (slice(None),) * (axis % a.ndim)
    after, before = a[(*rest, slice(1, None))], a[(*rest, slice(None, -1))]
    return after != before if a.dtype is bool_ else after - before


# ---- searching


def nonzero(a):
    a = asarray(a)
    at = [unravel_index(i, a.shape) for i, x in enumerate(a._list()) if x]
    return tuple(ndarray([one[axis] for one in at], int64, (len(at),)) for axis in range(a.ndim))


def flatnonzero(a):
    found = [i for i, x in enumerate(asarray(a)._list()) if x]
    return ndarray(found, int64, (len(found),))


def argwhere(a):
    return stack(nonzero(a), axis=1)


def sort(a):
    a = asarray(a)
    return ndarray(sorted(a._list()), a.dtype, a.shape)


def argsort(a, kind=None):
    values = asarray(a)._list()
    return array(sorted(range(len(values)), key=values.__getitem__), int64)


def searchsorted(a, values, side="left"):
    rows, find = asarray(a)._list(), bisect_left if side == "left" else bisect_right
    return _each(lambda x: find(rows, x), values, int64)


def unique(a, return_index=False, return_inverse=False, return_counts=False):
    a = asarray(a)
    values = a._list()
    found = sorted(set(values))
    first = {}
    for i, x in enumerate(values):
        first.setdefault(x, i)
    number = {x: i for i, x in enumerate(found)}
    results = [ndarray(found, a.dtype, (len(found),))]
    if return_index:
        results.append(array([first[x] for x in found], int64))
    if return_inverse:
        results.append(ndarray([number[x] for x in values], int64, a.shape))
    if return_counts:
        results.append(array([values.count(x) for x in found], int64))
    return tuple(results) if len(results) > 1 else results[0]


def isin(a, allowed):
    allowed = set(asarray(allowed)._list())
    return _each(lambda x: x in allowed, a, bool_)


@contextmanager
def errstate(**_):
    yield


number = generic = ndarray


def ix_(*given):
    """Indices of all combinations; a mask stands for where it is true."""
    given = [flatnonzero(one) if asarray(one).dtype is bool_ else asarray(one) for one in given]
    return tuple(one.reshape((1,) * i + (-1,) + (1,) * (len(given) - 1 - i)) for i, one in enumerate(given))


class ma:
    """There are no masked arrays."""

    class MaskedArray:
        pass

    @staticmethod
    def is_masked(_):
        return False


def format_float_scientific(value, trim="k", exp_digits=2, unique=True):
    """A number with an exponent, in as many digits as tell it from all others."""
    digits, _, exponent = f"{value!r}".partition("e")
    if not exponent:
        length = builtins.max(len(digits.replace(".", "").replace("-", "").strip("0")) - 1, 0)
        digits, _, exponent = f"{value:.{length}e}".partition("e")
    digits += "" if "." in digits else ".0"
    return f"{digits}e{int(exponent):+0{exp_digits + 1}d}"


def _eigh(matrix):
    """By rotations of pairs (Jacobi), until none of them is seen in the numbers."""
    a, n = [list(row) for row in matrix.tolist()], len(matrix)
    v = [[float(i == j) for j in range(n)] for i in range(n)]
    while True:
        rotated = False
        for p, q in combinations(range(n), 2):
            if abs(a[p][q]) <= 1e-17 * math.sqrt(abs(a[p][p] * a[q][q])):
                continue
            rotated = True
            theta = 0.5 * (a[q][q] - a[p][p]) / a[p][q]
            t = math.copysign(1.0, theta) / (abs(theta) + math.hypot(theta, 1.0))
            c = 1 / math.hypot(t, 1.0)
            for rows in (a, v):  # columns p and q
                for row in rows:
                    row[p], row[q] = c * (row[p] - t * row[q]), c * (row[q] + t * row[p])
            a[p], a[q] = ([c * (x - t * y) for x, y in zip(a[p], a[q])], [c * (y + t * x) for x, y in zip(a[p], a[q])])
            a[p][q] = a[q][p] = 0.0
        if not rotated:
            order = sorted(range(n), key=lambda i: a[i][i])
            return array([a[i][i] for i in order]), array([[row[i] for i in order] for row in v])


def _inv(matrix):
    """By elimination, with the largest pivot of each column."""
    n = len(matrix)
    rows = [[*row, *(float(i == j) for j in range(n))] for i, row in enumerate(matrix.tolist())]
    for i in range(n):
        best = builtins.max(range(i, n), key=lambda k: abs(rows[k][i]))
        rows[i], rows[best] = rows[best], rows[i]
        rows[i] = [x / rows[i][i] for x in rows[i]]
        for k in range(n):
            if k != i:
                rows[k] = [x - rows[k][i] * y for x, y in zip(rows[k], rows[i])]
    return array([row[n:] for row in rows])


linalg = SimpleNamespace(eigh=_eigh, inv=_inv)
