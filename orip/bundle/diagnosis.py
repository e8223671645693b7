"""Diagnosis in the user's names: what is not determined, what is weak, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

import numpy as np

from orip.bundle.calibration import calibration_diagnosis
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import UnknownName
from orip.model.solution import Diagnosis

_SIGMA0_TOO_LARGE = 2.0


def diagnose(solved: SolvedBlock) -> tuple[Diagnosis, ...]:
    """Return every weakness found in a solved block."""
    return (
        *_undetermined(solved),
        *_principal_distance_and_scale(solved),
        *calibration_diagnosis(solved),
        *_behind(solved),
        *_precision(solved),
    )


def _undetermined(solved: SolvedBlock) -> Iterator[Diagnosis]:
    names = solved.problem.unknowns.names
    removed = [name for column in np.flatnonzero(solved.adjusted.normals.removed) if (name := names[column])]
    for (group, record), members in groupby(removed, key=lambda name: (name.group, name.name)):
        kinds = ", ".join(name.kind for name in members)
        where = f"{group.lower()} {record}"
        yield Diagnosis("undetermined", where, f"{kinds} of {where} cannot be determined", _remedy(group))


def _remedy(group: str) -> str:
    return {
        "CAMERA": "hold it constant, or add photos that differ in height, tilt and turn, or control with depth",
        "PHOTO": "add control points or tie points, or hold the element constant",
        "POINT": "measure the point in a second photo, give it control, or take it out",
    }[group]


def _principal_distance_and_scale(solved: SolvedBlock) -> Iterator[Diagnosis]:
    unknown = {name for name in solved.problem.unknowns.names if name is not None}
    for camera in solved.block.cameras:
        if {UnknownName("CAMERA", camera.name, kind) for kind in ("C", "A1")} <= unknown:
            yield Diagnosis(
                "same-unknown",
                f"camera {camera.name}",
                f"C and A1 of camera {camera.name} are the same unknown but for the higher distortion terms",
                "hold A1 constant, or observe one of them",
            )


def _behind(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Name the photo points that the solution puts behind their camera."""
    equations = solved.adjusted.linearised.equations
    start = 0
    for observations in solved.problem.observations:
        rows = observations.rows
        end = start + len(rows.photo)
        behind = rows.used & ~equations.active[start:end]
        for photo, point in dict.fromkeys((rows.photo[row], rows.point[row]) for row in np.flatnonzero(behind)):
            yield Diagnosis(
                "behind",
                f"photo {photo} point {point}",
                f"point {point} came to lie behind photo {photo}; its observation was left out",
                "check the point's name and the photo's preliminary values",
            )
        start = end


def _precision(solved: SolvedBlock) -> Iterator[Diagnosis]:
    sigma0 = solved.variance.sigma0
    if np.isfinite(sigma0) and sigma0 > _SIGMA0_TOO_LARGE:
        yield Diagnosis(
            "sigma0",
            f"bundle {solved.block.definition.name}",
            f"sigma0 is {sigma0:.2f}: residuals are that many times larger than the a-priori errors promise",
            "look for blunders among the largest residuals, check control, then the a-priori errors",
        )
    if solved.variance.redundancy <= 0:
        yield Diagnosis(
            "no-redundancy",
            f"bundle {solved.block.definition.name}",
            "there is no redundancy: nothing checks the observations, and sigma0 cannot be computed",
            "measure more points or add control",
        )
