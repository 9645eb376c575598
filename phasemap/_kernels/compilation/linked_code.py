"""LLVM code of kernels: linked with all that it reaches, and optimised as a whole where Python calls it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite.binding import Linkage, parse_assembly
from numba.core import cgutils, config, types
from numba.core.callconv import RETCODE_OK, CPUCallConv
from numba.core.codegen import JITCodeLibrary
from numba.core.imputils import impl_ret_new_ref


class OurCode(JITCodeLibrary):
    """Code that is optimised as a whole only."""

    def __init__(self, codegen: Any, name: str) -> None:
        super().__init__(codegen, name)
        self.needs: dict[Callable[[], None], None] = {}  # has to be called, to load it, before this is loaded

    def add_ir_module(self, ir_module: Any) -> None:
        """Take in lowered code; it is verified with all the rest."""
        self._raise_if_finalized()
        self.add_llvm_module(parse_assembly(cgutils.normalize_ir_text(str(ir_module))))

    def add_llvm_module(self, ll_module: Any) -> None:
        """Take in lowered code, as it is."""
        ll_module.data_layout = self._codegen._data_layout
        self._final_module.link_in(ll_module)


class LinkedCode(OurCode):
    """Code to be linked: neither optimised nor emitted."""

    def finalize(self) -> None:
        """Close the code: nothing may be added any more."""
        self._raise_if_finalized()
        self._finalize_dynamic_globals()
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """Module with the code of the functions that it calls, for callers that are not ours."""
        whole = self._final_module.clone()
        _link(self, whole, "linkonce_odr")
        return whole


class EntryCode(OurCode):
    """Code that is linked with all that it reaches, optimised as a whole, and emitted."""

    def finalize(self) -> None:
        """Link, optimise and emit."""
        self._raise_if_finalized()
        _link(self, self._final_module, "private")  # LLVM finds even an "internal" name from other modules
        self._optimize_final_module()
        self._final_module.verify()
        self._finalize_final_module()


class VectorCode(EntryCode):
    """Code of an entry, with statements that follow one another in vector instructions too, as C compilers have it."""

    def _optimize_final_module(self) -> None:
        """Numba's hook, called once: optimise with LLVM's vectorizer of straight-line code (SLP) switched on."""
        before, config.SLP_VECTORIZE = config.SLP_VECTORIZE, 1
        try:
            super()._optimize_final_module()
        finally:
            config.SLP_VECTORIZE = before


def _reached(library: Any, through: type = JITCodeLibrary) -> list[Any]:
    """Libraries that a library needs, each once, up to shared ones; found through libraries of a kind."""
    reached: dict[Any, None] = {}
    open_ = [library]
    while open_:
        for linked in open_.pop()._linking_libraries:
            if linked not in reached:
                reached[linked] = None
                if isinstance(linked, through) and not hasattr(linked, "needed"):
                    open_.append(linked)
    return list(reached)


def _link(library: Any, module: Any, linkage: str) -> None:
    """Add all that a library reaches to its module, with this linkage."""
    own = {one.name for one in module.functions if not one.is_declaration}
    # A function of numba that is given one of ours, as `engage_in_time` its `tip`, holds that code and may need more.
    library.needs.update({one.needed: None for one in _reached(library) if hasattr(one, "needed")})
    for other in _reached(library, through=LinkedCode):  # what is to be linked does not hold what it calls itself
        if hasattr(other, "needed"):
            continue
        if isinstance(other, LinkedCode):
            library.needs.update(other.needs)
            module.link_in(other._final_module, preserve=True)
            continue
        code = other._get_module_for_linking().clone()
        for one in code.functions:  # LLVM leaves out what may be discarded and is not called yet
            if one.linkage == Linkage.linkonce_odr:
                one.linkage = "weak_odr"
        module.link_in(code)
    for one in module.functions:
        if not one.is_declaration and one.name not in own:
            one.linkage, one.visibility = linkage, "default"


class _Whole:
    """The arguments of a function, a tuple among them as one LLVM value, where numba passes each of its members.

    A call of many numbers is then one store and one load instead of a long list. What is empty is left out.
    """

    def __init__(self, models: Any, kinds: Sequence[types.Type]) -> None:
        self._models = [models.lookup(kind) for kind in kinds]
        self._parts = [model.get_argument_type() for model in self._models]

    @property
    def argument_types(self) -> tuple[Any, ...]:
        """LLVM types of the arguments."""
        return tuple(
            model.get_value_type() if isinstance(part, tuple) else part
            for model, part in zip(self._models, self._parts, strict=True)
            if part != ()
        )

    def as_arguments(self, builder: Any, values: Sequence[Any]) -> list[Any]:
        """Values in the form in which a call passes them."""
        return [
            value if isinstance(part, tuple) else model.as_argument(builder, value)
            for model, part, value in zip(self._models, self._parts, values, strict=True)
            if part != ()
        ]

    def from_arguments(self, builder: Any, arguments: Sequence[Any]) -> list[Any]:
        """Values from the arguments that were passed."""
        passed = iter(arguments)
        return [
            model.from_argument(builder, ()) if part == () else
            next(passed) if isinstance(part, tuple) else
            model.from_argument(builder, next(passed))
            for model, part in zip(self._models, self._parts, strict=True)
        ]  # fmt: skip

    def assign_names(self, *_: Any) -> None:
        """Do nothing, for names of arguments are for people."""


class WholeCalls(CPUCallConv):
    """A convention of calls from kernel to kernel."""

    def _get_arg_packer(self, kinds: Sequence[types.Type]) -> _Whole:
        """Numba's hook for how arguments are passed: here a tuple goes as one value, not member by member."""
        return _Whole(self.context.data_model_manager, kinds)

    def declare(self, module: Any, function: Any) -> Any:
        """Declaration of a function in a module."""
        kind = self.get_function_type(function.restype, function.argtypes)
        declared = cgutils.get_or_insert_function(module, kind, function.mangled_name)
        self.decorate_function(declared, function.args, function.argtypes)
        if function.inline:
            declared.attributes.add("alwaysinline")
        return declared


def called(function: Any, libraries: Sequence[Any]) -> Callable[..., Any]:
    """Function by which numba makes a call of a kernel, given its description."""

    def make(context: Any, builder: Any, _signature: Any, values: Sequence[Any]) -> Any:
        calls = WholeCalls(context)
        result = cgutils.alloca_once(builder, calls.get_return_type(function.restype).pointee)
        arguments = calls._get_arg_packer(function.argtypes).as_arguments(builder, values)
        error = calls._get_excinfo_argument(builder.function)
        code = builder.call(calls.declare(builder.module, function), [result, error, *arguments])
        with cgutils.if_unlikely(builder, builder.icmp_unsigned("!=", code, RETCODE_OK)):
            builder.ret(code)
        value = context.get_returned_value(builder, function.restype, builder.load(result))
        return impl_ret_new_ref(context, builder, function.restype, value)

    make.signature = function.argtypes  # type: ignore[attr-defined]
    make.libs = tuple(libraries)  # type: ignore[attr-defined]
    return make
