"""How the commands of this paper end: what cannot be done is one line on standard error, and a
reader that has enough is no error.
"""

import sys
from collections.abc import Callable

from rvaft.cli import FAILED, Stopped, guarded
from rvaft.errors import RvaftError


def ended(name: str, run: Callable[[], int | None]) -> int:
    """The exit status: that of the run, 0 where it has none, or 2 where it cannot be done, 141
    where nobody reads on, 130 where it was interrupted.
    """
    try:
        with guarded():
            return run() or 0
    except Stopped as stopped:
        return stopped.status
    except RvaftError as error:
        said = str(error)
    except OSError as error:
        said = f"{error.filename}: {error.strerror}"
    sys.stderr.write(f"{name}: error: {said}\n")
    return FAILED
