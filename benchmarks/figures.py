"""What was measured, as tables, against what is asked for and against the baseline."""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy
from bal import COST_TOLERANCE

Figures = dict[str, Any]
Results = dict[str, dict[str, Figures]]
"""Figures by case and program."""

SAME_COST = 1e-8
"""Relative difference of costs at the same minimum."""
_SAME_COST_OF = {"BAL": COST_TOLERANCE}
_SLOWER = 1.25
"""Times that differ by less say nothing on a machine that others use."""
_TO_THE_MINIMUM = {
    "50": (4.0, 6.0),
    "500": (3.0, 5.0),
    "2000": (2.0, 4.0),
    "BAL": (3.0, 6.0),
    "penta": (4.0, 6.0),
    "rings": (15.0, 25.0),
    "aerial-bal": (8.0, 10.0),
    "penta-bal": (7.5, 10.0),
    "rings-bal": (14.0, 20.0),
}
_COVARIANCES = {
    "500": (5.0, 10.0),
    "2000": (10.0, 20.0),
    "penta": (12.0, 20.0),
    "rings": (8.0, 15.0),
    "aerial-bal": (18.0, 25.0),
    "penta-bal": (15.0, 20.0),
    "rings-bal": (16.0, 25.0),
}
"""How many times faster than pycolmap orip must be, and should be."""
_LIMITED_MEMORY = ("500", "2000")
_NAMED = ("BAL", "penta", "rings", "aerial-bal", "penta-bal", "rings-bal")
"""Blocks that are not called by their number of photos."""
_COMMANDS = ("init", "measure", "solve")
_OF_PROJECTS: dict[str, tuple[tuple[str, str, tuple[str, ...], float, float], ...]] = {
    "solve:500": (
        ("CPU s of `orip solve`", "cpu", ("solve",), 2.0, 1.2),
        ("MB of all outputs", "outputs", (), 90.0, 60.0),
    ),
    "solve:2000": (
        ("CPU s of `orip solve`", "cpu", ("solve",), 8.0, 5.0),
        ("CPU s of the three commands", "cpu", _COMMANDS, 12.0, 8.0),
        ("MB of memory of `orip solve`", "peak", ("solve",), 800.0, 500.0),
    ),
    "solve:20000": (("MB of memory of `orip solve`", "peak", ("solve",), 16e3, 10e3),),
}
"""What is asked of whole projects: the figure, of which commands it is the sum, what it must be and should be."""

_FAR = 1e-6
"""Relative; a cost that far below the other one is of another minimum."""
_MARKS = "<!-- tables -->", "<!-- end of tables -->"


class Requirement(NamedTuple):
    """A figure that was found, what it must be and what it should be, and whether more of it is better."""

    what: str
    found: float
    must: float
    aim: float
    more: bool = True

    def verdict(self) -> str:
        """Return how far it is met."""
        if not np.isfinite(self.found):
            return "**missed**"
        sign = 1.0 if self.more else -1.0
        if sign * self.found < sign * self.must:
            return "**missed**"
        return "aim" if sign * self.found >= sign * self.aim else "must"


def machine(peer: str) -> Figures:
    """Return processor and versions."""
    cpu = Path("/proc/cpuinfo")
    names = [line.partition(":")[2].strip() for line in cpu.read_text().splitlines() if line.startswith("model name")]
    asked = "import pycolmap; print(pycolmap.__version__)"
    colmap = subprocess.run([peer, "-c", asked], check=False, capture_output=True, text=True).stdout.strip()
    return {
        "processor": f"{len(names)} x {names[0]}" if names else platform.processor(),
        "system": platform.system(),
        "Python": platform.python_version(),
        "NumPy": np.__version__,
        "SciPy": scipy.__version__,
        "pycolmap": colmap or "none",
    }


