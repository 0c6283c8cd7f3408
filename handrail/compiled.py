"""Compiled functions whose cache on disk knows everything that they are made of (robot side only: needs numba).

Numba's own cache looks at the file of a cached function alone. What the function calls in other files, and the constants of other
files that are baked into it, may have changed, and the old machine code goes on: on a new memory layout, anywhere in memory. Here
machine code is filed under a hash of its contents: the bytecode of the function and of all compiled functions, intrinsics and plain
functions that it reaches, the constants that they name, and the options that they are compiled with. Comments, docstrings, line
numbers and files' times don't count.

One file holds one function for one signature. Functions with one qualified name in one module (made by a factory) would throw each
other's files out: give them names of their own.
"""

from __future__ import annotations

import enum
import functools
import hashlib
import pickle
import re
import sys
import uuid
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba
import numpy as np
from numba.core import caching
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps
from numba.core.types import Type
from numba.extending import _Intrinsic

_NUMBERS = frozenset((bool, int, float, complex, str, bytes, type(None)))
"""and texts: what a value is shows in its repr"""
_PLAIN: tuple[Any, ...] = (*_NUMBERS, slice, range, np.generic, np.dtype, Type)
_LIBRARIES = {"numba", "llvmlite", "numpy"}
"""whose functions count by their names: their versions are numba's matter"""
_CHECK = hashlib.sha256().digest_size
_LETTERS = 24
"""of a hash in a file's name"""


def compiled(function: Any = None, /, **options: Any) -> Any:
    """As numba.njit(cache=True, **options), but never runs machine code made from anything but today's sources."""
    if function is None:
        return lambda function: compiled(function, **options)
    dispatcher: Any = numba.njit(**options)(function)
    if dispatcher is not function:  # as it is where NUMBA_DISABLE_JIT is set
        dispatcher._cache = _Cache(dispatcher)
    return dispatcher


def fingerprint(dispatcher: Any) -> str:
    """Hex hash of all that a compiled function's machine code is made from, but for its arguments' types and the processor."""
    digest = hashlib.sha256(repr((numba.__version__, sys.version_info[:2])).encode())
    functions: list[FunctionType] = []
    for part in _parts(dispatcher, functions):
        digest.update(part)
    numbers = {functions[0]: 0}
    for function in functions:  # grows as it goes, each function once: they may call each other in circles
        content, reached = _of_function(function)
        digest.update(content)
        for other in reached:
            if other not in numbers:
                numbers[other] = len(functions)
                functions.append(other)
            digest.update(b"%d " % numbers[other])
    return digest.hexdigest()


@functools.cache
def _of_function(function: FunctionType) -> tuple[bytes, list[FunctionType]]:
    """Hash of what a function says and of the constants that it names, and the functions that it names, in a fixed order."""
    content, names = _of_code(function.__code__, function.__doc__)
    reached: list[FunctionType] = []
    digest = hashlib.sha256(content)
    for part in _parts((function.__defaults__, *sorted((function.__kwdefaults__ or {}).items())), reached):
        digest.update(part + b"\0")
    for part in _named(names, function.__globals__, (), reached):
        digest.update(part + b"\0")
    for cell in function.__closure__ or ():
        for part in _parts(cell.cell_contents, reached):
            digest.update(part + b"\0")
    return digest.digest(), reached


def _named(
    names: frozenset[str], space: dict[str, Any], modules: tuple[ModuleType, ...], reached: list[FunctionType]
) -> Iterator[bytes]:
    """What names stand for. Those of attributes are among them: a name too many costs a compilation at most."""
    for name in sorted(names & space.keys()):
        value = space[name]
        yield name.encode()
        if not isinstance(value, ModuleType):
            yield from _parts(value, reached)
        elif not _of_library(value.__name__) and value not in modules:
            yield from _named(names, vars(value), (*modules, value), reached)


def _parts(value: Any, reached: list[FunctionType]) -> Iterator[bytes]:
    """What machine code depends on in a value that is baked into it; functions are left to `reached`."""
    if type(value) in _NUMBERS or (type(value) is tuple and _NUMBERS.issuperset(map(type, value))):  # most, and quickly
        yield repr(value).encode()
        return
    if isinstance(value, Dispatcher):
        yield from _parts(sorted(value.targetoptions.items()), reached)
        value = value.py_func
    elif isinstance(value, _Intrinsic):
        value = value._defn
    if isinstance(value, FunctionType):
        if not _of_library(value.__module__):
            reached.append(value)
        yield _name(value).encode()
    elif isinstance(value, enum.Enum):  # before numbers and strings, which some are
        yield f"{_name(type(value))}.{value.name}".encode()
        yield from _parts(value.value, reached)
    elif isinstance(value, _PLAIN):
        yield f"{type(value).__name__} {value!r}".encode()
    elif isinstance(value, np.ndarray) and not value.dtype.hasobject:
        yield repr((value.dtype, value.shape, value.flags.c_contiguous, value.flags.f_contiguous)).encode()
        yield value.tobytes()
    elif isinstance(value, tuple | list):
        yield f"{_name(type(value))} of {len(value)} {getattr(value, '_fields', ())}".encode()
        for member in value:
            yield from _parts(member, reached)
    elif isinstance(value, set | frozenset):  # whose order is another one in each process
        yield repr(sorted(map(repr, value))).encode()
    elif isinstance(value, type) and issubclass(value, enum.Enum):
        yield from _parts(list(value), reached)
    elif isinstance(value, type):
        yield f"{_name(value)} {getattr(value, '_fields', ())}".encode()
    else:  # a library's function, or what numba bakes in nowhere: only an attribute elsewhere has the same name
        yield f"{_name(type(value))} {getattr(value, '__name__', '')}".encode()


