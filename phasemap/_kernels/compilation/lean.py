"""numba's compiler, with the work left out that functions of numbers and arrays have no need of.

Most of what a first use costs is Python that types and lowers. The code that comes out is the same. Left out are passes
for closures, generators, objects and branches on literals; typing once more a call of a function of numba that was
typed before; looking for new extensions before every function; and counting references to what holds none, or to
arrays where a function neither makes nor is given one.
"""

from __future__ import annotations

import copy
import functools
import operator
from collections.abc import Iterator
from typing import Any, ClassVar

from numba.core import ir, lowering, types
from numba.core.compiler import Compiler, Flags
from numba.core.cpu import CPUContext
from numba.core.cpu_options import FastMathOptions
from numba.core.datamodel.models import StructModel, UniTupleModel
from numba.core.ir_utils import build_definitions
from numba.core.ssa import reconstruct_ssa
from numba.core.targetconfig import ConfigStack
from numba.core.typed_passes import (
    AnnotateTypes,
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NopythonRewrites,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.typing.context import Context
from numba.core.untyped_passes import FixupArgs, GenericRewrites, ReconstructSSA, TranslateByteCode

from phasemap._kernels.compilation import array_elements
from phasemap._kernels.compilation.linked_code import WholeCalls


class _Inherited(Flags):
    """Compiler flags of numba's functions, the same for all kernels; compared by identity, since it happens often."""

    __slots__ = ()
    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        return self is other


class _Typing(Context):
    """numba's typing context, which remembers the calls of numba's functions that were typed before."""

    known: ClassVar[dict[Any, Any]] = {}
    inherited: ClassVar[_Inherited | None] = None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Typing)  # numba keeps its functions for each

    def __hash__(self) -> int:
        return hash(_Typing)

    def refresh(self) -> None:
        """Do nothing, for nothing is new since the copy was made."""

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """Signature of a call."""
        if type(func) is not types.Function and getattr(func, "__module__", "") != operator.add.__module__:
            return super().resolve_function_type(func, args, kws)
        # What numba tries first; of literals it would keep one version each.
        args, kws = tuple(map(_unliteral, args)), {name: _unliteral(one) for name, one in kws.items()}
        key = func, args, tuple(kws.items())
        known_signature = self.known.get(key)
        if known_signature is None:
            with ConfigStack().enter(self.inherited):
                known_signature = super().resolve_function_type(func, args, kws)
            if known_signature is not None:
                self.known[key] = known_signature
        return known_signature


def _unliteral(of: types.Type) -> types.Type:
    """The type of a literal number's kind; strings, which choose between functions, stay what they are."""
    return of if isinstance(of, types.StringLiteral) else types.unliteral(of)


class _Target(CPUContext):
    """numba's target context, which looks for new extensions once a function."""

    looks = False
    numbered = True  # names of functions
    whole = False  # arguments of the function that is made

    def refresh(self) -> None:
        """Register new numba extensions, but only once for each function that is compiled."""
        if self.looks:
            super().refresh()
            self.looks = False  # until the next function

    def mangler(self, name: str, types: Any, *, abi_tags: Any = (), uid: Any = None) -> str:
        """The name of a function in LLVM code."""
        return str(super().mangler(name, types, abi_tags=abi_tags, uid=uid if self.numbered else None))


@functools.cache
def _counted_parts(model: Any) -> tuple[tuple[tuple[int, ...], types.Type], ...]:
    """Paths to the reference-counted parts of a value, and their types; kept, since numba's search is slow."""
    if isinstance(model, UniTupleModel):
        parts = model.inner_models() * model._count
    elif isinstance(model, StructModel) and type(model).traverse is StructModel.traverse:
        parts = model.inner_models()
    else:
        return (((), model.fe_type),) if model.contains_nrt_meminfo() else ()
    return tuple(
        ((position, *path), kind) for position, part in enumerate(parts) for path, kind in _counted_parts(part)
    )


