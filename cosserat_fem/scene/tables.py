"""What may a scene file say? One pydantic model for each table; also the source of the JSON schema.

Rule: keys are the keyword names of the Python classes. Here is only shape: types, units, unknown keys. Whether a value
makes sense is said by the class it goes to, and names are looked up in `build.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, Strict, WithJsonSchema

from .units import KINDS, measured, parse


def quantity(kind: str) -> Any:
    """A number in SI or a string with a unit of this kind."""
    schema = {
        "type": ["number", "string"],
        "description": f'{kind}; a number is SI, or a string like "{KINDS[kind][1]}"',
    }
    return Annotated[float, BeforeValidator(lambda value: parse(value, kind)), WithJsonSchema(schema)]


def vector(kind: str) -> Any:
    """Three quantities."""
    q = quantity(kind)
    return tuple[q, q, q]


def _numbers(value: Any, kind: str, n: int) -> list[Any]:
    """A list of quantities, or of lists of n quantities."""
    if not isinstance(value, list):
        raise ValueError("must be a list")
    if n == 1:
        return [parse(x, kind) for x in value]
    for row in value:
        if not isinstance(row, list) or len(row) != n:
            raise ValueError(f"must be a list of lists of {n} values")
    return [[parse(x, kind) for x in row] for row in value]


def over_time(kind: str, n: int, rate: str | None = None) -> Any:
    """A constant of n components (or, with `rate`, a rate), or [[times], [values]]."""

    def read(value: Any) -> Any:
        if isinstance(value, list) and len(value) == 2 and isinstance(value[0], list):
            times, values = _numbers(value[0], "time", 1), _numbers(value[1], kind, n)
            if len(times) != len(values):
                raise ValueError(f"has {len(times)} times but {len(values)} values")
            return times, values
        if n == 1:
            return parse(value, rate or kind)
        if not isinstance(value, list) or len(value) != n:
            raise ValueError(f"must be a list of {n} values, or [[times], [values]]")
        return [parse(x, kind) for x in value]

    constant = f'"{KINDS[rate or kind][1]}"' if n == 1 else f"{n} values"
    schema = {"description": f"{rate or kind}: {constant} or [[times], [values]]"}
    return Annotated[Any, BeforeValidator(read), WithJsonSchema(schema)]


def custom(read: Callable[[Any], Any], description: str) -> Any:
    """A value with its own reader."""
    return Annotated[Any, BeforeValidator(read), WithJsonSchema({"description": description})]


def one_or_more(table: Any) -> Any:
    """A table or a list of tables, read as a list."""
    return Annotated[list[table], BeforeValidator(lambda value: [value] if isinstance(value, dict) else value)]


def limits_of(table: Any) -> Any:
    """A limit, a table or a list of tables, read as a list of tables."""

    def read(value: Any) -> Any:
        if isinstance(value, dict):
            return [value]
        return value if isinstance(value, list) else [{"limit": value}]

    return Annotated[list[table], BeforeValidator(read), _OrShorter()]


class _OrShorter:
    """In the JSON schema: a list of tables may also be one of them, or the limit alone."""

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: Callable[[Any], Any]) -> Any:
        several = handler(core_schema)
        return {"anyOf": [{"type": ["number", "string"]}, several["items"], several]}


def _section(value: Any) -> Any:
    if isinstance(value, str):
        return value
    if isinstance(value, list) and value and all(isinstance(e, list) and len(e) == 2 for e in value):
        if not all(isinstance(e[1], str) for e in value):
            raise ValueError("must name a section in each entry [s, name]")
        return [(parse(e[0], "length"), e[1]) for e in value]
    raise ValueError("must be the name of a section, or a list of [s, name]")


def _rest(value: Any) -> Any:
    if value in ("straight", "as_drawn"):
        return value
    if isinstance(value, str):
        raise ValueError("must be 'straight', 'as_drawn' or numbers (bend 1, bend 2, twist)")
    if isinstance(value, list) and value and isinstance(value[0], list):
        return _numbers(value, "curvature", 3)
    if isinstance(value, list) and len(value) == 3:
        return [parse(x, "curvature") for x in value]
    raise ValueError("must be 'straight', 'as_drawn', three numbers or a list of three numbers each")


def _place(value: Any) -> Any:
    if value in ("start", "end"):
        return value
    if isinstance(value, str) and not any(c.isdigit() for c in value):
        raise ValueError("must be 'start', 'end' or an arc length like \"20 mm\"")
    return parse(value, "length")


def _unit(value: Any) -> float:
    unit = parse(f"1 {value}", "length") if isinstance(value, str) and value.isalpha() else parse(value, "length")
    if unit <= 0:
        raise ValueError("must be greater than 0")
    return unit


def _until(value: Any) -> Any:
    return value if value == "critical" else parse(value, "time")


def _over_angle(value: Any) -> Any:
    if not isinstance(value, list):
        return parse(value, "moment")
    if len(value) != 2 or not all(isinstance(entries, list) for entries in value):
        raise ValueError("must be a moment or [[angles], [moments]]")
    angles, moments = _numbers(value[0], "angle", 1), _numbers(value[1], "moment", 1)
    if len(angles) != len(moments):
        raise ValueError(f"has {len(angles)} angles but {len(moments)} moments")
    return angles, moments


def _resolution(value: Any) -> Any:
    return value if value is None or value is False else parse(value, "angle")


def _profile(value: Any) -> Any:
    if not isinstance(value, list) or len(value) != 2 or not all(isinstance(entries, list) for entries in value):
        raise ValueError("must be [[places], [factors]]")
    places, factors = [_place(place) for place in value[0]], _numbers(value[1], "number", 1)
    if len(places) != len(factors):
        raise ValueError(f"has {len(places)} places but {len(factors)} factors")
    if len(places) < 2:
        raise ValueError(f"needs at least two places, the rod's start and end (got {len(places)})")
    return places, factors


Place = custom(_place, "'start', 'end' or an arc length")
Unit = custom(_unit, "length of one unit: 'mm', 'm', '25 mm'")
Name = Annotated[str, Field(min_length=1)]
Direction = vector("number")
Integer = Annotated[int, Strict()]
Flag = Annotated[bool, Strict()]


class Table(BaseModel):
    """A table of the scene file; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", strict=False, frozen=True)


