"""What tells a function of a user from another of the same name: its code and all that it refers to."""

from __future__ import annotations

import builtins
import copyreg
import dis
import functools
import hashlib
import importlib.util
import sys
import types
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import ReadOnlyDict

__all__ = ["Reader", "code_digest"]

OURS = ("dolfinx_frontend", "latin_core")
_PLAIN = (bool, int, float, complex, str, bytes, type(None), type(Ellipsis), type(NotImplemented))
_FOUND = (types.BuiltinFunctionType, types.MethodDescriptorType, types.WrapperDescriptorType, np.ufunc)

_NO_CODE = {"__dict__", "__weakref__", "__doc__", "__module__", "__firstlineno__", "__static_attributes__"}
_NO_CODE |= {"__annotations__", "__annotate__", "__annotate_func__", "__annotations_cache__"}

Known = Mapping[type, Callable[[Any], str]]


def code_digest(value: Any, what: str, known: Known | None = None) -> str:
    """Digest of a function or another object by value: bytecode, constants, defaults, closure, globals used.

    Functions of libraries count by their name, version and file; those of a user's own modules by their code.

    Parameters
    ----------
    what
        Name of the object for messages.
    known
        Type -> how an object of it (or of a type derived from it) is told apart.

    Raises
    ------
    SceneError
        It refers to something that cannot be told apart from another one of its kind.
    """
    reader = Reader(known or {})
    reader.feed(value, what)
    return reader.digest.hexdigest()


