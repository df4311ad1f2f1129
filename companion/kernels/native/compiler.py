"""Compiles kernels to object code, by numba's front end and LLVM.

Each kernel becomes a module of its own: its function, the code of inlined callees, and a door for calls from
Python. It calls other kernels by their symbols. It does without numba's runtime (the option ``nrt``), so
nothing is allocated and no reference is counted.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba.core import bytecode, codegen, compiler, compiler_lock, errors, funcdesc, types
from numba.core.imputils import lower_builtin
from numba.core.registry import cpu_target
from numba.core.untyped_passes import ExtractByteCode

from companion.kernels.native import kinds, numba_types
from companion.kernels.native.kernel import Kernel
from companion.kernels.native.store import kernel_store

__all__ = ["compiled"]

_Typed = Any  # Objects of numba's compiler have no static types.

FOREIGN = ("numba_", "NRT_", "Py", "_Py", "_ZN5numba")  # Symbols that only numba or the interpreter define.


class _Library(codegen.JITCodeLibrary):
    """The LLVM module of one kernel. Numba's own engine never runs it.

    Parameters
    ----------
    one : Kernel
        The kernel.
    exported : tuple of str
        Functions that others call by their symbols. A module without any is copied into others.
    """

    def __init__(self, one: Kernel, exported: tuple[str, ...] = ()) -> None:
        super().__init__(cpu_target.target_context.codegen(), one.symbol)
        self._exported = exported

    def add_llvm_module(self, module: _Typed) -> None:
        """Link code without optimising it: the whole module is optimised once."""
        self._final_module.link_in(module)

    def _optimize_final_module(self) -> None:
        """Optimise the module, unless it is copied into others. LLVM may drop what is not exported."""
        module = self._final_module
        if not self._exported:
            return
        for each in (*module.functions, *module.global_variables):
            if not each.is_declaration and each.name not in self._exported:
                each.linkage = "internal"
        passes, builder = self._codegen._module_pass_manager()
        passes.run(module, builder)

    def _finalize_final_module(self) -> None:
        """Mark the module as finished, without adding it to numba's engine."""
        self._finalized = True

    def take(self, bitcode: bytes) -> None:
        """Become a module that was stored."""
        self._shared_module, self._finalized = llvm.parse_bitcode(bitcode), True

    def bitcode(self) -> bytes:
        """Return the module for the store, as others copy it."""
        return bytes(self._get_module_for_linking().as_bitcode())

    def object_code(self) -> bytes:
        """Return the machine code."""
        return bytes(self._codegen._tm.emit_object(self._final_module))

    def declared(self) -> list[str]:
        """Return the symbols that the module uses and does not define."""
        return [function.name for function in self._final_module.functions if function.is_declaration]


class _Pipeline(compiler.Compiler):
    """Numba's pipeline, with the same symbol for the same kernel in every process."""

    def compile_extra(self, func: _Typed) -> _Typed:
        """Compile a function under its own name, without the counter that numba adds."""
        self.state.func_id = bytecode.FunctionIdentity.from_function(func)
        self.state.func_id.unique_id = 0
        ExtractByteCode().run_pass(self.state)
        self.state.lifted, self.state.lifted_from = (), None
        return self._compile_bytecode()


def compiled(one: Kernel) -> bytes:
    """Return the object code of a kernel, with a door if its result consists of numbers.

    Raises
    ------
    RuntimeError
        If numba cannot compile the kernel, or if the code needs numba's runtime or the interpreter.
    """
    with compiler_lock.global_compiler_lock:
        context, door = cpu_target.target_context, f"door.{one.symbol}"
        context.refresh()
        library = _Library(one, (_descriptor(one).mangled_name, door))
        if one.is_inlined:
            library.add_linking_library(_copied(one))
        else:
            _add_function(one, library)
        if kinds.is_of_numbers(one.signature.returns):
            _add_door(one, library, door)
        library.finalize()
        called = {_descriptor(callee).mangled_name for callee in one.linked}
        for name in library.declared():
            if name not in called and name.startswith(FOREIGN):
                raise RuntimeError(
                    f"{one.symbol} cannot be compiled: {name} is missing; a kernel cannot allocate"
                )
        return library.object_code()