def requirements(found: Results) -> Iterator[Requirement]:
    """Yield what can be judged by the figures found."""
    yield from _against_pycolmap(found)
    yield from _against_itself(found)
    if "scipy" in found.get("500", {}):
        ratio = found["500"]["scipy"]["evaluation"] / _iteration(found["500"]["orip"])
        yield Requirement("500 photos: an evaluation, times faster than SciPy's recipe", ratio, 50.0, 80.0)
    if "Zurich" in found:
        yield Requirement("Zurich: seconds of `orip run`", found["Zurich"]["orip"]["run"], 0.9, 0.6, more=False)
        for command in ("help", "status"):
            cpu = found["Zurich"]["orip"].get(command, float("nan"))
            yield Requirement(f"CPU s of `orip {_WRITTEN[command]}`", cpu, 0.15, 0.10, more=False)
    yield from _of_projects(found)
    for case, programs in found.items():
        if case.startswith("adjust:"):
            figures = programs["orip"]
            what = f"{case.partition(':')[2]}: CPU s of `orip adjust` to those of pycolmap to the minimum alone"
            yield Requirement(what, figures["cpu"] / figures["pycolmap"], 1.0, 0.5, more=False)


_WRITTEN = {"help": "--help", "status": "status"}


def _of_projects(found: Results) -> Iterator[Requirement]:
    for case, asked in _OF_PROJECTS.items():
        figures = found.get(case, {}).get("orip", {})
        for what, key, commands, must, aim in asked if figures else ():
            keys = [f"{command}_{key}" for command in commands] or [key]
            total = sum(figures.get(key, float("nan")) for key in keys)
            yield Requirement(f"{_title(case.partition(':')[2])}: {what}", total, must, aim, more=False)


def _against_pycolmap(found: Results) -> Iterator[Requirement]:
    for case, (must, aim) in _TO_THE_MINIMUM.items():
        if case in found:
            ours, theirs = found[case]["orip"], found[case]["pycolmap"]
            ratio = theirs["minimum"] / ours["minimum"] if _same_minimum(case, ours, theirs) else float("nan")
            yield Requirement(f"{_title(case)}: to the minimum, times faster than pycolmap", ratio, must, aim)
    for case, (must, aim) in _COVARIANCES.items():
        if case in found:
            ours, theirs = found[case]["orip"], found[case]["pycolmap"]
            ratio = theirs["precision"] / ours["precision"]
            yield Requirement(f"{_title(case)}: covariances, times faster than pycolmap", ratio, must, aim)
            if case not in _LIMITED_MEMORY:
                continue
            memory = ours["peak_precision"] / theirs["peak_precision"]
            yield Requirement(f"{_title(case)}: covariances, memory to pycolmap's", memory, 0.5, 0.5, more=False)
    if "solve:2000" in found and "2000" in found:
        memory = found["solve:2000"]["orip"]["solve_peak"] / found["2000"]["pycolmap"]["peak"]
        what = "2000 photos: memory of `orip solve` to that of pycolmap's adjustment alone"
        yield Requirement(what, memory, 1.0, 0.7, more=False)


def _against_itself(found: Results) -> Iterator[Requirement]:
    if "500" in found and "2000" in found:
        ours = [found[case]["orip"] for case in ("500", "2000")]
        small, large = (_iteration(run) / run["photo_points"] for run in ours)
        what = "2000 photos: time of an observation and iteration to that at 500"
        yield Requirement(what, large / small, 1.5, 1.2, more=False)
    for case, programs in found.items():
        if case.startswith("threads:"):
            ratio = programs["two threads"]["minimum_wall"] / programs["orip"]["minimum_wall"]
            what = f"{_title(case.partition(':')[2])}: time of two threads to that of one"
            yield Requirement(what, ratio, 0.65, 0.55, more=False)
        if case.startswith("variants:"):
            yield from _of_variants(_title(case.partition(":")[2]), programs)
        if case.startswith("chain:"):
            for group, figures in programs.items():
                what = f"{group}: chain from nothing to the adjustment, median"
                yield Requirement(what, figures["ratio"], 1.0, 0.5, more=False)


def _of_variants(title: str, programs: dict[str, Figures]) -> Iterator[Requirement]:
    plain = programs["orip"]
    for name, figures in programs.items():
        if name != "orip":
            what = f"{title}, {name}: an iteration, times the plain camera's"
            yield Requirement(what, _iteration(figures) / _iteration(plain), 1.5, 1.2, more=False)
            what = f"{title}, {name}: covariances, times the plain camera's"
            yield Requirement(what, figures["precision"] / plain["precision"], 1.5, 1.2, more=False)


def differing(found: Results) -> list[str]:
    """Return the cases whose runs did not all have the same results bit for bit."""
    return [
        case for case, programs in found.items() for program in programs.values() if not program.get("identical", True)
    ]