class _Lower(lowering.Lower):
    """Lowering that counts references only to what is counted, and goes straight to the elements of arrays."""

    def setup_function(self, fndesc: Any) -> None:
        """Begin the code of a function, whose calls pass whole arguments where it is to be linked."""
        context = self.context
        if context.whole:
            context.__dict__["declare_function"] = WholeCalls(context).declare
        try:
            super().setup_function(fndesc)
        finally:
            context.__dict__.pop("declare_function", None)

    def extract_function_arguments(self) -> Any:
        """Load the arguments of a function in its LLVM code."""
        if not self.context.whole:
            return super().extract_function_arguments()
        self.fnargs = WholeCalls(self.context).decode_arguments(self.builder, self.fndesc.argtypes, self.function)
        return self.fnargs

    def lower_getitem(self, resty: Any, expr: Any, value: Any, index: Any, signature: Any) -> Any:
        """Write the code that loads an element or a row of a contiguous array; other cases are numba's."""
        of, at = self.typeof(value.name), self.typeof(index.name)
        kinds = array_elements.index_types(of, at)
        if not kinds or self.context.enable_boundscheck:
            return super().lower_getitem(resty, expr, value, index, signature)
        array = self.loadvar(value.name)
        place, sizes = array_elements.element_pointer(self.builder, array, of.ndim, kinds, self.loadvar(index.name))
        given = signature.return_type
        if sizes:
            element = array_elements.subarray(self.builder, array, self.context.get_value_type(given), place, sizes)
            self.incref(given, element)
        else:
            element = self.context.unpack_value(self.builder, of.dtype, place)
        return self.context.cast(self.builder, element, given, resty)

    def lower_setitem(self, target_var: Any, index_var: Any, value_var: Any, signature: Any) -> Any:
        """Write the code that stores a number at an element of a contiguous array; other cases are numba's."""
        of, at, value = (self.typeof(one.name) for one in (target_var, index_var, value_var))
        kinds = array_elements.index_types(of, at)
        if len(kinds) != getattr(of, "ndim", -1) or not isinstance(value, types.Number | types.Boolean):
            return super().lower_setitem(target_var, index_var, value_var, signature)
        array = self.loadvar(target_var.name)
        place, _ = array_elements.element_pointer(self.builder, array, of.ndim, kinds, self.loadvar(index_var.name))
        number = self.context.cast(self.builder, self.loadvar(value_var.name), value, of.dtype)
        self.context.pack_value(self.builder, of.dtype, number, place)
        return None

    def _counted(self, of: types.Type) -> tuple[Any, ...]:
        """Paths to the reference-counted parts in a value of a type, and their types."""
        return _counted_parts(self.context.data_model_manager[of]) if self.context.enable_nrt else ()

    def incref(self, typ: types.Type, val: Any) -> None:
        """Write the code that counts one reference more to the arrays in a value."""
        for kind, part in self._parts(typ, val):
            self.context.nrt.incref(self.builder, kind, part)

    def decref(self, typ: types.Type, val: Any) -> None:
        """Write the code that counts one reference less to the arrays in a value."""
        for kind, part in self._parts(typ, val):
            self.context.nrt.decref(self.builder, kind, part)

    def _parts(self, of: types.Type, value: Any) -> Iterator[tuple[types.Type, Any]]:
        """Yield type and LLVM value of each reference-counted part of a value: itself, or members of a tuple."""
        for path, kind in self._counted(of):
            yield kind, self.builder.extract_value(value, path) if path else value

    def delvar(self, name: str) -> None:
        """Write the code at the end of a variable's life: one reference less, if its type has any."""
        if self._counted(self.typeof(name)):
            super().delvar(name)
        elif name not in self._blk_local_varmap:
            self._singly_assigned_vars.discard(name)
            self._alloca_var(name, self.typeof(name))


_LENT = {"getitem", "static_getitem", "typed_getitem", "getattr", "cast", "phi", "build_tuple", "exhaust_iter"}
"""Operations whose result is a part of their operand, and owns no new array."""


class _Lowering(NativeLowering):
    """The pass that writes LLVM code, by `_Lower`."""

    @property
    def lowering_class(self) -> Any:
        """Numba's hook: the class that writes LLVM code."""
        return _Lower

    def run_pass(self, state: Any) -> bool:
        """Lower; numba counts references only in functions that own arrays, for others need no code for that."""
        state.targetctx.enable_nrt = self._owns(state)
        return bool(super().run_pass(state))

    def _owns(self, state: Any) -> bool:
        """True if a function makes arrays, is given new ones by what it calls, or returns one."""
        models = state.targetctx.data_model_manager
        of = [state.return_type]
        for block in state.func_ir.blocks.values():
            for made in block.find_insts(ir.Assign):
                if isinstance(made.value, ir.Expr) and made.value.op not in _LENT:
                    of.append(state.typemap[made.target.name])
        return any(models[one].contains_nrt_meminfo() for one in dict.fromkeys(of))


class _ArrayRewrites(NopythonRewrites):
    """The pass that turns expressions of whole arrays into loops."""

    def run_pass(self, state: Any) -> bool:
        """Rewrite, where there are some."""
        signatures = [one for call, one in state.calltypes.items() if isinstance(call, ir.Expr) and call.op in _SUMS]
        return any(isinstance(one.return_type, types.Array) for one in signatures) and bool(super().run_pass(state))


_SUMS = {"binop", "inplace_binop", "unary", "call"}


class _SSA(ReconstructSSA):
    """The pass after which each variable is assigned once."""

    def run_pass(self, state: Any) -> bool:
        """Rename; what follows asks for no lifetimes."""
        state.func_ir = reconstruct_ssa(state.func_ir)
        state.func_ir._definitions = build_definitions(state.func_ir.blocks)
        return True


_PASSES = (
    TranslateByteCode(),
    FixupArgs(),
    GenericRewrites(),
    _SSA(),
    NopythonTypeInference(),
    PreLowerStripPhis(),
    _ArrayRewrites(),
    IRLegalization(),
    AnnotateTypes(),
    _Lowering(),
    NoPythonBackend(),
)


class _Pipeline:
    """The passes, one after the other."""

    pipeline_name = "lean"

    def __init__(self) -> None:
        self.exec_times: dict[str, Any] = {}  # which numba reads

    def run(self, state: Any) -> None:
        """Run numba's passes in turn."""
        for one in _PASSES:
            one.run_pass(state)


class LeanCompiler(Compiler):
    """numba's compiler for functions of numbers and arrays."""

    def __init__(self, typingctx: Any, targetctx: Any, *args: Any) -> None:
        typing, target = copy.copy(typingctx), copy.copy(targetctx)
        typing.__class__, target.__class__ = _Typing, _Target
        super().__init__(typing, target, *args)
        if _Typing.inherited is None:
            _Typing.inherited = _Inherited(self.state.flags)
            _Typing.inherited.fastmath, _Typing.inherited.forceinline = FastMathOptions({"contract"}), False
        self.state.targetctx.looks = True

    def define_pipelines(self) -> list[Any]:
        """The pipelines to run: one."""
        return [_Pipeline()]
