"""Compilation of the numerical kernels, with a cache folder for each state of their sources.

Numba's own file cache notices an edit to the file of a compiled function, but not an edit to a
function of another file that it calls. The cache folder is therefore named after a hash of every
kernel source of the package.

The cache holds machine code and an index that Python's pickle reads, and a pickle can run any code.
So the folder must belong to the user and nobody else may write to it; otherwise a temporary folder
replaces it. heyoka also keeps compiled code, in a folder of its own. dynkit reads no other code.
"""

from __future__ import annotations

import gc
import hashlib
import operator
import os
import stat
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, TypeVar

_QUIET = 1.0
"""Seconds of compilation without a notice."""


@dataclass
class Notice:
    """The line of text about compilations.

    Compilations are nested: that of a kernel begins before those of the kernels that it calls.

    Parameters
    ----------
    folder : Path
        Folder of the compiled kernels.
    clock : callable
        Function that returns the time in seconds.
    """

    folder: Path
    clock: Callable[[], float] = time.perf_counter
    _depth: int = 0
    _since: float = 0.0
    _shown: bool = False
    _collects: bool = False

    def begin(self) -> None:
        """Record that a compilation begins."""
        if not self._depth:
            self._since = self.clock()
            self._collects = gc.isenabled()
            gc.disable()
        self._depth += 1
        long = self.clock() - self._since > _QUIET
        if long and not self._shown and sys.stderr is not None and sys.stderr.isatty():
            self._shown = True
            text = f"dynkit compiles kernels, once (5 to 30 s), into {self.folder} ..."
            sys.stderr.write(text)
            sys.stderr.flush()

    def end(self) -> None:
        """Record that a compilation has ended."""
        self._depth -= 1
        if self._collects and not self._depth:
            gc.enable()
        if self._shown and not self._depth:
            self._shown = False
            sys.stderr.write(f" done in {self.clock() - self._since:.0f} s\n")


def announce(folder: Path) -> None:
    """Show the notice for all compilations of dynkit's kernels in this process."""
    from numba.core import event

    notice = Notice(folder)

    class Compilations(event.Listener):
        def on_start(self, event: Any) -> None:
            if _is_ours(event):
                notice.begin()

        def on_end(self, event: Any) -> None:
            if _is_ours(event):
                notice.end()

    register: Any = event.register
    register("numba:compile", Compilations())


def _is_ours(event: Any) -> bool:
    """Whether the compiled function is a kernel of dynkit, and not one of the user."""
    return str(event.data["dispatcher"].py_func.__module__).startswith("dynkit.")


_Function = TypeVar("_Function", bound=Callable[..., Any])

REORDERED = {"reassoc", "contract", "nsz"}
"""Fast-math flags of sums whose error bound holds for any order of the terms."""


def _user_cache() -> Path:
    if configured := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(configured)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def _private(folder: Path) -> bool:
    """Return whether this user, and nobody else, can write to the folder; create it if missing."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        if sys.platform == "win32":  # other users cannot write to a user's folders there
            return True
        found = folder.stat()
    except OSError:
        return False
    return found.st_uid == os.geteuid() and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _kernel_sources() -> list[Path]:
    package = Path(__file__).resolve().parents[1]
    return sorted(
        {
            source.resolve()
            for folder in (package, package / "systems", package / "analysis")
            for source in folder.rglob("*kernels.py")
        }
        | {Path(__file__).resolve()}
    )


@cache
def cache_folder() -> Path:
    """Return the folder of the compiled kernels, named after a hash of their sources.

    The hash also covers Numba's version.

    The base is ``NUMBA_CACHE_DIR`` where it is set, otherwise the user's cache folder. Where others
    may write to that folder, or the user may not, it is a temporary folder of this process.
    """
    import numba

    # versions of Numba would overwrite each other's index
    digest = hashlib.sha256(numba.__version__.encode())
    for source in _kernel_sources():
        digest.update(source.name.encode())
        digest.update(source.read_bytes())
    folder = _user_cache() / "dynkit" / f"kernels-{digest.hexdigest()[:16]}"
    return folder if _private(folder) else Path(tempfile.mkdtemp(prefix="dynkit-kernels-"))


@cache
def _announced() -> None:
    """Announce long compilations of this process."""
    announce(cache_folder())


_PASSES = {
    "translate_bytecode",
    "fixup_args",
    "ir_processing",
    "rewrite_semantic_constants",
    "dead_branch_prune",
    "generic_rewrites",
    "nopython_type_inference",
    "native_lowering",
    "nopython_backend",
}
"""Passes of Numba's compiler that kernels need, which have no closures or array expressions.