@cache
def _copied(one: Kernel) -> _Library:
    """Return the module of an inlined kernel, from the store or compiled."""
    store, library = kernel_store(), _Library(one)
    kept = store.read(one.file("bc"))
    if kept is None:
        _add_function(one, library)
        library.finalize()
        store.write(one.file("bc"), library.bitcode())
    else:
        library.take(kept)
    return library


def _add_function(one: Kernel, library: _Library) -> None:
    """Compile a kernel's function into a module."""
    for callee in one.callees:
        _register_calls(callee)
    typing, context = cpu_target.typing_context, cpu_target.target_context
    declared = numba_types.signature_in_numba(one)
    arguments: tuple[_Typed, ...] = declared.args, declared.return_type, _flags(one), {}, library, _Pipeline
    try:
        result = compiler.compile_extra(typing, context, one.py_func, *arguments)
    except (errors.NumbaError, NotImplementedError) as error:
        raise RuntimeError(f"{one.symbol} cannot be compiled: {error}") from error
    assert result.fndesc.mangled_name == _descriptor(one).mangled_name


@cache
def _register_calls(one: Kernel) -> None:
    """Tell numba how a kernel is called: by its symbol, which is copied with its code if it is inlined."""

    def call(context: _Typed, builder: _Typed, sig: _Typed, args: _Typed) -> _Typed:
        if one.is_inlined:
            context.add_linking_libs([_copied(one)])
        return context.call_internal(builder, _descriptor(one), sig, args)

    lower_builtin(one, types.VarArg(types.Any))(call)


@cache
def _descriptor(one: Kernel) -> funcdesc.FunctionDescriptor:
    """Return numba's description of a kernel, which is known before the kernel is compiled."""
    declared, function = numba_types.signature_in_numba(one), one.py_func
    return funcdesc.FunctionDescriptor(
        True, function.__module__, function.__qualname__, one.symbol, "", None, declared.return_type, None,
        one.signature.names, (), mangler=cpu_target.target_context.mangler, argtypes=declared.args,
        abi_tags=[_flags(one).get_mangle_string()], uid=0,
    )  # fmt: skip


@cache
def _flags(one: Kernel) -> _Typed:
    flags: _Typed = compiler.Flags()
    flags.error_model = "numpy" if one.has_numpy_errors else "python"
    flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
    flags.enable_pyobject = flags.enable_looplift = False
    return flags


def _add_door(one: Kernel, library: _Library, name: str) -> None:
    """Add the function that Python calls.

    It takes the address of the arguments' words, behind which it writes those of the result. It returns 0.
    For an exception it returns 1, and writes the address and the size of numba's description into the first
    words.
    """
    context, word = cpu_target.target_context, numba_types.WORD
    module = library.create_ir_module(name)
    door = ir.Function(module, ir.FunctionType(word, [word.as_pointer()]), name)
    builder = ir.IRBuilder(door.append_basic_block())
    words, offset, values = door.args[0], 0, []
    for kind in one.signature.kinds:
        values.append(numba_types.load(context, builder, kind, words, offset))
        offset += kinds.num_words(kind)
    descriptor = _descriptor(one)
    body = context.declare_function(module, descriptor)
    call: Callable[..., _Typed] = context.call_conv.call_function
    status, result = call(builder, body, descriptor.restype, descriptor.argtypes, values)
    with builder.if_then(status.is_error, likely=False):
        about = builder.load(status.excinfoptr)
        address = builder.ptrtoint(builder.extract_value(about, 0), word)
        size = builder.zext(builder.extract_value(about, 1), word)
        for place, value in enumerate((address, size)):
            builder.store(value, builder.gep(words, [word(place)]))
        builder.ret(word(1))
    _store(builder, one.signature.returns, result, words, offset)
    builder.ret(word(0))
    library.add_ir_module(module)


def _store(builder: _Typed, kind: kinds.Kind, value: _Typed, words: _Typed, offset: int) -> None:
    """Generate code that writes a result, ``offset`` words behind an address."""
    if isinstance(kind, kinds.Tuple):
        for index, item in enumerate(kind.items):
            _store(builder, item, builder.extract_value(value, index), words, offset)
            offset += kinds.num_words(item)
    elif isinstance(kind, kinds.Scalar):
        place = builder.gep(words, [numba_types.WORD(offset)])
        if kind.code == "b":
            value = builder.zext(value, numba_types.WORD)
        builder.store(value, builder.bitcast(place, value.type.as_pointer()))