@functools.cache
def _file_digest(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def _library(name: str | None) -> str | None:
    """Name, version and file of a module that is no module of the user; None: it is."""
    module = sys.modules.get(name or "")
    if name is None or name == "__main__" or module is None:
        return None
    top = name.partition(".")[0]
    if top in sys.stdlib_module_names:
        return f"python {sys.version_info[:2]} {name}"
    version = getattr(sys.modules.get(top), "__version__", "")
    if top in OURS:
        return f"{name} {version}"
    file = getattr(module, "__file__", None)
    if file is None or not {"site-packages", "dist-packages"} & set(Path(file).parts):
        return None
    return f"{name} {version} {_file_digest(file)}"


class Reader:
    """Feeds values to a digest; what was seen before counts by its number, so that circles end."""

    def __init__(self, known: Known) -> None:
        self.digest = hashlib.sha256()
        self.known = known
        self.seen: dict[int, int] = {}
        self.kept: list[Any] = []

    def say(self, *words: object) -> None:
        for word in words:
            data = word if isinstance(word, bytes) else str(word).encode("utf-8", "surrogatepass")
            self.digest.update(b"%d:" % len(data) + data)

    def number(self, value: Any) -> None:
        """Give a value the number that it counts by when it is met again."""
        self.seen[id(value)] = len(self.seen)
        self.kept.append(value)  # so that its id stays its own

    def feed(self, value: Any, where: str) -> None:
        """Add a value; `where` says for messages how it was reached."""
        if isinstance(value, _PLAIN):
            self.say(type(value).__name__, repr(value))
            return
        if id(value) in self.seen:
            self.say("seen", self.seen[id(value)])
            return
        self.number(value)
        for kind, tell in self.known.items():
            if isinstance(value, kind):
                self.say("known", kind.__name__, tell(value))
                return
        if type(value) in _BY_TYPE:
            _BY_TYPE[type(value)](self, value, where)
        elif isinstance(value, _FOUND):
            self._found(value, where)
        elif isinstance(value, type):
            self._class(value, where)
        else:
            self._instance(value, where)

    # --- containers and arrays ---
    def _sequence(self, value: Any, where: str) -> None:
        self.say(type(value).__name__, len(value))
        for each in value:
            self.feed(each, where)

    def _set(self, value: Any, where: str) -> None:
        self.say("set", len(value), *sorted(self.alone(each, where) for each in value))

    def alone(self, value: Any, where: str) -> str:
        """Digest of a value by itself."""
        other = type(self)(self.known)
        other.feed(value, where)
        return other.digest.hexdigest()

    def _mapping(self, value: Mapping[Any, Any], where: str) -> None:
        self.say("dict", len(value))
        for key, each in value.items():
            self.feed(key, where)
            self.feed(each, where)

    def _array(self, value: Any, where: str) -> None:
        if value.dtype.hasobject:
            self.say("objects", value.shape)
            self.feed(value.tolist(), where)
        else:
            self.say("array", value.dtype.str, value.shape, np.ascontiguousarray(value).tobytes())

    # --- code ---
    def _function(self, value: types.FunctionType, where: str) -> None:
        library = _library(value.__module__)
        if library is not None and "<locals>" not in value.__qualname__:
            self.say("library", library, value.__qualname__)
            return
        self.say("function")
        self._code(value.__code__, value.__doc__, where)
        self.feed(value.__defaults__, f"{where}, its defaults")
        self.feed(value.__kwdefaults__, f"{where}, its defaults")
        for name, cell in zip(value.__code__.co_freevars, value.__closure__ or (), strict=True):
            try:
                content = cell.cell_contents
            except ValueError:  # not set yet
                self.say("empty")
            else:
                self.feed(content, f"{where}, its variable {name!r}")
        if value.__dict__:  # attributes of the function
            self.feed(dict(sorted(value.__dict__.items())), f"{where}, its attributes")
        self._globals(value.__code__, value.__globals__, where)

    def _code(self, code: types.CodeType, doc: str | None, where: str) -> None:
        """A code without its place; the flags that count are those below the compiler's own."""
        self.say("code", code.co_code, code.co_flags & 0x3FF)
        self.say(code.co_names, code.co_varnames, code.co_freevars)
        self.say(code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount)
        self.say(getattr(code, "co_exceptiontable", b""))
        for each in code.co_consts:
            if isinstance(each, types.CodeType):
                self._code(each, None, where)
            elif not (isinstance(each, str) and each == doc):
                self.feed(each, where)

    def _globals(self, code: types.CodeType, names: Mapping[str, Any], where: str) -> None:
        """The globals that a code uses; of a user's module what is taken from it."""
        steps = [each for each in dis.get_instructions(code) if each.opname not in ("CACHE", "EXTENDED_ARG")]
        for number, step in enumerate(steps):
            if step.opname == "IMPORT_NAME":
                self._import(str(step.argval), where)
            if step.opname not in ("LOAD_GLOBAL", "LOAD_NAME"):
                continue
            name = str(step.argval)
            if name not in names:
                self.say("builtin" if hasattr(builtins, name) else "missing", name)
                continue
            value, path = names[name], name
            while isinstance(value, types.ModuleType) and _library(value.__name__) is None:
                number += 1
                after = steps[number] if number < len(steps) else None
                if after is None or after.opname not in ("LOAD_ATTR", "LOAD_METHOD"):
                    break
                path = f"{path}.{after.argval}"
                if not hasattr(value, str(after.argval)):
                    break
                value = getattr(value, str(after.argval))
            self.say("global", path)
            self.feed(value, f"{where}, its global {path!r}")
        for each in code.co_consts:
            if isinstance(each, types.CodeType):
                self._globals(each, names, where)

    def _method(self, value: types.MethodType, where: str) -> None:
        self.feed(value.__func__, where)
        self.feed(value.__self__, f"{where}, its object")

    def _partial(self, value: functools.partial[Any], where: str) -> None:
        self.say("partial")
        self.feed(value.func, where)
        self.feed(value.args, f"{where}, its arguments")
        self.feed(value.keywords, f"{where}, its arguments")

    def _module(self, value: types.ModuleType, where: str) -> None:
        library, file = _library(value.__name__), getattr(value, "__file__", None)
        if library is None and file is None:
            raise self._refused(value, where)
        self.say("module", library or _file_digest(str(file)))

    def _import(self, name: str, where: str) -> None:
        """A module that is imported while a function runs: by its file, not by what was written to it."""
        module = sys.modules.get(name)
        if module is not None:
            self._module(module, f"{where}, which imports {name!r}")
            return
        try:
            found = importlib.util.find_spec(name)
        except (ImportError, ValueError):
            found = None
        origin = None if found is None else found.origin
        self.say("import", name, _file_digest(origin) if origin and Path(origin).is_file() else "")

    def _found(self, value: Any, where: str) -> None:
        """A compiled function: by its name, and the file of its module."""
        owner = getattr(value, "__self__", None)
        if owner is not None and not isinstance(owner, (types.ModuleType, type)):
            self.feed(owner, f"{where}, its object")  # a method of an object
        home = getattr(value, "__module__", None) or getattr(owner, "__name__", None)
        name = getattr(value, "__qualname__", None) or getattr(value, "__name__", "")
        if isinstance(home, str) and home in sys.modules:
            self._module(sys.modules[home], where)
        self.say("compiled", home, name)

    def _capsule(self, value: Any, where: str) -> None:
        """An object of a compiled module: by its name there, and the module's file."""
        for module in list(sys.modules.values()):
            file = getattr(module, "__file__", None)
            for name, each in list(vars(module).items()) if file else ():
                if each is value:
                    self.say("capsule", name, _file_digest(str(file)))
                    return
        raise self._refused(value, where)

    # --- classes and objects ---
    def _class(self, value: type, where: str) -> None:
        library = _library(value.__module__)
        if library is not None and "<locals>" not in value.__qualname__:
            self.say("library", library, value.__qualname__)
            return
        self.say("class", value.__qualname__)
        self.feed(value.__bases__, where)
        for name, each in sorted(vars(value).items()):
            if name in _NO_CODE or name.startswith(("__abstract", "_abc_")):
                continue
            self.say(name)
            for part in self._parts(each):
                self.feed(part, f"{where}, {value.__name__}.{name}")

    @staticmethod
    def _parts(member: Any) -> tuple[Any, ...]:
        """What a member of a class is made of."""
        if isinstance(member, (staticmethod, classmethod)):
            return (member.__func__,)
        if isinstance(member, property):
            return (member.fget, member.fset)
        if isinstance(member, functools.cached_property):
            return (member.func,)
        if isinstance(member, (types.MemberDescriptorType, types.GetSetDescriptorType)):
            return ()
        return (member,)

    def _instance(self, value: Any, where: str) -> None:
        """Any other object: its class, and what it would be copied from."""
        inner = getattr(value, "py_func", None)  # a function compiled by numba
        if isinstance(inner, types.FunctionType):
            self.feed(inner, where)
            return
        if type(value).__name__ == "PyCapsule":
            self._capsule(value, where)
            return
        try:
            recipe = (
                copyreg.dispatch_table[type(value)](value)
                if type(value) in copyreg.dispatch_table
                else value.__reduce_ex__(4)
            )
        except Exception as error:
            raise self._refused(value, where) from error
        self.feed(type(value), where)
        wrapped = getattr(value, "__wrapped__", None)  # a function with a cache, say
        if wrapped is not None:
            self.feed(wrapped, where)
        if isinstance(recipe, str):
            if wrapped is None and _library(getattr(value, "__module__", None)) is None:
                raise self._refused(value, where)
            self.say("named", recipe)
            return
        call, arguments, *rest = recipe
        if call is not copyreg.__newobj__:  # type: ignore[attr-defined]
            self.feed(call, where)
        self.feed(arguments, where)
        for each in rest[:1]:
            self.feed(each, where)
        for each in rest[1:3]:  # items of a list or a dict
            self.feed(None if each is None else list(each), where)

    @staticmethod
    def _refused(value: Any, where: str) -> SceneError:
        return SceneError(
            f"{where}: a {type(value).__name__} cannot be told apart from another one, so a checkpoint could "
            "bring back numbers of another run: give functions that use only numbers, arrays and functions, "
            "or do without the checkpoint"
        )


_BY_TYPE: dict[type, Callable[[Reader, Any, str], None]] = {
    tuple: Reader._sequence,
    list: Reader._sequence,
    set: Reader._set,
    frozenset: Reader._set,
    dict: Reader._mapping,
    ReadOnlyDict: Reader._mapping,
    types.MappingProxyType: Reader._mapping,
    np.ndarray: Reader._array,
    types.FunctionType: Reader._function,
    types.MethodType: Reader._method,
    types.ModuleType: Reader._module,
    functools.partial: Reader._partial,
}
