"""What to do about blunders and about parameters that were taken out, in the user's names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

from orip.bundle.calibration import ParameterTest
from orip.records.observation_kinds import CONTROL_POINT
from orip.records.solution import Blunder, Diagnosis


def blunder_advice(blunders: Sequence[Blunder], ground_unit: str) -> Iterator[Diagnosis]:
    """Return a diagnosis for each blunder, in the order they were found."""
    for _, members in groupby(blunders, key=lambda each: each.order):
        found = list(members)
        sizes = ", ".join(f"{each.component} {each.size:+.4g} ± {each.sd:.2g}" for each in found)
        if found[0].kind == CONTROL_POINT.name:
            where = f"control point {found[0].point}"
            text = f"{where} contradicts the photos; its coordinates are off by {sizes} {ground_unit}"
            remedy = "check the coordinates, and whether the feature measured in the photos is the one surveyed"
        else:
            where = f"photo {found[0].photo} point {found[0].point}"
            text = f"{where} is measured wrongly; it is off by {sizes} mm"
            remedy = "measure it again, or disregard it; check its name"
        yield Diagnosis("blunder", where, text, remedy)


def pruning_advice(removed: Sequence[ParameterTest]) -> Iterator[Diagnosis]:
    """Return a diagnosis for each parameter that pruning has held at zero, in the order they went."""
    for test in removed:
        names = ", ".join(test.parameters)
        where = f"camera {test.camera}"
        if test.verdict == "not determinable":
            why = f"the other unknowns explain it ({test.lost_digits:.1f} digits lost)"
        else:
            why = f"it is not significant ({test.statistic:.2f}, limit {test.limit:.2f})"
        text = f"{names} of {where} was held at zero: {why}"
        of_a_set = "." in names
        remedy = (
            "solve with --prune again" if of_a_set else "take it out of the camera's unknown parameters in orip.toml"
        )
        yield Diagnosis("pruned", where, text, remedy)