class RoundSection(Table):
    """A solid round section of one material."""

    kind: Literal["round"]
    name: Name
    diameter: quantity("length")
    youngs_modulus: quantity("pressure")
    shear_modulus: quantity("pressure") | None = None
    poisson_ratio: quantity("number") | None = None
    density: quantity("density") = 0.0
    shear_factor: quantity("number") = 0.9


class RectangleSection(Table):
    """A solid rectangle, width along d1, height along d2."""

    kind: Literal["rectangle"]
    name: Name
    width: quantity("length")
    height: quantity("length")
    youngs_modulus: quantity("pressure")
    shear_modulus: quantity("pressure") | None = None
    poisson_ratio: quantity("number") | None = None
    density: quantity("density") = 0.0
    shear_factor: quantity("number") = 5 / 6


class GeneralSection(Table):
    """Six stiffnesses, or a coupled 6x6 matrix in SI."""

    kind: Literal["general"]
    name: Name
    force_stiffness: vector("force") | None = None
    moment_stiffness: vector("bending stiffness") | None = None
    coupled: list[list[quantity("number")]] | None = None
    mass_per_length: quantity("mass per length") = 0.0
    rotary_inertia: vector("inertia per length") = (0.0, 0.0, 0.0)
    radius: quantity("length") | None = None
    outline: tuple[quantity("length"), quantity("length")] | None = None


class StrandsTable(Table):
    """Round wires, packed or in a ring around what is inside."""

    kind: Literal["strands"]
    count: Integer
    diameter: quantity("length")
    lay: quantity("length") | None = None
    material: str | None = None
    youngs_modulus: quantity("pressure") | None = None
    shear_modulus: quantity("pressure") | None = None
    density: quantity("density") | None = None


class CablesTable(Table):
    """Cables of the catalogue or of sections before this one, packed or in a ring around what is inside."""

    kind: Literal["cables"]
    count: Integer
    cable: Name
    lay: quantity("length") | None = None


class TubeTable(Table):
    """Insulation, jacket or filler."""

    kind: Literal["tube"]
    diameter: quantity("length") | None = None
    thickness: quantity("length") | None = None
    material: str | None = None
    youngs_modulus: quantity("pressure") | None = None
    shear_modulus: quantity("pressure") | None = None
    density: quantity("density") | None = None


class BraidTable(Table):
    """A shield or sleeve of crossing wires."""

    kind: Literal["braid"]
    wires: Integer
    diameter: quantity("length")
    angle: quantity("angle")
    material: str | None = None
    youngs_modulus: quantity("pressure") | None = None
    shear_modulus: quantity("pressure") | None = None
    density: quantity("density") | None = None


class TapeTable(Table):
    """A wrap of tape."""

    kind: Literal["tape"]
    thickness: quantity("length")
    overlap: quantity("number") = 0.0
    material: str | None = None
    youngs_modulus: quantity("pressure") | None = None
    shear_modulus: quantity("pressure") | None = None
    density: quantity("density") | None = None


