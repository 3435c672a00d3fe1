"""What does accuracy cost? Published problems, solved at many resolutions: error against CPU time.

Rule: a study. It uses the solvers as a user would, and no room below knows of it. `problems` says what is asked and what is
right, `models` how it is solved here, `measure` what it costs, `scaling` how that grows, `plots` how it looks, `command`
what is printed and written. Nothing is imported here, so that threads can be limited before numpy is loaded.
"""

import os

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def one_thread() -> None:
    """Let numerical libraries that are loaded from now on, here and in processes started from here, use one thread."""
    os.environ.update(dict.fromkeys(THREADS, "1"))