A variable of a kernel has one type, so that it need not be divided into one for each assignment.
"""


@cache
def _classes() -> Any:
    """Return subclasses of Numba's compiler classes that do only what kernels need.

    They take two thirds of the time. Numba would compile a function again for every integer
    constant that is passed to it. Inner kernels, which only kernels call, are compiled once for all
    integers, unless `constants` is true. Numba would also optimise each inner kernel, together with
    all kernels that it calls, and make machine code of it. Here the code of inner kernels is linked
    into the code of the entries, the kernels that Python calls, and optimised as a whole.

    An entry runs no code of another entry: otherwise its bits would depend on the order in which
    entries were loaded. All entries have the same bits: sums have a fixed order, except in
    functions that are not inlined, and these are optimised by themselves.
    """
    from llvmlite import binding
    from numba.core import cgutils, codegen, compiler, dispatcher, ir, types, typing
    from numba.core.compiler_machinery import FunctionPass, PassManager, register_pass
    from numba.core.registry import CPUDispatcher, cpu_target
    from numba.core.targetconfig import ConfigStack
    from numba.np import arrayobj

    library: Any = codegen.JITCodeLibrary
    pipeline: Any = compiler.Compiler
    manager: Any = PassManager
    tools: Any = cgutils
    items: Any = arrayobj
    code: Any = ir
    register: Any = register_pass
    options: Any = compiler.Flags
    context_of_types: Any = vars(typing)["Context"]
    compilation: Any = vars(dispatcher)["_FunctionCompiler"]
    operators, sizes = dict[Any, Any](), dict[str, int]()
    context: Any = cpu_target.target_context
    flags: Any = ConfigStack
    apart = b"noinline"

    class Function(types.Function):
        """A function of Numba, such as an operator, that keeps the types found for its calls.

        Numba would search its typing rules at each call. Implementations are those of `given`.
        """

        def __init__(self, given: Any) -> None:
            super().__init__(given.templates)
            self._impl_keys = given._impl_keys
            self._known: dict[Any, Any] = {}

        def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
            if kws:
                return super().get_call_type(context, args, kws)
            key = args, flags.top_or_none()  # some functions are compiled with their callers' flags
            if key not in self._known:
                found: Any = super().get_call_type(context, args, kws)
                self._known[key] = found, self._impl_keys[found.args]
            found, self._impl_keys[found.args] = self._known[key]
            return found

    function_of = cache(Function)

    class Typing(context_of_types):  # type: ignore[misc]
        """Numba's typing context, in which functions are instances of `Function`."""

        def resolve_value_type(self, value: Any) -> Any:
            if getattr(value, "__module__", None) != "_operator":
                return super().resolve_value_type(value)
            if value not in operators:
                operators[value] = function_of(super().resolve_value_type(value))
            return operators[value]

        def _resolve_user_function_type(self, given: Any, *rest: Any) -> Any:
            if type(given) is types.Function:
                given = function_of(given)
            elif getattr(given, "__module__", None) == "_operator":
                given = self.resolve_value_type(given)
            return super()._resolve_user_function_type(given, *rest)

    @cache
    def alike(context: Any) -> Any:
        found = Typing.__new__(Typing)
        found.__dict__ = context.__dict__
        return found

    class Flags(options):  # type: ignore[misc]
        __slots__ = ()
        __hash__ = object.__hash__

        def __eq__(self, other: object) -> bool:  # comparing all values each time takes long
            return self is other

        def copy(self) -> Any:
            return self

    class Compilation(compilation):  # type: ignore[misc]
        kinds: ClassVar[dict[str, Flags]] = {}

        def _customize_flags(self, flags: Any) -> Flags:
            return self.kinds.setdefault(repr(flags), Flags(flags))

    class Target(type(context)):  # type: ignore[misc]
        """Numba's target, with a third of its code for a number of an array."""

        def get_abi_sizeof(self, kind: Any) -> int:
            # kept: Numba compiles a module for each query of LLVM
            if (text := str(kind)) not in sizes:
                sizes[text] = super().get_abi_sizeof(kind)
            return sizes[text]

        def get_function(self, function: Any, signature: Any, **rest: Any) -> Any:
            if getattr(function, "typing_key", None) in (operator.getitem, operator.setitem):
                kind, index = signature.args[:2]
                axes = getattr(index, "types", (index,))
                whole = all(isinstance(each, types.Integer) for each in axes)
                if isinstance(kind, types.Array) and len(axes) == kind.ndim and whole:
                    return partial(self._item, signature.args, axes)
            return super().get_function(function, signature, **rest)

        def _item(self, kinds: Any, axes: Any, builder: Any, given: Any) -> Any:
            """Read a number of an array; write it if it is given."""
            kind, (array, index, *value) = kinds[0], given
            place = self.data_model_manager[kind].get_field_position
            shape, strides = (
                tools.unpack_tuple(builder, builder.extract_value(array, place(name)))
                for name in ("shape", "strides")
            )
            data = builder.extract_value(array, place("data"))
            given = [index] if axes == (kinds[1],) else tools.unpack_tuple(builder, index)
            whole = types.intp
            indices = [self.cast(builder, *each, whole) for each in zip(given, axes, strict=True)]
            pointer = tools.get_item_pointer2(
                self, builder, data, shape, strides, kind.layout, indices, wraparound=True
            )
            if not value:
                return items.load_item(self, builder, kind, pointer)
            number = self.cast(builder, value[0], kinds[2], kind.dtype)
            return items.store_item(self, builder, kind, number, pointer)

    class Entry(library):  # type: ignore[misc]
        def _optimize_functions(self, module: Any) -> None:
            if not hasattr(self._codegen, "_pass_builder"):  # before Numba 0.62
                super()._optimize_functions(module)
                return
            module.data_layout = self._codegen._data_layout
            quick = self._codegen._pass_builder(opt=1, loop_vectorize=False, slp_vectorize=False)
            for function in module.functions:
                quick.getFunctionPassManager().run(function, quick)

        def _optimize_final_module(self) -> None:
            for function in self._final_module.functions:
                shared = function.linkage is binding.Linkage.linkonce_odr
                if shared and not function.is_declaration and apart not in function.attributes:
                    function.linkage = "internal"
            super()._optimize_final_module()

    class Linked(Entry):
        codegen = SimpleNamespace(set_env=lambda *_: None)

        def _optimize_final_module(self) -> None:
            pass

        def _finalize_final_module(self) -> None:
            self._finalize_dynamic_globals()
            self._finalized = True

        def get_pointer_to_function(self, _: str) -> int:
            self._ensure_finalized()
            return 0

    class Apart(Linked):
        def add_ir_module(self, module: Any) -> None:
            for function in module.functions:
                if not function.is_declaration:
                    function.attributes.add(apart.decode())
            super().add_ir_module(module)

    @register(mutates_CFG=False, analysis_only=False)
    class Constants(FunctionPass):
        """Makes global numbers constants; Numba would fix a variable's type to that number."""

        _name = "global_numbers"

        def __init__(self) -> None: ...

        def run_pass(self, state: Any) -> bool:
            for block in state.func_ir.blocks.values():
                for each in block.find_insts(ir.Assign):
                    given = each.value
                    if isinstance(given, ir.Global) and isinstance(given.value, int | float):
                        each.value = code.Const(given.value, given.loc)
            return True

    class Compiling(pipeline):  # type: ignore[misc]
        library: type = Entry

        def __init__(self, context: Any, target: Any, *rest: Any) -> None:
            super().__init__(alike(context), target, *rest)
            own = self.state.targetctx.subtarget(typing_context=self.state.typingctx)
            own.__class__ = Target
            self.state.targetctx = own

        def compile_extra(self, function: Any) -> Any:
            target = self.state.targetctx.codegen()
            self.state.library = self.library(target, function.__qualname__)
            self.state.library.enable_object_caching()
            return super().compile_extra(function)

        def define_pipelines(self) -> list[Any]:
            needed = manager("nopython")
            (all_of_them,) = super().define_pipelines()
            needed.passes = [one for one in all_of_them.passes if one[0].name() in _PASSES]
            names = [one[0].name() for one in needed.passes]
            needed.passes.insert(names.index("nopython_type_inference"), (Constants, ""))
            needed.finalize()
            return [needed]

    class Linking(Compiling):
        library = Linked

    class Reordering(Compiling):
        library = Apart

    class Inner(CPUDispatcher):
        constants = False

        def __call__(self, *_: object) -> object:
            name = self.py_func.__name__
            raise TypeError(f"{name} is called by kernels only; got a call from Python")

        def get_call_template(self, args: Any, kws: Any) -> Any:
            if not self.constants:
                args = tuple(map(types.unliteral, args))
            return super().get_call_template(args, kws)

    return SimpleNamespace(
        inner=Inner,
        compiling=Compiling,
        linking=Linking,
        reordering=Reordering,
        compilation=Compilation,
    )


