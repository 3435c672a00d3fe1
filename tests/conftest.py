"""Fixtures shared by all tests, what they say, and how many processes run them."""

import os
import pathlib
import sys

# Small systems side by side: threads of BLAS would wait for each other (a dense eigenproblem then takes ten times as long).
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pytest

sys.path.insert(0, str(pathlib.Path(__file__).parent))  # helpers.py

from validation import (  # noqa: F401
    Page,
    pytest_addoption,
    pytest_collection_modifyitems,
    pytest_runtest_makereport,
    validation,
)

SAID = "said"


@pytest.fixture
def rng():
    return np.random.default_rng(20)


@pytest.fixture
def say(request):
    """Print one line for a result, visible with and without -s, from whichever process."""
    return lambda text: request.node.user_properties.append((SAID, f"{request.node.name}: {text}"))


class Lines:
    """Prints what tests said, each in one piece."""

    def __init__(self, terminal):
        self.terminal = terminal

    @pytest.hookimpl(trylast=True)
    def pytest_runtest_logreport(self, report):
        said = [text for name, text in report.user_properties if name == SAID]
        if report.when == "call" and said:
            self.terminal.write("".join(f"\n  {text}" for text in said))


@pytest.hookimpl(trylast=True)
def pytest_configure(config):
    """Only the process that sees every report tells of them."""
    if hasattr(config, "workerinput"):
        return
    config.pluginmanager.register(Lines(config.pluginmanager.get_plugin("terminalreporter")))
    if config.getoption("--write-validation"):
        config.pluginmanager.register(Page())


def pytest_xdist_auto_num_workers(config):
    """The whole suite on all processors, at most four: each compiles and takes 1 GB.

    One process for files named by hand, and for VALIDATION.md, which tells the time of each test.
    """
    if config.args_source is not pytest.Config.ArgsSource.TESTPATHS or config.getoption("--write-validation"):
        return 0
    return min(4, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
