"""Blocks adjusted by orip, pycolmap (Ceres) and SciPy's recipe, alternately, from the same start, one thread each.

    python benchmarks/against_peers.py --peer /path/to/environment/bin/python 50 500 BAL Zurich
    python benchmarks/against_peers.py --peer ... 2000 solve:2000 threads:500 large --repetitions 1
    python benchmarks/against_peers.py --table docs/performance.md

Cases: a number of photos; penta and rings, blocks without a narrow band; BAL, a real problem with a camera for each
photo; aerial-bal, aerial-bal-2000, penta-bal and rings-bal, blocks as other programs leave them (`bal_files.py`);
adjust:NAME, `orip adjust` of one of these as a model of COLMAP; Zurich, the sample project from texts to results;
solve:N, a project of N photos on the disk; threads:N, two threads against one, where N may be a name; variants:N, free
network, sets of additional parameters and fisheye against the same block with control and a plain camera; chain:N,
blocks of the studies of preliminary values, once; large, 5000 photos and 500 000 points. The environment has pycolmap
and SciPy. What counts is the smallest of the repetitions.

Prints tables in Markdown and says what falls short of what is asked for. Ends with 1 where orip has become slower than
in baseline.json by a quarter: as a ratio to pycolmap, and in seconds on the machine that the baseline is from.
`--write` puts the results into the baseline; `--table` puts tables of the baseline between the marks in a text.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from aerial_blocks import VARIANTS
from bal import COST_TOLERANCE, LADYBUG, MINIMUM_COST
from bal_files import BAL_FILES
from figures import Figures, Results, grown_slower, machine, requirement_table, tables, write_tables
from startup import help_cpu, status_cpu, zurich
from wide_blocks import BLOCKS

HERE = Path(__file__).parent
BASELINE = HERE / "baseline.json"
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
_WITH_STUDIES = {**ONE_THREAD, "PYTHONPATH": str(HERE.parent / "tests")}
_SCIPY_PHOTOS = 500
"""Larger blocks would take SciPy's recipe hours."""
SOLVERS = ("DENSE_SCHUR", "SPARSE_SCHUR")
"""Of pycolmap."""
_LARGE = ("5000", 353)
"""Photos and points in each, which are 500 000 in all."""


def run(*command: str, environment: Mapping[str, str] = ONE_THREAD) -> Figures:
    """Run a program that prints its figures as JSON in its last line."""
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env={**os.environ, **environment})
    return dict(json.loads(done.stdout.splitlines()[-1]))


def run_orip(case: str, points: int | None = None, threads: int = 1) -> Figures:
    """Run orip's adjustment of a case."""
    more = [] if points is None else ["--points", str(points)]
    environment = {name: str(threads) for name in ONE_THREAD}
    command = (sys.executable, str(HERE / "orip_adjustment.py"), case, "--threads", str(threads), *more)
    return run(*command, environment=environment)


def run_variant(photos: str, variant: str) -> Figures:
    """Run orip's adjustment of a variant of an aerial block."""
    return run(sys.executable, str(HERE / "orip_adjustment.py"), photos, "--variant", variant)


def best(runs: list[Figures]) -> Figures:
    """Return the smallest of each figure; of texts the first, and whether all results were the same bit for bit."""
    first = runs[0]
    found = {key: min(run[key] for run in runs) if isinstance(value, float) else value for key, value in first.items()}
    if "digest" in found:
        found["identical"] = len({run["digest"] for run in runs}) == 1
        found["runs"] = len(runs)
    return found


def compared(case: str, peer: str, repetitions: int) -> dict[str, Figures]:
    """Return the figures of the programs for an aerial block or the BAL problem, run in turn."""
    runs: dict[str, list[Figures]] = {"orip": [], "pycolmap": []}
    if case.isdigit() and int(case) <= _SCIPY_PHOTOS:
        runs["scipy"] = []
    with tempfile.TemporaryDirectory() as folder:
        problem = str(Path(folder) / "problem.npz")
        # a process starts with the peak memory of the one that started it: the block is not made in this one
        subprocess.run([sys.executable, str(HERE / "peer_problem.py"), case, problem], check=True)
        colmap = [peer, str(HERE / "pycolmap_peer.py"), problem]
        if case in BLOCKS or case in BAL_FILES:
            colmap += ["--solver", quicker_solver(colmap)]
        if case == "BAL":
            until = run(*colmap, "--until", repr(MINIMUM_COST * (1.0 + COST_TOLERANCE)))
            colmap += ["--iterations", str(until["iterations"])]
        for repetition in range(repetitions):
            runs["orip"].append(run_orip(case))
            runs["pycolmap"].append(run(*colmap))
            # it takes long, and its evaluations are many
            if "scipy" in runs and repetition == 0:
                runs["scipy"].append(run(peer, str(HERE / "scipy_peer.py"), problem))
    return {name: best(run) for name, run in runs.items()}


