"""Compilation and caching of planning kernels; the only module of `planners` that imports numba.

There are three decorators. `entry_kernel` makes a kernel that Python calls. `kernel` makes a kernel
that only kernels call; it is inlined and has no wrappers for Python, which would take a seventh of
the compile time. `called_kernel` makes a kernel that only kernels call and that is too large to be
inlined, so there is one copy of it.

Kernels of the last two kinds are not optimized, compiled to machine code or cached by themselves.
LLVM optimizes an entry kernel after all kernels that it calls are linked. Optimizing each of them
before would take a third of the compile time, and its unused machine code a tenth. A kernel is
compiled again for every entry kernel that calls it, so there are few entry kernels. Kernels do not
allocate memory, so there is no reference counting; callers pass scratch buffers.

Named tuples of classes with the decorator `by_reference` are laid out in memory when Python calls a
kernel, and kernels pass one pointer. Passing all fields of all arrays, some 200 words, took a third
of the compile time.

Code for some problems only is removed by type: if the argument `conjunction` is None, numba decides
`if conjunction is None` at compile time.

In a call from kernel to kernel, a literal has its own type, such as `Literal[int](0)`, and the
callee is compiled again for this type. So constant arguments are typed: `np.int64(0)`,
`np.bool_(True)`, `NO_BEHAVIOR`. The same holds for a variable that begins with a constant and is
passed on.

numba's cache only checks the file of a kernel, but kernels call kernels in other files. Therefore
the version of the cache contains a digest of every file that may contain a kernel. After a change
in any of them, everything is compiled again.

In the docstrings of kernels, "Compute A -> B" means that the kernel writes A into the array B.
"""

import contextlib
import functools
import hashlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numba import _dynfunc, njit
from numba.core import cgutils, event, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, Flags
from numba.core.dispatcher import Dispatcher
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)

from meal_bayes.cache import compile_kernel

Index = int | np.int64
PREPARING = "preparing the planner, once after an install, about 10 s"
NO_BEHAVIOR: Index = np.int64(-1)  # index that stands for no behavior


class _Flags(Flags):  # type: ignore[misc]  # numba has no types
    """Compiler flags that all kernels share.

    numba looks up compiled calls by a copy of the caller's flags. Comparing the copies of different
    kernels takes a tenth of the compile time.
    """

    def __init__(self, flags: Flags) -> None:
        super().__init__(flags)
        self._hash = hash(flags)

    def __hash__(self) -> int:
        return self._hash

    def copy(self) -> "_Flags":
        return self


_shared_flags = functools.cache(_Flags)


class _EntryLibrary(JITCodeLibrary):  # type: ignore[misc]  # numba has no types
    """Code whose functions are optimized once, after all called functions are linked."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        # One pass; numba's earlier pass only removes reference counts, of which there are none.
        manager = self._codegen._module_pass_manager()
        passes, *settings = manager if isinstance(manager, tuple) else (manager,)  # numba < .62
        passes.run(self._final_module, *settings)

    def add_ir_module(self, ir_module: Any) -> None:
        # Functions without a decorator for inlining are never inlined. This is necessary for entry
        # kernels, which would treat values that their wrapper writes as constants.
        defined = [function for function in ir_module.functions if not function.is_declaration]
        if not any("alwaysinline" in function.attributes for function in defined):
            for function in defined:
                function.attributes.add("noinline")
        super().add_ir_module(ir_module)


class _LinkedLibrary(_EntryLibrary):
    """Code that is only linked into entry kernels, and not optimized or compiled by itself."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalized = True


class _EntryCompiler(Compiler):  # type: ignore[misc]  # numba has no types
    """Compiles a kernel that Python calls."""

    library: type[_EntryLibrary] = _EntryLibrary

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        codegen = self.state.targetctx.codegen()
        self.state.library = self.library(codegen, function.__qualname__)
        self.state.library.enable_object_caching()
        self.state.flags = _shared_flags(self.state.flags)
        return super().compile_extra(function)


class _LinkedCompiler(_EntryCompiler):
    """Compiles a kernel that Python does not call."""

    library = _LinkedLibrary

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        self.state.targetctx.get_executable = _without_machine_code
        return super().compile_extra(function)