def grown_slower(found: Results, baseline: Results) -> Iterator[str]:
    """Yield where orip has become slower by a quarter."""
    same_machine = found["machine"] == baseline.get("machine")
    for case in found.keys() & baseline.keys() - {"machine"}:
        now, then = found[case], baseline[case]
        if "orip" not in now:
            continue
        for key in ("minimum", "precision"):
            if "pycolmap" in now and "pycolmap" in then and key in now["pycolmap"] and key in then["pycolmap"]:
                ratio, before = (figures["pycolmap"][key] / figures["orip"][key] for figures in (now, then))
                if _SLOWER * ratio < before:
                    yield f"{case}, {key}: {ratio:.1f} times as fast as pycolmap; then {before:.1f}"
        for key in ("minimum", "precision", "run_cpu", "init_cpu", "measure_cpu", "solve_cpu"):
            if same_machine and now["orip"].get(key, 0.0) > _SLOWER * then["orip"].get(key, np.inf):
                yield f"{case}, {key}: {now['orip'][key]:.3f} s; then {then['orip'][key]:.3f} s"


def tables(found: Results) -> str:
    """Return all tables for which there are figures."""
    kinds = (_adjustments, _recipe, _threads, _variants, _chain, _whole, _startup)
    made = (table(found) for table in kinds)
    return "\n\n".join(table for table in made if table)


def requirement_table(found: Results) -> str:
    """Return what is asked for, what was found, and whether results differed from run to run."""
    lines = ["| | found | must | aim | reached |", "|---|---|---|---|---|"]
    for requirement in requirements(found):
        sign = "≥" if requirement.more else "≤"
        shown = f"{requirement.found:.2f}" if np.isfinite(requirement.found) else "another minimum"
        lines.append(
            f"| {requirement.what} | {shown} | {sign} {requirement.must:g} | {sign} {requirement.aim:g} "
            f"| {requirement.verdict()} |"
        )
    runs = sum(program.get("runs", 0) for programs in found.values() for program in programs.values())
    other = differing(found)
    text = f"in {', '.join(other)} they differed" if other else "all runs of a case agreed"
    return "\n".join(lines) + (f"\n\nResults bit for bit, {runs} runs of orip: {text}." if runs else "")


def summary(found: Results) -> str:
    """Return how many of the figures that are asked for are met, and by name those that are not."""
    asked = list(requirements(found))
    missed = [requirement for requirement in asked if "missed" in requirement.verdict()]
    aims = sum(requirement.verdict() == "aim" for requirement in asked)
    text = f"Of {len(asked)} required figures {aims} reach the aim, {len(asked) - aims - len(missed)} what they must"
    named = "; ".join(f"{one.what}, {one.found:.2f} and not {one.must:g}" for one in missed)
    return f"{text}. Missed: {named}." if missed else f"{text}."


def write_tables(path: Path, results: Results) -> None:
    """Put the tables between the marks in a text.

    Raises
    ------
    ValueError
        When the marks are not there.
    """
    text = path.read_text(encoding="utf-8")
    before, first, rest = text.partition(_MARKS[0])
    _, last, after = rest.partition(_MARKS[1])
    if not (first and last):
        message = f"{path} has not the marks {' and '.join(_MARKS)}"
        raise ValueError(message)
    where = ", ".join(f"{name} {value}" for name, value in results["machine"]["all"].items())
    made = "\n\n".join([where + ".", summary(results), tables(results)])
    path.write_text(f"{before}{first}\n{made}\n{last}{after}", encoding="utf-8")


def _adjustments(found: Results) -> str:
    heads = (
        "block", "photo points", "iterations", "minimum, s", "ratio", "covariances, s", "ratio", "memory, MB",
    )  # fmt: skip
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    blocks = sorted((case for case in found if case.isdigit()), key=int)
    for case in (*blocks, *(name for name in ("large", *_NAMED) if name in found)):
        ours = found[case]["orip"]
        programs = [found[case][program] for program in ("orip", "pycolmap") if program in found[case]]
        name = f"{ours['photos']:.0f} photos" if case not in _NAMED else case
        same = all(_same_minimum(case, ours, figures) for figures in programs)
        minimum, least = _times_and_ratio(programs, "minimum")
        covariances, ratio = _times_and_ratio(programs, "precision")
        iterations = ", ".join(f"{figures['iterations']:.0f}" for figures in programs)
        memory = ", ".join(f"{figures.get('peak_precision', figures['peak']):.0f}" for figures in programs)
        lines.append(
            f"| {name} | {_thousands(ours['photo_points'])} | {iterations} | {minimum} "
            f"| {least if same else 'another minimum'} | {covariances} | {ratio} | {memory} |"
        )
    return "\n".join(lines) if len(lines) > 2 else ""


