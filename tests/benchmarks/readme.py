"""Measure everything anew and put the results into the README: pictures, table, machine, versions.

    pip install -e '.[peers]'
    python tests/benchmarks/readme.py [--from out/bench]

Runs `python tests/benchmarks/peers` on every problem and `cosserat-fem bench --scaling`, one after the other with one
thread (about a quarter of an hour on a free machine), into out/bench; then rewrites docs/images/work_precision.png,
docs/images/scaling.png and what stands between the marks in README.md. With --from only the latter, from what is there.
"""

import argparse
import json
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).parents[2]
BEGIN, END = "<!-- bench: written by tests/benchmarks/readme.py -->", "<!-- end of bench -->"
TARGETS = (1e-2, 1e-3, 1e-4, 1e-6)


def measure(out):
    """The two runs, as a user would start them."""
    for command in (
        [str(ROOT / "tests" / "benchmarks" / "peers"), "--out", str(out / "peers.json")],
        ["-m", "cosserat_fem", "bench", "--scaling", "-o", str(out)],
    ):
        print("python", *command, flush=True)
        subprocess.run([sys.executable, *command], check=True, cwd=ROOT)


def number(value):
    """Three digits, no exponent."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def rows_of(problem, rows, title):
    """Lines of the table: the cheapest of ours and of the others at or below each error."""
    from cosserat_fem.bench.measure import TOOL, fastest

    lines, before = [], None
    for target in TARGETS:
        ours = fastest((row for row in rows if row.tool == TOOL), problem, target)
        other = fastest((row for row in rows if row.tool != TOOL), problem, target)
        if (ours, other) == before or (ours is None and other is None):
            continue
        before = (ours, other)
        cells = ["", f"{target:.0e}".replace("e-0", "e-")]
        cells.append(f"{number(1e3 * ours.cpu)} ({ours.method}, {ours.resolution})" if ours else "not reached")
        cells.append(f"{number(1e3 * other.cpu)} ({other.tool} {other.method}, {other.resolution})" if other else "–")
        cells.append(number(other.cpu / ours.cpu) if ours and other else "–")
        lines.append(cells)
    if lines:
        lines[0][0] = f"{problem} {title}"
    return ["| " + " | ".join(cells) + " |" for cells in lines]


def section(peers, scaling):
    """Markdown between the marks."""
    from cosserat_fem.bench.measure import Row

    rows = [Row(**row) for row in peers["rows"]]
    machine = peers["machine"]
    versions = {**machine["versions"], **peers["other_tools"]}
    lines = [
        "![Error against CPU time](docs/images/work_precision.png)", "",
        "| problem | error ≤ | ours, CPU ms | fastest other tool, CPU ms | other / ours |", "|---|---|---|---|---|",
    ]  # fmt: skip
    for name, problem in peers["problems"].items():
        lines += rows_of(name, rows, problem["title"])
    load = f"{machine['load'][0]:.1f}" if machine["load"] else "unknown"
    lines += [
        "",
        f"{machine['processor']}, {machine['cores']} cores (load {load} at the end), one thread; "
        + ", ".join(f"{name} {version}" for name, version in versions.items())
        + ".",
    ]
    one, many = scaling["one rod"], scaling["many rods"]
    largest = one["rows"][-1]
    each = 1e6 * largest["cpu"] / largest["iterations"] / largest["elements"]
    lines += [
        "",
        "![Cost against size](docs/images/scaling.png)",
        "",
        f"One cable of {one['rows'][0]['elements']} to {largest['elements']} elements of order 3: CPU time of an iteration "
        f"~ elements^{one['time_exponent']:.2f}, memory ~ elements^{one['memory_exponent']:.2f}; at the largest "
        f"{each:.1f} µs and {1024 * largest['memory'] / largest['elements']:.1f} kB an element. "
        f"1 to {many['rows'][-1]['size']} cables of ten elements in one model: time ~ elements^{many['time_exponent']:.2f}, "
        f"memory ~ elements^{many['memory_exponent']:.2f}.",
    ]
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--from", dest="source", type=pathlib.Path, help="folder with peers.json and scaling.json")
    options = parser.parse_args()
    out = (options.source or ROOT / "out" / "bench").resolve()
    if options.source is None:
        measure(out)
    peers = json.loads((out / "peers.json").read_text())
    scaling = json.loads((out / "scaling.json").read_text())["scaling"]

    from cosserat_fem.bench import plots
    from cosserat_fem.bench.measure import Row

    images = ROOT / "docs" / "images"
    for made in (
        plots.plot_work_precision([Row(**row) for row in peers["rows"]], images / "work_precision"),
        plots.plot_scaling(scaling, images / "scaling"),
    ):
        made[0].unlink()  # the svg; the page shows the png
    readme = ROOT / "README.md"
    text = readme.read_text(encoding="utf-8")
    head, rest = text.split(BEGIN)
    _, tail = rest.split(END)
    readme.write_text(f"{head}{BEGIN}\n{section(peers, scaling)}\n{END}{tail}", encoding="utf-8")
    print(f"{readme} and {images} are rewritten.")


if __name__ == "__main__":
    main()