LayerTable = Annotated[StrandsTable | CablesTable | TubeTable | BraidTable | TapeTable, Field(discriminator="kind")]


class BuiltSection(Table):
    """A cable of layers: its bending and twist stiffness is a band from slipping to sticking strands."""

    kind: Literal["built"]
    name: Name
    layers: Annotated[list[LayerTable], Field(min_length=1)]
    diameter: quantity("length") | None = None
    mass_per_length: quantity("mass per length") | None = None
    bending_stiffness: tuple[quantity("bending stiffness"), quantity("bending stiffness")] | None = None


class RodTable(Table):
    """A cable: a drawn curve (points or file) with a section."""

    name: Name
    section: custom(_section, "name of a section or of a cable of the catalogue, or a list of [s, name]")
    strands: Literal["slip", "stick", "band"] | None = None
    points: list[tuple[quantity("length"), quantity("length"), quantity("length")]] | None = None
    file: str | None = None
    unit: Unit = 1.0
    n_elements: Integer = 20
    order: Integer = 3
    length: quantity("length") | None = None
    rest: custom(_rest, "'straight', 'as_drawn' or curvatures (bend 1, bend 2, twist)") = "straight"
    start_tangent: Direction | None = None
    end_tangent: Direction | None = None
    normal: Direction | None = None
    end_normal: Direction | None = None
    layer: quantity("length") | None = None


class HingeTable(Table):
    """Turning about a fixed axis."""

    kind: Literal["hinge"]
    point: vector("length") = (0.0, 0.0, 0.0)
    axis: Direction
    angle: over_time("angle", 1, rate="angular rate")
    smooth: Flag = False


class SliderTable(Table):
    """Sliding along a direction."""

    kind: Literal["slider"]
    axis: Direction
    travel: over_time("length", 1, rate="speed")
    smooth: Flag = False


class PathTable(Table):
    """A rigid motion from a CSV file: time, x, y, z, qw, qx, qy, qz."""

    kind: Literal["path"]
    file: str
    smooth: Flag = False


class PlaneTable(Table):
    """A half space, free where the normal points."""

    kind: Literal["plane"]
    point: vector("length")
    normal: Direction


class SphereTable(Table):
    """A ball."""

    kind: Literal["sphere"]
    center: vector("length")
    radius: quantity("length")


class CylinderTable(Table):
    """A solid cylinder with flat ends."""

    kind: Literal["cylinder"]
    start: vector("length")
    end: vector("length")
    radius: quantity("length")


class CapsuleTable(Table):
    """A solid cylinder with round ends."""

    kind: Literal["capsule"]
    start: vector("length")
    end: vector("length")
    radius: quantity("length")


class BoxTable(Table):
    """A solid box."""

    kind: Literal["box"]
    center: vector("length")
    edges: vector("length")
    axes: tuple[Direction, Direction, Direction] | None = None


class TorusTable(Table):
    """A ring of round section."""

    kind: Literal["torus"]
    center: vector("length")
    axis: Direction
    radius: quantity("length")
    tube: quantity("length")


ShapeTable = Annotated[
    PlaneTable | SphereTable | CylinderTable | CapsuleTable | BoxTable | TorusTable, Field(discriminator="kind")
]


class PartTable(Table):
    """A rigid body."""

    name: Name
    mesh: str | None = None
    mesh_unit: Unit = 1.0
    shape: one_or_more(ShapeTable) | None = None
    motion: Annotated[HingeTable | SliderTable | PathTable, Field(discriminator="kind")] | None = None


class ClampTable(Table):
    """Place and attitude of a section held."""

    kind: Literal["clamp"]
    rod: Name
    at: Place
    to: str = "ground"
    free: list[str] = []
    frame: list[list[quantity("number")]] | None = None
    name: str | None = None


class PinTable(ClampTable):
    """Place of a section held; keys as for a clamp."""

    kind: Literal["pin"]  # type: ignore[assignment]


class WeldTable(Table):
    """Two rods joined rigidly."""

    kind: Literal["weld"]
    rod: Name
    at: Place
    other: Name
    other_at: Place


class GravityTable(Table):
    """Weight of all rods."""

    acceleration: vector("acceleration")


class PointLoadTable(Table):
    """Force and moment at one place."""

    kind: Literal["point"]
    rod: Name
    at: Place
    force: over_time("force", 3) = [0.0, 0.0, 0.0]
    moment: over_time("moment", 3) = [0.0, 0.0, 0.0]
    follower: Flag = False
    constant: Flag = False