def address_of(compiled: Any, *given: Any) -> int:
    """Return the address of the machine code of an entry for such arguments; compile it if missing.

    The address is 1 where compilation is disabled.
    """
    if not hasattr(compiled, "overloads"):
        return 1
    kinds = tuple(map(compiled.typeof_pyval, given))
    compiled.get_call_template(kinds, {})
    found = compiled.overloads[kinds]
    address: int = found.library.get_pointer_to_function(found.fndesc.llvm_func_name)
    return address


def by_address(function: Callable[..., Any], *numbers: type) -> Any:
    """Return a function of kernels, (address, arguments), that calls an entry by its address.

    Code for rare events is thus compiled when it is first needed, and not with the kernel that
    calls it. `numbers` are the types, int, float or bool, of the numbers that the entry returns.
    """
    import numba

    settings: Any = numba.config
    if settings.DISABLE_JIT:
        return lambda _, given: function(*given)

    from numba.core import cgutils, types

    unpack: Any = cgutils.unpack_tuple
    together: Any = types.Tuple
    kinds = {int: types.intp, float: types.float64, bool: types.boolean}
    found = [kinds[number] for number in numbers]
    returned: Any = together(found) if len(found) > 1 else found[0]

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        given, kinds = signature.args[1].types, tuple(map(types.unliteral, signature.args[1].types))
        unpacked = zip(unpack(builder, values[1]), given, kinds, strict=True)
        cast = [context.cast(builder, *each) for each in unpacked]
        kind = context.call_conv.get_function_type(returned, kinds).as_pointer()
        machine = builder.inttoptr(values[0], kind)
        return context.call_conv.call_function(builder, machine, returned, kinds, cast)[1]

    @numba.extending.intrinsic
    def called(_context: Any, _address: Any, given: Any) -> Any:
        return returned(types.intp, given), code

    return called