def _without_machine_code(library: Any, function: Any, environment: Any) -> Any:
    """Return a placeholder for the function that Python would call."""
    module = function.lookup_module()
    return _dynfunc.make_function(module, function.qualname, "", 0, environment, (library,))


_OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}
_PACKAGE = Path(__file__).parents[1]
_SHARED = (  # functions of theirs are compiled
    *(_PACKAGE / "momdp" / name for name in ("observation.py", "reports.py")),
    _PACKAGE / "arrays.py",
)
_DIGEST = hashlib.blake2b(digest_size=8)
for _path in (*sorted(Path(__file__).parent.rglob("*.py")), *_SHARED):
    _DIGEST.update(_path.read_bytes())


def entry_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel that Python calls, at its first call; later processes load it."""
    return _versioned(compile_kernel(function, **_OPTIONS, pipeline_class=_EntryCompiler))


def called_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a large kernel that only kernels call."""
    return _linked(function, inline=False)


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel that only kernels call, and inline it there."""
    return _linked(function, inline=True)


def _linked(function: Callable[..., Any], *, inline: bool) -> Callable[..., Any]:
    compiled = njit(
        function,
        **_OPTIONS,
        pipeline_class=_LinkedCompiler,
        forceinline=inline,
        no_cpython_wrapper=True,
    )
    return cast(Callable[..., Any], compiled)


def _versioned(compiled: Callable[..., Any]) -> Callable[..., Any]:
    cache_file = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if cache_file is not None:  # None where nothing is cached
        cache_file._version = f"{cache_file._version} {_DIGEST.hexdigest()}"
    return compiled


# --- Named tuples by reference


class Reference(types.Type):  # type: ignore[misc]  # numba has no types
    """The type of a pointer to a named tuple of arrays."""

    def __init__(self, held: types.BaseNamedTuple) -> None:
        fields = [getattr(field, "held", field) for field in held.types]  # also those inside
        self.held = types.NamedTuple(fields, held.instance_class)
        digest = hashlib.blake2b(str(self.held.key).encode(), digest_size=8).hexdigest()
        super().__init__(f"Reference({held.instance_class.__name__}, {digest})")


@register_model(Reference)
class _ReferenceModel(models.PrimitiveModel):  # type: ignore[misc]  # numba has no types
    def __init__(self, manager: Any, of: Reference) -> None:
        super().__init__(manager, of, manager.lookup(of.held).get_data_type().as_pointer())


N = TypeVar("N", bound=type)


def by_reference(of: N) -> N:
    """Let kernels take a class of named tuples by pointer, including named tuples inside it."""

    @typeof_impl.register(of)  # type: ignore[untyped-decorator]  # numba has no types
    def _typeof(value: Any, context: Any) -> Reference:
        return Reference(typeof_impl.dispatch(tuple)(value, context))

    return of


@unbox(Reference)  # type: ignore[untyped-decorator]  # numba has no types
def _unbox(reference: Reference, value: Any, c: Any) -> NativeValue:
    """Write a named tuple into memory that is valid during the call from Python."""
    held = reference.held
    place = cgutils.alloca_once(c.builder, c.context.data_model_manager[held].get_data_type())
    failed = cgutils.alloca_once_value(c.builder, cgutils.false_bit)
    _lay_out(held, value, place, failed, c)
    return NativeValue(place, is_error=c.builder.load(failed))


def _lay_out(held: Any, value: Any, place: Any, failed: Any, c: Any) -> None:
    """Write the fields of a named tuple to their places."""
    builder = c.builder
    for number, field in enumerate(held.types):
        of_field = c.pyapi.tuple_getitem(value, number)
        to = cgutils.gep_inbounds(builder, place, 0, number)
        if isinstance(field, types.BaseNamedTuple):
            _lay_out(field, of_field, to, failed, c)
        elif isinstance(field, types.Array):
            wrong = c.pyapi.numba_array_adaptor(of_field, builder.bitcast(to, c.pyapi.voidptr))
            bad = cgutils.is_not_null(builder, wrong)
            builder.store(builder.or_(builder.load(failed), bad), failed)
        elif not isinstance(field, types.NoneType):
            native = c.unbox(field, of_field)
            model = c.context.data_model_manager[field]
            builder.store(model.as_data(builder, native.value), to)
            builder.store(builder.or_(builder.load(failed), native.is_error), failed)


@infer_getattr
class _ReferenceFields(AttributeTemplate):  # type: ignore[misc]  # numba has no types
    key = Reference

    def generic_resolve(self, reference: Reference, name: str) -> Any:
        held = reference.held
        if name not in held.fields:
            return None
        field = held.types[held.fields.index(name)]
        return Reference(field) if isinstance(field, types.BaseNamedTuple) else field


@lower_getattr_generic(Reference)  # type: ignore[untyped-decorator]  # numba has no types
def _read_field(context: Any, builder: Any, reference: Reference, value: Any, name: str) -> Any:
    """Read a field of a named tuple behind a pointer; return a pointer to an inner named tuple."""
    place = reference.held.fields.index(name)
    field = reference.held.types[place]
    pointer = cgutils.gep_inbounds(builder, value, 0, place)
    if isinstance(field, types.BaseNamedTuple):
        return pointer
    return context.data_model_manager[field].load_from_data_pointer(builder, pointer)


class Compiling(NamedTuple):
    """Progress of the compilation of an entry kernel."""

    entry: str  # name of the entry kernel
    kernel: str  # name of the kernel that is being compiled
    done: int  # kernels that are compiled for it
    most: int  # kernels that it may lead to, itself included


def _reachable(kernel: Any, reachable: set[Any]) -> set[Any]:
    """Find all kernels that a kernel may call, directly or indirectly, including itself."""
    reachable.add(kernel)
    for name in kernel.py_func.__code__.co_names:
        called = kernel.py_func.__globals__.get(name)
        if isinstance(called, Dispatcher) and called not in reachable:
            _reachable(called, reachable)
    return reachable


class _Watch(event.Listener):  # type: ignore[misc]  # numba has no types
    def __init__(self, report: Callable[[Compiling], None], end: Callable[[], None]) -> None:
        self._report = report
        self._end = end
        self._stack: list[Any] = []
        self._done: set[Any] = set()
        self._reachable: set[Any] = set()

    def on_start(self, started: Any) -> None:
        kernel = started.data["dispatcher"]
        if not self._stack:
            self._done = set()
            self._reachable = _reachable(kernel, set())
        self._stack.append(kernel)
        # Functions of numba itself count as part of the kernel that needs them.
        if kernel in self._reachable:
            entry = self._stack[0].__name__
            counts = len(self._done), len(self._reachable)
            self._report(Compiling(entry, kernel.__name__, *counts))

    def on_end(self, ended: Any) -> None:
        self._done |= self._reachable & {self._stack.pop()}
        if not self._stack:
            self._end()


class _Preparing(event.Listener):  # type: ignore[misc]  # numba has no types
    """Print once, on a terminal or in a notebook, why the first question takes longer."""

    said = False
    watchers = 0  # which show it in their own way

    def on_start(self, started: Any) -> None:
        module = started.data["dispatcher"].py_func.__module__  # None where a program wrote it
        ours = module is not None and module.startswith("meal_bayes.")
        if not ours or self.said or self.watchers or sys.stderr is None:
            return
        if "ipykernel" in sys.modules or sys.stderr.isatty():
            sys.stderr.write(f"meal_bayes: {PREPARING}\n")
            sys.stderr.flush()
            self.said = True

    def on_end(self, ended: Any) -> None:
        pass


_PREPARING = _Preparing()
event.register("numba:compile", _PREPARING)


@contextlib.contextmanager
def watch_compilation(
    report: Callable[[Compiling], None], end: Callable[[], None]
) -> Iterator[None]:
    """Call `report` for every kernel that is compiled in a block, and `end` after an entry kernel.

    Nothing is called if the kernels are loaded from the cache.
    """
    _PREPARING.watchers += 1
    try:
        with event.install_listener("numba:compile", _Watch(report, end)):
            yield
    finally:
        _PREPARING.watchers -= 1