@functools.cache
def _of_code(code: CodeType, doc: str | None) -> tuple[bytes, frozenset[str]]:
    """Hash of a function's bytecode and constants, with those of the functions within it, and all names that they use."""
    digest = hashlib.sha256(code.co_code + code.co_exceptiontable)
    digest.update(repr((code.co_argcount, code.co_kwonlyargcount, code.co_flags)).encode())
    digest.update(repr((code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)).encode())
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            content, inner = _of_code(constant, None)
            digest.update(content)
            names |= inner
        elif isinstance(constant, frozenset):
            digest.update(repr(sorted(map(repr, constant))).encode())
        else:
            digest.update(b"" if doc is not None and constant is doc else repr(constant).encode())
        digest.update(b"\0")
    return digest.digest(), frozenset(names)


def _of_library(module: str) -> bool:
    return module.partition(".")[0] in _LIBRARIES


def _name(value: Any) -> str:
    return f"{value.__module__}.{value.__qualname__}"


class _Cache(caching._Cache):
    """A dispatcher's files; nothing is looked up before its first compilation."""

    def __init__(self, dispatcher: Any):
        self._dispatcher = dispatcher
        self._enabled = True

    @functools.cached_property
    def _implementation(self) -> Any:
        """Numba's: where files may lie (NUMBA_CACHE_DIR, __pycache__, or the user's folder), and what stands in them."""
        return caching.CompileResultCacheImpl(self._dispatcher.py_func)

    @functools.cached_property
    def _stem(self) -> str:
        function = self._dispatcher.py_func
        name = f"{Path(function.__code__.co_filename).stem}.{function.__qualname__}"
        return f"{re.sub('[^a-zA-Z0-9_.]', '', name)}.{sys.implementation.cache_tag}-"

    @functools.cached_property
    def _content(self) -> str:
        return fingerprint(self._dispatcher)

    @property
    def cache_path(self) -> str:
        return str(self._implementation.locator.get_cache_path())

    def enable(self) -> None:
        self._enabled = True

    def disable(self) -> None:
        self._enabled = False

    def flush(self) -> None:
        """Delete all that is stored of this function."""
        for file in Path(self.cache_path).glob(f"{self._stem}*.nbc"):
            file.unlink(missing_ok=True)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What was compiled for this signature and processor from the same contents, or None."""
        if not self._enabled:
            return None
        target_context.refresh()
        key = (sig, target_context.codegen().magic_tuple())
        try:
            stored = self._file(key).read_bytes()
        except FileNotFoundError:
            return None
        check, body = stored[:_CHECK], stored[_CHECK:]
        if hashlib.sha256(body).digest() != check:  # cut short, as by a power failure
            return None
        stored_key, reduced = pickle.loads(body)  # noqa: S301 (from where Python's own bytecode comes from)
        return self._implementation.rebuild(target_context, reduced) if stored_key == key else None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store what was compiled, and delete what was compiled from former contents."""
        if not self._enabled or not self._implementation.check_cachable(data):
            return
        self._implementation.locator.ensure_cache_path()
        key = (sig, data.codegen.magic_tuple())
        file = self._file(key)
        try:
            body = dumps((key, self._implementation.reduce(data)))
        except RuntimeError:
            return  # a signal's handler that raised while LLVM handed its code over: it runs, but cannot be stored
        whole = Path(f"{file}.{uuid.uuid4().hex[:16]}")  # never half of it under the name that others read
        whole.write_bytes(hashlib.sha256(body).digest() + body)
        whole.replace(file)
        for former in file.parent.glob(f"{self._stem}*.nbc"):
            if not former.name.startswith(f"{self._stem}{self._content[:_LETTERS]}-"):
                former.unlink(missing_ok=True)

    def _file(self, key: object) -> Path:
        kind = hashlib.sha256(repr(key).encode()).hexdigest()
        return Path(self.cache_path) / f"{self._stem}{self._content[:_LETTERS]}-{kind[:_LETTERS]}.nbc"