def _recipe(found: Results) -> str:
    said = [
        f"{case} photos: {found[case]['scipy']['evaluation']:.2f} s an evaluation, "
        f"orip {_iteration(found[case]['orip']):.4f} s an iteration"
        for case in sorted((case for case in found if case.isdigit()), key=int)
        if "scipy" in found[case]
    ]
    return f"SciPy's recipe, {'; '.join(said)}." if said else ""


def _threads(found: Results) -> str:
    said = [
        f"{programs['orip']['photos']:.0f} photos: {_from_one_to_two(programs, 'minimum_wall')} s, covariances "
        f"{_from_one_to_two(programs, 'precision_wall')} s"
        for case, programs in found.items()
        if case.startswith("threads:")
    ]
    return f"Two threads in place of one, on the clock, {'; '.join(said)}." if said else ""


def _from_one_to_two(programs: dict[str, Figures], key: str) -> str:
    return f"{programs['two threads'][key]:.3f} in place of {programs['orip'][key]:.3f}"


def _variants(found: Results) -> str:
    said = []
    for case in sorted((case for case in found if case.startswith("variants:")), key=len):
        plain = found[case]["orip"]
        ratios = (
            f"{name} {_iteration(figures) / _iteration(plain):.2f}, {figures['precision'] / plain['precision']:.2f}"
            for name, figures in found[case].items()
            if name != "orip"
        )
        said.append(f"{_title(case.partition(':')[2])}: {'; '.join(ratios)}")
    text = "Variants, times the plain camera with control, an iteration and covariances"
    return f"{text}, {'. '.join(said)}." if said else ""


def _chain(found: Results) -> str:
    groups = {group: figures for case in found if case.startswith("chain:") for group, figures in found[case].items()}
    said = "; ".join(f"{group} {figures['ratio']:.2f}" for group, figures in groups.items())
    return f"The chain, times the adjustment, medians: {said}." if said else ""


def _whole(found: Results) -> str:
    said = []
    for case in sorted((case for case in found if case.startswith("solve:")), key=len):
        figures = found[case]["orip"]
        times = (
            f"`orip {name}` {figures[f'{name}_cpu']:.2f} s, {figures[f'{name}_peak']:.0f} MB" for name in _COMMANDS
        )
        said.append(f"{_title(case.partition(':')[2])}: {'; '.join(times)}")
    return f"Projects, CPU seconds and largest memory, {'. '.join(said)}." if said else ""


def _startup(found: Results) -> str:
    if "Zurich" not in found:
        return ""
    startup = found["Zurich"]["orip"]
    run = f"{startup['run']:.2f} s on the clock, {startup['run_cpu']:.2f} s CPU"
    answers = "; ".join(
        f"`orip {words}`: {startup[key]:.2f} s CPU" for key, words in _WRITTEN.items() if key in startup
    )
    return f"`orip run` on Zurich City Hall: {run}; {answers}."


def _times_and_ratio(programs: list[Figures], key: str) -> tuple[str, str]:
    """Return the times of orip and of the other program, and the ratio of the second to the first."""
    times = [figures[key] for figures in programs if key in figures]
    ratio = f"{times[1] / times[0]:.1f}" if len(times) > 1 else "—"
    return ", ".join(f"{seconds:.3f}" for seconds in times), ratio


def _thousands(count: float) -> str:
    return f"{count:,.0f}".replace(",", " ")


def _title(case: str) -> str:
    return f"{case} photos" if case.isdigit() else case


def _iteration(ours: Figures) -> float:
    """Return the time of an iteration; the factorisation at the end is shared among them."""
    return float(ours["minimum"] / ours["iterations"])


def _same_minimum(case: str, ours: Figures, theirs: Figures) -> bool:
    """Whether orip's cost is not higher, and not so low that observations must have got lost."""
    ratio = ours["cost"] / theirs["cost"]
    return bool(1.0 - _FAR < ratio <= 1.0 + _SAME_COST_OF.get(case, SAME_COST))
