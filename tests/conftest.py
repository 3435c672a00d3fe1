"""Fixtures shared by all tests."""

import pathlib
import sys

import numpy as np
import pytest

sys.path.insert(0, str(pathlib.Path(__file__).parent))  # helpers.py

from validation import (  # noqa: F401
    pytest_addoption,
    pytest_collection_modifyitems,
    pytest_runtest_makereport,
    pytest_sessionfinish,
    validation,
)


@pytest.fixture
def rng():
    return np.random.default_rng(20)
