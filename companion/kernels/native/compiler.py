"""Kernels to object code, by numba's front end and LLVM.

Each kernel is a module of its own: its function, what is copied into it, and a door for Python. It calls other
kernels by their symbols. Without numba's runtime (``nrt``) nothing is allocated and no reference is counted.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba.core import bytecode, codegen, compiler, compiler_lock, errors, funcdesc
from numba.core.registry import cpu_target

from companion.kernels.native import kinds, numba_types
from companion.kernels.native.kernel import Kernel
from companion.kernels.native.store import kernel_store

_Typed = Any  # numba's compiler hands over objects that have no static types

FOREIGN = (
    "numba_",
    "NRT_",
    "Py",
    "_Py",
    "_ZN5numba",
)  # symbols that only numba or the interpreter could give


class _Library(codegen.JITCodeLibrary):
    """What one kernel consists of, in LLVM's terms, which no engine of numba's runs.

    ``exported`` are the functions that others call by their symbols. What has none is copied into others.
    """

    def __init__(self, one: Kernel, exported: tuple[str, ...] = ()) -> None:
        super().__init__(cpu_target.target_context.codegen(), one.symbol)
        self._exported = exported

    def add_llvm_module(self, module: _Typed) -> None:
        """Take the code as it is: it is optimised once, when all is together."""
        self._final_module.link_in(module)

    def _optimize_final_module(self) -> None:
        """Optimise what is not copied into others; what only this kernel calls is its own."""
        module = self._final_module
        if not self._exported:
            return
        for each in (*module.functions, *module.global_variables):
            if not each.is_declaration and each.name not in self._exported:
                each.linkage = "internal"
        passes, builder = self._codegen._module_pass_manager()
        passes.run(module, builder)

    def _finalize_final_module(self) -> None:
        """Nothing runs from here."""
        self._finalized = True

    def take(self, bitcode: bytes) -> None:
        """Be what was kept."""
        self._shared_module, self._finalized = llvm.parse_bitcode(bitcode), True

    def bitcode(self) -> bytes:
        """What is copied into others, to be kept."""
        return bytes(self._get_module_for_linking().as_bitcode())

    def object_code(self) -> bytes:
        """What runs."""
        return bytes(self._codegen._tm.emit_object(self._final_module))

    def declared(self) -> list[str]:
        """Symbols that are called and not defined."""
        return [function.name for function in self._final_module.functions if function.is_declaration]


class _Pipeline(compiler.Compiler):
    """Numba's pipeline, with the same symbol for the same kernel in every process."""

    def compile_extra(self, func: Any) -> _Typed:
        """Compile a function under its own name."""
        self.state.func_id = bytecode.FunctionIdentity.from_function(func)
        self.state.func_id.unique_id = 0
        compiler.ExtractByteCode().run_pass(self.state)
        self.state.lifted, self.state.lifted_from = (), None
        return self._compile_bytecode()


@cache
def _descriptor(one: Kernel) -> funcdesc.FunctionDescriptor:
    """How others call a kernel, known before it is compiled."""
    declared = numba_types.signature_in_numba(one)
    function = one.py_func
    return funcdesc.FunctionDescriptor(
        True, function.__module__, function.__qualname__, one.symbol, "", None, declared.return_type, None,
        one.signature.names, (), mangler=cpu_target.target_context.mangler, argtypes=declared.args,
        abi_tags=[_flags(one).get_mangle_string()], uid=0,
    )  # fmt: skip


@cache
def _flags(one: Kernel) -> compiler.Flags:
    flags = compiler.Flags()
    flags.error_model = "numpy" if one.has_numpy_errors else "python"
    flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
    flags.enable_pyobject = flags.enable_looplift = False
    return flags


def call_of(one: Kernel) -> _Typed:
    """What generates a call of a kernel."""

    def call(context: _Typed, builder: _Typed, sig: _Typed, args: _Typed) -> _Typed:
        if one.is_inlined:
            context.add_linking_libs([_copied(one)])
        return context.call_internal(builder, _descriptor(one), sig, args)

    return call