def kernel(
    *,
    entry: bool = False,
    reorder: bool = False,
    inline: bool = False,
    constants: bool = False,
    nogil: bool = False,
) -> Callable[[_Function], _Function]:
    """Compile a kernel on its first call and keep the machine code in `cache_folder`.

    With ``NUMBA_DISABLE_JIT=1`` in the environment the function remains plain Python, which is
    about a hundred times slower.

    Parameters
    ----------
    entry
        Python may call the kernel. The wrapper that converts Python's arguments takes a fifth of
        the compilation time.
    reorder
        The compiler may reorder the sums of this function and use fused multiply-add operations.
        The function is not inlined, so that its code is the same in all entries. Never use it for
        double-double arithmetic.
    inline
        The kernel is inlined into its callers.
    constants
        The kernel is compiled for each set of integer constants that is passed to it: inner loops
        that start at a known zero are a fifth faster.
    nogil
        A call from Python releases the interpreter lock. Use it only where no two calls share a
        buffer that they modify.
    """
    import numba
    import numpy as np

    # Numba's reference counting takes longer than the loops over a few terms. Without it kernels
    # cannot allocate arrays: they work in the buffers that are passed to them.
    options: dict[str, Any] = {
        "cache": entry,
        "no_cpython_wrapper": not entry,
        "no_cfunc_wrapper": True,
        "error_model": "numpy",
        "fastmath": REORDERED if reorder else False,
        "forceinline": inline,
        "nogil": nogil,
        "_nrt": False,
    }
    settings: Any = numba.config

    def decorate(function: _Function) -> _Function:
        if settings.DISABLE_JIT:  # arithmetic as in compiled code: division by zero gives infinity
            plain: _Function = np.errstate(all="ignore")(function)
            return plain
        _announced()
        classes = _classes()
        options["pipeline_class"] = (
            classes.compiling if entry else classes.reordering if reorder else classes.linking
        )
        previous = settings.CACHE_DIR
        settings.CACHE_DIR = str(cache_folder())
        try:
            compiled: Any = numba.njit(**options)(function)
        finally:
            settings.CACHE_DIR = previous
        compiled._compiler.__class__ = classes.compilation
        if not entry:
            compiled.__class__ = classes.inner
            compiled.constants = constants
        found: _Function = compiled
        return found

    return decorate
