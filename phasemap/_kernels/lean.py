"""numba's compiler, with the work left out that functions of numbers and arrays have no need of.

Most of what a first use costs is Python that types and lowers. The code that comes out is the same. Left out are passes
for closures, generators, objects and branches on literals; typing once more a call of a function of numba that was
typed before; looking for new extensions before every function; and counting references to what holds none, or to
arrays where a function neither makes nor is given one.
"""

from __future__ import annotations

import copy
import operator
from typing import Any, ClassVar

from numba.core import ir, lowering, types
from numba.core.compiler import Compiler
from numba.core.cpu import CPUContext
from numba.core.ir_utils import build_definitions
from numba.core.ssa import reconstruct_ssa
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
from numba.core.untyped_passes import (
    FixupArgs,
    GenericRewrites,
    ReconstructSSA,
    TranslateByteCode,
)


class _Typing(Context):
    """What is known of types, with the calls of numba's functions that were typed before."""

    known: ClassVar[dict[Any, Any]] = {}

    def refresh(self) -> None:
        """Nothing new since the copy was made."""

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """The signature of a call."""
        if type(func) is not types.Function and getattr(func, "__module__", "") != operator.add.__module__:
            return super().resolve_function_type(func, args, kws)
        key = func, args, tuple(kws.items())
        found = self.known.get(key)
        if found is None:
            found = super().resolve_function_type(func, args, kws)
            if found is not None:
                self.known[key] = found
        return found


class _Target(CPUContext):
    """How code is made of types; looks for what is new only where it misses something."""

    looks = False
    numbered = True  # names of functions

    def refresh(self) -> None:
        """Take in what was registered since."""
        if self.looks:
            super().refresh()
            self.looks = False  # once a function

    def mangler(self, name: str, types: Any, *, abi_tags: Any = (), uid: Any = None) -> str:
        """The name of a function in LLVM code."""
        return str(super().mangler(name, types, abi_tags=abi_tags, uid=uid if self.numbered else None))


class _Lower(lowering.Lower):
    """Lowering that counts references only to what is counted."""

    def _counted(self, of: types.Type) -> bool:
        return bool(self.context.enable_nrt and self.context.data_model_manager[of].contains_nrt_meminfo())

    def incref(self, typ: types.Type, val: Any) -> None:
        """One reference more."""
        if self._counted(typ):
            super().incref(typ, val)

    def decref(self, typ: types.Type, val: Any) -> None:
        """One reference less."""
        if self._counted(typ):
            super().decref(typ, val)

    def delvar(self, name: str) -> None:
        """A variable is not used any more."""
        if self._counted(self.typeof(name)):
            super().delvar(name)
        elif name not in self._blk_local_varmap:
            self._singly_assigned_vars.discard(name)
            self._alloca_var(name, self.typeof(name))


_LENT = {"getitem", "static_getitem", "typed_getitem", "getattr", "cast", "phi", "build_tuple", "exhaust_iter"}
"""Operations whose result is part of what there was."""


class _Lowering(NativeLowering):
    """To LLVM code."""

    @property
    def lowering_class(self) -> Any:
        return _Lower

    def run_pass(self, state: Any) -> bool:
        """Lower, with references counted where there are some."""
        state.targetctx.enable_nrt = self._owns(state)
        return bool(super().run_pass(state))

    def _owns(self, state: Any) -> bool:
        """Whether a function makes arrays, is given new ones by what it calls, or returns one."""
        models = state.targetctx.data_model_manager
        of = [state.return_type]
        for block in state.func_ir.blocks.values():
            for made in block.find_insts(ir.Assign):
                if isinstance(made.value, ir.Expr) and made.value.op not in _LENT:
                    of.append(state.typemap[made.target.name])
        return any(models[one].contains_nrt_meminfo() for one in dict.fromkeys(of))


class _ArrayRewrites(NopythonRewrites):
    """Expressions of whole arrays become loops."""

    def run_pass(self, state: Any) -> bool:
        """Rewrite, where there are some."""
        signatures = [one for call, one in state.calltypes.items() if isinstance(call, ir.Expr) and call.op in _SUMS]
        return any(isinstance(one.return_type, types.Array) for one in signatures) and bool(super().run_pass(state))


_SUMS = {"binop", "inplace_binop", "unary", "call"}


class _SSA(ReconstructSSA):
    """Each variable assigned once."""

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
        self.exec_times: dict[str, Any] = {}

    def run(self, state: Any) -> None:
        """Run all."""
        for one in _PASSES:
            one.run_pass(state)


class LeanCompiler(Compiler):
    """numba's compiler for functions of numbers and arrays."""

    def __init__(self, typingctx: Any, targetctx: Any, *args: Any) -> None:
        typing, target = copy.copy(typingctx), copy.copy(targetctx)
        typing.__class__, target.__class__ = _Typing, _Target
        super().__init__(typing, target, *args)
        self.state.targetctx.looks = True

    def define_pipelines(self) -> list[Any]:
        """What is run."""
        return [_Pipeline()]


def fits() -> bool:
    """Whether this numba has the parts that are replaced here."""
    parts = {
        Context: ("refresh", "resolve_function_type"),
        CPUContext: ("refresh", "mangler"),
        lowering.Lower: ("incref", "decref", "delvar", "typeof", "_alloca_var", "_find_singly_assigned_variable"),
    }
    return all(hasattr(one, name) for one, names in parts.items() for name in names)
