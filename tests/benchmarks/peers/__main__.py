"""Error against CPU time of other tools beside ours, on the same problems, in one go on this machine.

    pip install -e '.[peers]'
    python tests/benchmarks/peers [--problem S2 D1] [--tool exudyn] [--out out/bench/peers.json]

Every tool runs in a process of its own with one thread, all tools on one problem before the next problem, so that each
ratio is of numbers that were measured within a minute. A case is solved once to warm up and then timed again and again;
what counts is the least CPU time of the solve call. A tool that is not installed is skipped with a message. The result is
drawn by `cosserat-fem bench --plot --peers FILE`.
"""

import os
import sys

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import argparse
import importlib
import json
import pathlib
import statistics
import subprocess
import time
from importlib import metadata, util

TOOLS = {  # adapter, module, package
    "exudyn": ("tool_exudyn", "exudyn", "exudyn"),
    "opensees": ("tool_opensees", "openseespy", "openseespy"),
    "pyelastica": ("tool_elastica", "elastica", "pyelastica"),
}
OURS = "cosserat_fem"
LONG, ENOUGH, REPEATS = 3.0, 0.5, 30  # CPU s: not repeated; no more repeats; most repeats
# ratio wanted: theirs over ours at equal or smaller error
WANTED = {
    ("S1", 1e-6): 1, ("S2", 1e-4): 50, ("S3", 1e-3): 2, ("S3", 1e-4): 5, ("S4", 1e-3): 1.5, ("S4", 1e-4): 2,
    ("S4", 1e-6): 3, ("D1", 1e-3): 10, ("D2", 1e-3): 2, ("D2", 1e-4): 4, ("D3", 1e-2): 1.5,
}  # fmt: skip


def measure_tool(tool, problem):
    """Rows of another tool on one problem, in this process."""
    from cosserat_fem.bench.measure import Row
    from cosserat_fem.bench.problems import PROBLEMS
    from run import Failed

    rows = []
    for case in importlib.import_module(TOOLS[tool][0]).cases(problem):
        spent, begin = [], time.process_time()
        try:
            run = case.solve()
            error = float(PROBLEMS[problem].error(run.observed))
            if run.cpu > LONG:
                spent.append(run.cpu)
            while not spent or (
                len(spent) < REPEATS and sum(spent) < ENOUGH and time.process_time() - begin < 5 * LONG
            ):
                spent.append(case.solve().cpu)
        except (Failed, ValueError, RuntimeError) as fault:
            rows.append(Row(problem, tool, case.method, case.resolution, None, 0.0, 0.0, 0, 0, failed=str(fault)[:200]))
            continue
        error = error if error == error else None
        cost = (min(spent), statistics.median(spent), len(spent), run.dofs, run.iterations, run.steps)
        rows.append(Row(problem, tool, case.method, case.resolution, error, *cost))
    return rows


def measure_ours(problem):
    from cosserat_fem.bench.measure import run_bench

    return run_bench([problem])


def in_own_process(tool, problem):
    """Rows from a process of its own; a message if it dies."""
    command = [sys.executable, str(pathlib.Path(__file__).parent), "--child", tool, problem]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        print(f"  {tool} {problem}: stopped with code {done.returncode}: {done.stderr.strip()[-300:]}")
        return []
    return json.loads(done.stdout.splitlines()[-1])


def child(tool, problem):
    """What `in_own_process` reads: all the tool's own output goes elsewhere."""
    from dataclasses import asdict

    answer = os.dup(1)
    os.dup2(2, 1)
    rows = measure_ours(problem) if tool == OURS else measure_tool(tool, problem)
    os.write(answer, (json.dumps([asdict(row) for row in rows]) + "\n").encode())


def ratios(rows):
    """Lines: problem, error, ours, the fastest other tool, their ratio, the ratio wanted."""
    from cosserat_fem.bench.measure import TARGETS, fastest

    lines = []
    for problem in dict.fromkeys(row.problem for row in rows):
        for target in TARGETS:
            ours = fastest((row for row in rows if row.tool == OURS), problem, target)
            other = fastest((row for row in rows if row.tool != OURS), problem, target)
            cells = [f"{1e3 * r.cpu:.3g} ms {r.method}, {r.resolution}" if r else "not reached" for r in (ours, other)]
            if other:
                cells[1] = f"{other.tool}: {cells[1]}"
            wanted = WANTED.get((problem, target))
            lines.append({
                "problem": problem, "error": target, "ours": cells[0], "other": cells[1],
                "ratio": other.cpu / ours.cpu if ours and other else None, "wanted": wanted,
            })  # fmt: skip
    return lines


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--problem", nargs="+", help="default: all of the bench; the other tools know S1 to S4 and D1 to D3"
    )
    parser.add_argument("--tool", nargs="+", choices=TOOLS, default=list(TOOLS))
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out/bench/peers.json"))
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        return child(*options.child)

    from cosserat_fem.bench.command import table
    from cosserat_fem.bench.measure import Row, as_json
    from cosserat_fem.bench.problems import PROBLEMS

    problems = options.problem or list(PROBLEMS)
    for name in problems:
        if name not in PROBLEMS:
            parser.error(f"problem {name!r} does not exist; known: {', '.join(PROBLEMS)}")
    tools, versions = [], {}
    for tool in options.tool:
        _, module, package = TOOLS[tool]
        if util.find_spec(module) is None:
            print(f"{tool} is not installed and is left out (pip install -e '.[peers]').")
            continue
        tools.append(tool)
        versions[package] = metadata.version(package)
    rows = []
    for problem in problems:
        for tool in (OURS, *tools):
            rows += [Row(**row) for row in in_own_process(tool, problem)]
        print(table(row for row in rows if row.problem == problem), flush=True)
    lines = ratios(rows)
    print("\nThe fastest at or below an error; ratio: CPU time of the other tool over ours")
    for line in lines:
        ratio = "" if line["ratio"] is None else f"{line['ratio']:.3g}"
        wanted = "" if line["wanted"] is None else f"(wanted {line['wanted']:g})"
        print(f"{line['problem']:4s} {line['error']:.0e}  {ratio:>6s} {wanted:12s}  {line['ours']:55s} {line['other']}")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(as_json(rows, ratios=lines, other_tools=versions), indent=1) + "\n")
    print(f"Results in {options.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