def quicker_solver(colmap: list[str]) -> str:
    """Return the solver with which pycolmap takes less time, in iterations enough for what is prepared to count little.

    Of rings-bal two take as long with either, all ten to the minimum by half longer with DENSE_SCHUR.
    """
    return min(SOLVERS, key=lambda solver: run(*colmap, "--solver", solver, "--iterations", "8")["minimum"])


def measured(case: str, given: argparse.Namespace) -> dict[str, Figures]:
    """Return the figures of a case."""
    kind, _, size = case.partition(":")
    if kind == "Zurich":
        wall, cpu = (min(times) for times in zip(*(zurich() for _ in range(given.repetitions)), strict=True))
        answers = {name: min(asked() for _ in range(given.repetitions)) for name, asked in _ANSWERS.items()}
        return {"orip": {"run": wall, "run_cpu": cpu, **answers}}
    if kind == "solve":
        whole = (sys.executable, str(HERE / "whole_solve.py"), size)
        return {"orip": best([run(*whole) for _ in range(given.repetitions)])}
    if kind == "adjust":
        whole = (sys.executable, str(HERE / "whole_adjust.py"), size, "--peer", given.peer)
        return {"orip": best([run(*whole) for _ in range(given.repetitions)])}
    if kind == "threads":
        runs = [(run_orip(size), run_orip(size, threads=2)) for _ in range(given.repetitions)]
        one, two = zip(*runs, strict=True)
        return {"orip": best(list(one)), "two threads": best(list(two))}
    if kind == "variants":
        names = ("orip", *VARIANTS)
        runs = [
            [run_orip(size) if name == "orip" else run_variant(size, name) for name in names]
            for _ in range(given.repetitions)
        ]
        return {name: best(list(of_name)) for name, of_name in zip(names, zip(*runs, strict=True), strict=True)}
    if kind == "chain":
        return run(sys.executable, str(HERE / "chain_study.py"), size, environment=_WITH_STUDIES)
    if kind == "large":
        return {"orip": best([run_orip(*_LARGE) for _ in range(given.repetitions)])}
    return compared(case, given.peer, given.repetitions)


_ANSWERS = {"help": help_cpu, "status": status_cpu}


def cases(words: list[str]) -> list[str]:
    """Return the cases that can be run."""
    if "BAL" in words and not LADYBUG.exists():
        print(f"BAL is left out: there is no {LADYBUG}", file=sys.stderr)
        return [word for word in words if word != "BAL"]
    return words


def main() -> None:
    """Measure, print, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", default=[], help="see above")
    parser.add_argument("--peer", default=sys.executable, help="a Python that has pycolmap and SciPy")
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--write", action="store_true", help="put the results into baseline.json")
    parser.add_argument("--table", type=Path, help="a text to put the tables of baseline.json into")
    given = parser.parse_args()
    baseline: Results = json.loads(BASELINE.read_text(encoding="utf-8")) if BASELINE.exists() else {}
    found: Results = {"machine": {"all": machine(given.peer)}}
    for case in cases(given.cases):
        print(f"{case} ...", file=sys.stderr, flush=True)
        found[case] = measured(case, given)
        if given.write:
            # case by case: whoever interrupts a long run keeps what it has found
            text = json.dumps({**baseline, **found}, indent=2, sort_keys=True)
            BASELINE.write_text(text + "\n", encoding="utf-8")
    if given.cases:
        print(tables(found), requirement_table(found), sep="\n\n")
    slower = list(grown_slower(found, baseline))
    for case in slower:
        print("slower than the baseline:", case, file=sys.stderr)
    if given.table:
        write_tables(given.table, {**baseline, **found} if given.write else baseline)
    if slower and not given.write:
        sys.exit(1)


if __name__ == "__main__":
    main()
