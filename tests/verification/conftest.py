"""Published and independently computed problems: references, orders of convergence, and a line for each result."""

import json
import pathlib

import numpy as np
import pytest

import cosserat_fem as cf


@pytest.fixture(scope="session")
def references():
    return json.loads((pathlib.Path(__file__).parent / "references.json").read_text())


@pytest.fixture
def order_of():
    """Observed order of convergence from errors at element counts, by a straight line through the logarithms."""

    def fit(counts, errors):
        return -float(np.polyfit(np.log(counts), np.log(errors), 1)[0])

    return fit


def section(stiffness):
    """Section from (GA1, GA2, EA, EI1, EI2, GJ); "any" stands for a stiffness that plays no part."""
    stiffness = [1.0 if k == "any" else k for k in stiffness]
    return cf.Section(force_stiffness=stiffness[:3], moment_stiffness=stiffness[3:])


@pytest.fixture
def cantilever():
    """Straight cantilever with a tip load, clamped at the origin."""

    def build(
        stiffness, length, *, n_elements, order, force=(0, 0, 0), moment=(0, 0, 0), direction=(1, 0, 0), normal=None
    ):
        tip = length * np.asarray(direction, dtype=float)
        rod = cf.Rod("rod", section(stiffness), [(0, 0, 0), tip], n_elements=n_elements, order=order, normal=normal)
        return cf.Model([rod], [cf.Clamp(rod, "start")], [cf.PointLoad(rod, "end", force=force, moment=moment)])

    return build
