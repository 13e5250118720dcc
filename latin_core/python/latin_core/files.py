"""What may be opened to be read: files, and nothing that waits, has no end, or does something when it is opened."""

from __future__ import annotations

import os
import stat
from pathlib import Path

__all__ = ["checked_file", "shown"]


def checked_file(path: str | Path | int) -> os.stat_result:
    """The state of a file, by its name (links are followed) or its open descriptor, without opening it.

    Raises
    ------
    OSError
        There is none, or it is a folder, a pipe, a socket, a device, or one that the system makes up when it is
        read (``/proc``, ``/sys``): some of these wait for ever.
    """
    status = os.stat(path)
    if not stat.S_ISREG(status.st_mode):
        raise OSError("it is a folder, a pipe, a socket or a device, not a file")
    # what the system makes up says that it is a file, and lies on no disk
    if not status.st_blocks and not os.statvfs(path).f_blocks:
        raise OSError("it is made up by the system, and no file of a disk")
    return status


def shown(path: str | Path) -> str:
    """A name for messages, in one line and in the order of its characters, whatever is in it."""
    text = str(path)
    return text if text.isprintable() else repr(text)