class LineLoadTable(Table):
    """Force and moment per metre along a rod."""

    kind: Literal["line"]
    rod: Name
    force: over_time("force per length", 3) = [0.0, 0.0, 0.0]
    moment: over_time("force", 3) = [0.0, 0.0, 0.0]
    components: Literal["all", "normal"] = "all"
    follower: Flag = False
    profile: custom(_profile, "[[places], [factors]]") | None = None
    constant: Flag = False


class DampingTable(Table):
    """Damping of all rods, or of one."""

    rod: Name | None = None
    time: quantity("time") = 0.0
    force_strains: vector("impulse") | None = None
    moment_strains: vector("bending viscosity") | None = None
    mass: quantity("angular rate") = 0.0


class DragTable(Table):
    """Drag of a medium on one rod."""

    rod: Name
    normal: quantity("drag") = 0.0
    tangential: quantity("drag") = 0.0
    normal_quadratic: quantity("quadratic drag") = 0.0
    tangential_quadratic: quantity("quadratic drag") = 0.0
    spin_normal: quantity("impulse") = 0.0
    spin_tangential: quantity("impulse") = 0.0
    medium: over_time("speed", 3) = [0.0, 0.0, 0.0]


class ElectrostaticTable(Table):
    """Coulomb force between two charged rods."""

    rod: Name
    other: Name
    charge: quantity("number")
    other_charge: quantity("number")
    permittivity: quantity("number") = 8.8541878188e-12
    points: Integer = 6


class PartContactTable(Table):
    """Rods that touch a part."""

    kind: Literal["part"]
    rod: Name | None = None
    rods: Annotated[list[Name], Field(min_length=1)] | None = None
    part: Name
    friction: quantity("number") = 0.0
    radius: quantity("length") | None = None
    stand_off: quantity("length") | None = None
    elastic_slip: quantity("length") | None = None
    pressure: quantity("force per length") | None = None
    layer: tuple[quantity("line stiffness"), quantity("length")] | None = None


class RodContactTable(Table):
    """Rods that touch each other and themselves."""

    kind: Literal["rods"]
    rods: Annotated[list[Name], Field(min_length=1)]
    friction: quantity("number") = 0.0
    radius: quantity("length") | None = None
    stand_off: quantity("length") | None = None
    elastic_slip: quantity("length") | None = None
    pressure: quantity("force per length") | None = None
    layer: tuple[quantity("line stiffness"), quantity("length")] | None = None


class VelocityTable(Table):
    """Rigid motion at the start."""

    v: vector("speed") = (0.0, 0.0, 0.0)
    omega: vector("angular rate") = (0.0, 0.0, 0.0)
    point: vector("length") = (0.0, 0.0, 0.0)


class SolveTable(Table):
    """What to solve."""

    kind: Literal["static", "quasistatic", "path", "dynamic"]
    t: quantity("time") = 0.0
    steps: Integer | None = None
    duration: quantity("time") | None = None
    times: list[quantity("time")] | None = None
    rotation: Literal["quaternion", "kardan"] = "quaternion"
    theory: Literal["cosserat", "kirchhoff", "string"] = "cosserat"
    travel: Literal["out", "both"] = "out"
    resolution: custom(_resolution, "false, or an angle") | None = None
    past_limits: Flag = False
    modes: Integer | None = None
    along: Literal["loads", "time"] = "loads"
    until: custom(_until, "a factor, a time or 'critical'") = 1.0
    longest: quantity("number") | None = None
    branch: Integer | None = None
    plane: Literal["xy", "yz", "xz", "auto"] | None = None
    out_of_plane: Flag = False
    start: Literal["equilibrium", "drawn"] = "equilibrium"
    velocity: VelocityTable | None = None
    rho_inf: quantity("number") = 0.8
    rtol: quantity("number") | None = None
    dt: quantity("time") | None = None
    richardson: Flag = False
    accuracy: quantity("number") | None = None


class DriveLineTable(Table):
    """One line of a torque budget."""

    name: Name
    torque: quantity("moment") | None = None
    uncertainty: quantity("number") = 3.0


class DriveTable(Table):
    """What turns a hinge."""

    part: Name
    torque: custom(_over_angle, "moment, or [[angles], [moments]]")
    uncertainty: quantity("number") = 3.0
    motorisation: quantity("number") = 2.0
    lines: list[DriveLineTable] = []


class BendRadiusTable(Table):
    """Least bend radius."""

    limit: quantity("length") | None = None
    diameters: quantity("number") | None = None
    rule: Name | None = None
    wire_diameter: quantity("length") | None = None
    measured: Literal["inside", "centreline"] = "inside"
    rod: Name | None = None
    name: Name | None = None


