"""Files that are written whole or not at all, and errors that name them."""

from __future__ import annotations

import contextlib
import io
import os
import stat
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.memory import available_memory

__all__ = ["OBJECTS", "FileError", "Files", "opened", "replaced", "shown", "writable", "write_text"]

OBJECTS = 25.0
"""Memory that is taken for a file whose numbers become objects, in multiples of its size: gmsh takes 24 for a
mesh, Python 22 for the lists of a text."""


class FileError(SceneError):
    """A file that cannot be read or written; the message names it."""


def shown(path: str | Path) -> str:
    """A name for messages, in one line and in the order of its characters, whatever is in it."""
    text = str(path)
    return text if text.isprintable() else repr(text)


def _refused(target: Path, error: BaseException, kind: type[FileError]) -> FileError:
    why = f"{type(error).__name__}: {error}" if not str(error) else error
    return kind(
        f"{shown(target)} cannot be written ({why}): choose a folder that exists, is writable and has room"
    )


def writable(target: Path, kind: type[FileError] = FileError) -> tuple[Path, os.stat_result | None]:
    """Where a file is to be written, behind all links, and what is there now.

    Raises
    ------
    FileError
        A folder, a pipe or a device, or write-protected; of the given kind.
    """
    try:
        real = Path(os.path.realpath(target))
        if real.is_symlink():  # what is left of a chain without an end
            raise OSError("it is a link that leads back to itself")
        before = os.stat(real) if os.path.lexists(real) else None
        if before is not None and stat.S_ISDIR(before.st_mode):
            raise IsADirectoryError("it is a folder")
        if before is not None and not stat.S_ISREG(before.st_mode):  # writing to a pipe may wait for ever
            raise OSError("it is a pipe, a socket or a device, not a file")
        if before is not None and not os.access(real, os.W_OK):
            raise PermissionError("it is write-protected")
    except (OSError, UnicodeError) as error:
        raise _refused(target, error, kind) from error
    return real, before


@contextmanager
def replaced(target: Path, kind: type[FileError] = FileError) -> Iterator[Path]:
    """A new file beside the target, which takes its place when the context ends without an error.

    All or nothing: an existing file stays until the new one is complete on the disk. The new one has
    its permissions; a link stays a link, to the new file. It is there, empty, under a random name that
    nothing had before: nobody can have put a link in its place.

    Raises
    ------
    FileError
        It cannot be written, or is a folder, a pipe or a device; of the given kind.
    """
    real, before = writable(target, kind)
    temporary = real.with_name(f".{uuid.uuid4().hex}{real.suffix}")
    try:
        temporary.open("xb").close()
    except (OSError, UnicodeError) as error:
        raise _refused(target, error, kind) from error
    try:
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        if before is not None:
            with contextlib.suppress(OSError):  # another user's file: the group may be another one
                os.chown(temporary, before.st_uid, before.st_gid)
            os.chmod(temporary, stat.S_IMODE(before.st_mode))
        temporary.replace(real)
    except (OSError, UnicodeError) as error:
        raise _refused(target, error, kind) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_text(target: Path, text: str) -> None:
    """Write a text in UTF-8, whole or not at all.

    Raises
    ------
    FileError
        It cannot be written.
    """
    with replaced(target) as temporary:
        temporary.write_text(text, encoding="utf-8")


class Files(ExitStack):
    """Files that take the places of older ones together, the first last: a failure leaves all of those."""

    def write(self, target: Path, text: str) -> None:
        """Write a text in UTF-8 to a file beside its place."""
        self.enter_context(replaced(target)).write_text(text, encoding="utf-8")

    def folder(self, folder: Path) -> Path:
        """A folder, made with those above it if it is not there; after a failure those are gone again.

        Raises
        ------
        FileError
            It cannot be made.
        """
        made = [each for each in (folder, *folder.parents) if not os.path.lexists(each)]

        def undo(kind: type[BaseException] | None, *_: object) -> None:
            if kind is not None:
                with contextlib.suppress(OSError):  # somebody has put something into it
                    for each in made:
                        each.rmdir()

        self.push(undo)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (OSError, UnicodeError) as error:
            text = f"the folder {shown(folder)} cannot be made ({error}): choose one that is writable"
            raise FileError(text) from error
        return folder


def _checked(path: Path | int) -> os.stat_result:
    """The state of a file, by its name (links are followed) or its open descriptor.

    Raises
    ------
    OSError
        There is none, or it is a folder, a pipe, a device, or one that the system makes up when it is read
        (``/proc``, ``/sys``): some of these wait for ever.
    """
    status = os.stat(path)
    if not stat.S_ISREG(status.st_mode):
        raise OSError("it is a folder, a pipe, a socket or a device, not a file")
    # what the system makes up says that it is a file, and lies on no disk
    if not status.st_blocks and not os.statvfs(path).f_blocks:
        raise OSError("it is made up by the system, and no file of a disk")
    return status


def opened(path: Path, memory: float, kind: type[SceneError] = FileError) -> io.BufferedReader:
    """A file to be read: what every reader of this package begins with.

    Parameters
    ----------
    memory
        That reading it may take, in multiples of its size.
    kind
        Of the errors.

    Raises
    ------
    SceneError
        It cannot be read; is no file (a pipe or a device may have no end); is too large for the memory that
        is free.
    """
    name = shown(path)
    try:
        _checked(path)  # before it is opened, which a device may take for a request
        file = os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb")
        size = _checked(file.fileno()).st_size  # another one may have taken its place
    except (FileNotFoundError, NotADirectoryError, ValueError) as error:
        raise kind(f"{name} does not exist: check the name") from error
    except OSError as error:
        raise kind(f"{name} cannot be read ({error.strerror or error}): give the name of a file") from error
    free = available_memory()
    if memory * size > free:
        file.close()
        raise kind(
            f"{name} has {size / 1e9:.3g} GB, more than the {free / memory / 1e9:.3g} GB that can be read "
            f"here: it may take {memory:g} times as much memory, and {free / 1e9:.3g} GB are free; check "
            "that it is the right file, and read it where more memory is free"
        )
    return file
