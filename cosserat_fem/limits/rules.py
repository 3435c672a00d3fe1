"""How tightly may a cable be bent? Rules of standards, by name.

Rule: each number stands in `bend_rules.toml` with the standard, the clause, the kind of cable, where it was read and
how far that is to be trusted. No rule is chosen for the user: a number without its standard and kind of cable means nothing.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cache
from importlib import resources

from ..errors import nearest

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


@dataclass(frozen=True)
class BendRule:
    """A least inner bend radius in diameters.

    factor : [-] or None if the standard gives no number
    diameter : "cable", or "wire": of the largest insulated wire in it
    clause, applies, source : where it stands, for which cables, where it was read
    status : "data sheet", of the body that makes the rule; "recalled", quoted by others
    """

    name: str
    clause: str
    applies: str
    status: str
    source: str
    factor: float | None = None
    diameter: str = "cable"


@cache
def bend_rules() -> dict[str, BendRule]:
    """All rules by name."""
    text = (resources.files("cosserat_fem.limits") / "bend_rules.toml").read_text(encoding="utf-8")
    return {entry["name"]: BendRule(**entry) for entry in tomllib.loads(text)["rule"]}


def bend_rule(name: str) -> BendRule:
    """A rule by name, in any case of letters. ValueError with the nearest name if there is none, or if it has no number."""
    known = {key.casefold(): rule for key, rule in bend_rules().items()}
    rule = known.get(" ".join(name.split()).casefold())
    if rule is None:
        hint = nearest(name, list(bend_rules()))
        raise ValueError(f"rule: no bend rule is called {name!r}. {hint} `cosserat-fem rules` lists them.")
    if rule.factor is None:
        raise ValueError(
            f"rule: {rule.name} gives no least bend radius (source: {rule.source}). Give a length or diameters."
        )
    return rule
