"""Exit statuses of the commands of this paper; an error is one line on standard error."""

import sys
from collections.abc import Callable

from rvaft.cli import FAILED, Stopped, guarded
from rvaft.errors import RvaftError


def ended(name: str, run: Callable[[], int | None]) -> int:
    """Return the exit status: that of `run` (0 for None), 2 on an error, 141 on a closed pipe, 130
    on an interrupt.
    """
    try:
        with guarded():
            return run() or 0
    except Stopped as stopped:
        return stopped.status
    except RvaftError as error:
        message = str(error)
    except OSError as error:
        message = f"{error.filename}: {error.strerror}"
    sys.stderr.write(f"{name}: error: {message}\n")
    return FAILED
