"""Files that are written whole or not at all, and errors that name them."""

from __future__ import annotations

import contextlib
import io
import os
import stat
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dolfinx_frontend.common.errors import SceneError

__all__ = ["FileError", "is_file", "made_folder", "opened", "replaced", "write_text"]


class FileError(SceneError):
    """A file that cannot be read or written; the message names it."""


def _refused(target: Path, error: BaseException, kind: type[FileError]) -> FileError:
    why = f"{type(error).__name__}: {error}" if not str(error) else error
    return kind(
        f"{target} cannot be written ({why}): choose a folder that exists, is writable and has room"
    )


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
    try:
        real = Path(os.path.realpath(target))
        temporary = real.with_name(f".{uuid.uuid4().hex}{real.suffix}")
        if real.is_symlink():  # what is left of a chain without an end
            raise OSError("it is a link that leads back to itself")
        before = os.stat(real) if os.path.lexists(real) else None
        if before is not None and stat.S_ISDIR(before.st_mode):
            raise IsADirectoryError("it is a folder")
        if before is not None and not stat.S_ISREG(before.st_mode):  # writing to a pipe may wait for ever
            raise OSError("it is a pipe, a socket or a device, not a file")
        if before is not None and not os.access(real, os.W_OK):
            raise PermissionError("it is write-protected")
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


def made_folder(folder: Path) -> Path:
    """A folder, made with those above it if it is not there.

    Raises
    ------
    FileError
        It cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, UnicodeError) as error:
        text = f"the folder {folder} cannot be made ({error}): choose one that is writable"
        raise FileError(text) from error
    return folder


def opened(path: Path) -> io.BufferedReader:
    """A file to be read.

    Raises
    ------
    OSError
        It cannot be read, or is no file: a pipe or a device may have no end.
    """
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    file = os.fdopen(number, "rb")
    if not stat.S_ISREG(os.fstat(number).st_mode):
        file.close()
        raise OSError("it is a pipe, a socket or a device, not a file")
    return file


def is_file(path: Path) -> bool:
    """Whether there is a file of that name; a name that cannot be one has none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