class RodForceTable(Table):
    """Largest tension or compression in a rod."""

    limit: quantity("force")
    rod: Name | None = None
    name: Name | None = None


class StrainTable(Table):
    """Largest longitudinal strain of any fibre of a rod."""

    limit: quantity("number")
    rod: Name | None = None
    name: Name | None = None


class TwistTable(Table):
    """Largest twist of a rod."""

    limit: quantity("curvature")
    rod: Name | None = None
    name: Name | None = None


class ReactionForceTable(Table):
    """Largest force of a support."""

    limit: quantity("force")
    support: Name | None = None
    name: Name | None = None


class ReactionMomentTable(Table):
    """Largest moment of a support."""

    limit: quantity("moment")
    support: Name | None = None
    name: Name | None = None


class HingeTorqueTable(Table):
    """Largest torque that the drive of a hinge must supply."""

    limit: quantity("moment")
    part: Name | None = None
    name: Name | None = None


class ClearanceTable(Table):
    """Least distance of a rod's surface from a part or from another rod's."""

    limit: quantity("length")
    rod: Name | None = None
    part: Name | None = None
    other: Name | None = None
    leave_out: list[tuple[quantity("length"), quantity("length")]] = []
    name: Name | None = None


class ChecksTable(Table):
    """What is allowed: a limit for everything, a table that says on what, or a list of such tables."""

    bend_radius: limits_of(BendRadiusTable) | None = None
    tension: limits_of(RodForceTable) | None = None
    compression: limits_of(RodForceTable) | None = None
    strain: limits_of(StrainTable) | None = None
    twist: limits_of(TwistTable) | None = None
    reaction_force: limits_of(ReactionForceTable) | None = None
    reaction_moment: limits_of(ReactionMomentTable) | None = None
    hinge_torque: limits_of(HingeTorqueTable) | None = None
    clearance: limits_of(ClearanceTable) | None = None


class OutputTable(Table):
    """Where results go and how many."""

    folder: str | None = None
    every: quantity("time") | None = None
    pictures: Flag = True


def _end(value: Any) -> Any:
    measured(value)
    return value


End = custom(_end, "a number, or a string with a unit")


class VaryTable(Table):
    """One value of the scene that differs from case to case."""

    path: Name
    values: Annotated[list[Any], Field(min_length=1)] | None = None
    range: tuple[End, End] | None = None
    points: Integer | None = None
    normal: tuple[End, End] | None = None


class SweepTable(Table):
    """Many runs of this scene with other values."""

    kind: Literal["grid", "list", "latin_hypercube"] = "grid"
    vary: Annotated[list[VaryTable], Field(min_length=1)]
    cases: Integer | None = None
    seed: Integer | None = None
    report: Annotated[list[Name], Field(min_length=1)] | None = None
    errors: Flag = False
    folder: str | None = None


class VariableTable(Table):
    """One value that a design may choose."""

    path: Name
    range: tuple[End, End]
    axis: Direction | None = None


class LimitTable(Table):
    """A bound on a result that a design must keep."""

    result: Name
    least: End | None = None
    most: End | None = None


class DesignTable(Table):
    """The values of this scene that make a result least."""

    minimise: Name
    vary: Annotated[list[VariableTable], Field(min_length=1)]
    limits: list[LimitTable] = []
    margin: quantity("number") = 0.0
    tolerance: quantity("number") = 1e-4
    runs: Integer = 200
    tradeoff: tuple[Name, Name] | None = None
    folder: str | None = None


class SceneTables(Table):
    """A whole scene file."""

    title: str = ""
    section: list[
        Annotated[RoundSection | RectangleSection | GeneralSection | BuiltSection, Field(discriminator="kind")]
    ] = []
    rod: Annotated[list[RodTable], Field(min_length=1)]
    part: list[PartTable] = []
    support: list[Annotated[ClampTable | PinTable | WeldTable, Field(discriminator="kind")]] = []
    gravity: GravityTable | None = None
    load: list[Annotated[PointLoadTable | LineLoadTable, Field(discriminator="kind")]] = []
    damping: list[DampingTable] = []
    drag: list[DragTable] = []
    electrostatic: list[ElectrostaticTable] = []
    contact: list[Annotated[PartContactTable | RodContactTable, Field(discriminator="kind")]] = []
    drive: list[DriveTable] = []
    checks: ChecksTable | None = None
    solve: SolveTable
    output: OutputTable = OutputTable()
    sweep: SweepTable | None = None
    design: DesignTable | None = None
