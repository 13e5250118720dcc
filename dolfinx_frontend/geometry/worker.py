"""The program of the process in which gmsh reads files; :mod:`away` starts it.

This file is run, not imported. It imports the modules of the package that it needs without the package
itself, which would import dolfinx and start MPI, a second time under the number of the same rank.

From its input: one line with the search path of modules, as JSON, then the task and its arguments, pickled.
To its output, pickled: what is done next, then the answer or the error. It ends when its input ends.
"""

from __future__ import annotations

import json
import os
import pickle
import sys
import threading
import traceback
import types
from collections.abc import Callable
from typing import Any


def light_package() -> None:
    """Make the modules of the package importable, but not what the package imports by itself."""
    here = os.path.dirname(os.path.abspath(__file__))
    for name, folder in (("dolfinx_frontend", os.path.dirname(here)), ("dolfinx_frontend.geometry", here)):
        package = types.ModuleType(name)
        package.__path__ = [folder]
        sys.modules[name] = package


def no_core_file() -> None:
    """A crash here is an answer, not something to look into."""
    try:
        import resource
    except ImportError:  # not on all systems
        return
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))


def end_with_input() -> None:
    """End when the process that asked is gone, in whatever way."""
    while os.read(0, 4096):
        pass
    os._exit(1)


def attempt(task: str, arguments: dict[str, Any], send: Callable[..., None]) -> None:
    """Carry out a task; `send` what comes of it."""
    from dolfinx_frontend.common.errors import SceneError
    from dolfinx_frontend.geometry.reading import TASKS

    try:
        answer = TASKS[task](lambda what: send("next", what), **arguments)
    except SceneError as error:
        send("refused", str(error))
    except (NameError, AttributeError, TypeError, ImportError):  # no fault of the file
        send("broken", traceback.format_exc())
    except Exception as error:  # of gmsh, nothing more specific, or of numbers without sense
        kind = "" if type(error) is Exception else f"{type(error).__name__}: "
        send("failed", f"{kind}{error}")
    else:
        send("done", answer)


def main() -> None:
    """The program."""
    no_core_file()
    # libraries print to the output as they like: it becomes the error stream
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    with os.fdopen(os.dup(0), "rb") as questions:
        sys.path[:] = json.loads(questions.readline())
        light_package()
        task, arguments = pickle.load(questions)

    def send(*message: Any) -> None:
        pickle.dump(message, answers)
        answers.flush()

    threading.Thread(target=end_with_input, daemon=True).start()
    attempt(task, arguments, send)
    answers.close()
    os._exit(0)  # nothing is left to tidy up, which a damaged model may not survive


if __name__ == "__main__":
    main()