def compiled(one: Kernel) -> bytes:
    """The object code of a kernel, with its door.

    Raises
    ------
    RuntimeError
        If numba cannot compile it, or it needs what only numba's runtime or the interpreter could give.
    """
    with compiler_lock.global_compiler_lock:
        context, door = cpu_target.target_context, f"door.{one.symbol}"
        context.refresh()
        library = _Library(one, (_descriptor(one).mangled_name, door))
        if one.is_inlined:
            library.add_linking_library(_copied(one))
        else:
            _front_end(one, library)
        if _has_door(one.signature.returns):
            _add_door(context, library, one, door)
        library.finalize()
        _refuse_foreign(one, library)
        return library.object_code()


@cache
def _copied(one: Kernel) -> _Library:
    """What is copied into callers, read or compiled."""
    store, library = kernel_store(), _Library(one)
    kept = store.read(one.file("bc"))
    if kept is None:
        _front_end(one, library)
        library.finalize()
        store.write(one.file("bc"), library.bitcode())
    else:
        library.take(kept)
    return library


def _front_end(one: Kernel, library: _Library) -> None:
    """Add a kernel's own code to a library, with what is copied into it still to be linked."""
    typing, context = cpu_target.typing_context, cpu_target.target_context
    declared = numba_types.signature_in_numba(one)
    try:
        result = compiler.compile_extra(
            typing,
            context,
            one.py_func,
            declared.args,
            declared.return_type,
            _flags(one),
            {},
            library,
            _Pipeline,
        )
    except (errors.NumbaError, NotImplementedError) as error:
        raise RuntimeError(f"{one.symbol} cannot be compiled: {error}") from error
    assert result.fndesc.mangled_name == _descriptor(one).mangled_name


def _has_door(returns: kinds.Kind) -> bool:
    """Whether Python can be given what a kernel returns: numbers."""
    if isinstance(returns, kinds.Tuple):
        return all(map(_has_door, returns.items))
    return isinstance(returns, (kinds.Scalar, kinds.Nothing))


def _add_door(context: _Typed, library: _Library, one: Kernel, name: str) -> None:
    """A function that takes the address of words: the arguments, and behind them room for the result.

    It returns 0, or 1 for an exception, whose description's address and size it puts into the first two words.
    """
    module = library.create_ir_module(name)
    word = numba_types.WORD
    door = ir.Function(module, ir.FunctionType(word, [word.as_pointer()]), name)
    builder = ir.IRBuilder(door.append_basic_block())
    words, offset, values = door.args[0], 0, []
    for kind in one.signature.kinds:
        values.append(numba_types.load(context, builder, kind, words, offset))
        offset += kinds.num_words(kind)
    descriptor = _descriptor(one)
    body = context.declare_function(module, descriptor)
    status, result = context.call_conv.call_function(
        builder, body, descriptor.restype, descriptor.argtypes, values
    )
    with builder.if_then(status.is_error, likely=False):
        about = builder.load(status.excinfoptr)
        for place, item in ((0, 0), (1, 1)):
            part = builder.extract_value(about, item)
            part = builder.ptrtoint(part, word) if item == 0 else builder.zext(part, word)
            builder.store(part, builder.gep(words, [word(place)]))
        builder.ret(word(1))
    _store_result(builder, one.signature.returns, result, words, offset)
    builder.ret(word(0))
    library.add_ir_module(module)


def _store_result(builder: _Typed, kind: kinds.Kind, value: _Typed, words: _Typed, offset: int) -> None:
    if isinstance(kind, kinds.Tuple):
        for index, item in enumerate(kind.items):
            _store_result(builder, item, builder.extract_value(value, index), words, offset)
            offset += kinds.num_words(item)
    elif isinstance(kind, kinds.Scalar):
        place = builder.gep(words, [numba_types.WORD(offset)])
        if kind.code == "b":
            value = builder.zext(value, numba_types.WORD)
        builder.store(value, builder.bitcast(place, value.type.as_pointer()))


def _refuse_foreign(one: Kernel, library: _Library) -> None:
    called = {_descriptor(callee).mangled_name for callee in one.linked}
    for name in library.declared():
        if name not in called and name.startswith(FOREIGN):
            raise RuntimeError(
                f"{one.symbol} cannot be compiled: it needs {name}, and a kernel allocates nothing"
            )
