"""Diagnosis in the user's names: what is not determined and why, what is weak, and the remedies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from orip.adjustment.convergence import TerminationReason
from orip.arrays import FloatArray, IntArray
from orip.bundle.antenna_diagnosis import antenna_diagnosis, cause_of_antenna
from orip.bundle.calibration import calibration_diagnosis, digits_lost
from orip.bundle.ground_system import control_count, control_on_a_line, not_determined
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.results.ground import reduced_cofactors
from orip.bundle.results.reliability import lost_control, lost_photos
from orip.bundle.results.unchecked_photos import unchecked_diagnosis
from orip.bundle.solve import SolvedBlock
from orip.bundle.undetermined_unknowns import LOOSE
from orip.bundle.unknowns import CONSTANT
from orip.bundle.verdict import TWO_PLACES
from orip.errors import ProjectWarning
from orip.progress import stage
from orip.records.block import Block
from orip.records.camera import CAMERA_PARAMETERS, OWN_PARAMETERS, Camera, first_of_lens
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import Diagnosis
from orip.wording import agreeing, counted_names, first_names

STRONG_CORRELATION = 0.95
_SIGMA0_TOO_LARGE = 2.0
_POINTS_FOR_A_PHOTO = 3
_NAMED_POINTS = 6

_SETTLED = 0.1
"""Changes below this part of a standard deviation do not count."""


def forewarnings(block: Block) -> tuple[ProjectWarning, ...]:
    """Return the weaknesses that are known before the adjustment."""
    text = "has both C and A1 unknown: they differ only by the higher distortion terms; hold A1 constant"
    return tuple(
        ProjectWarning("same-unknown", f"camera {camera.name}", text)
        for camera in block.cameras
        if _same_unknown(block, camera)
    )


@stage("diagnosing")
def diagnose(solved: SolvedBlock) -> tuple[Diagnosis, ...]:
    """Return every weakness found in a solved block, the gravest kind first."""
    return (
        *_another_block(solved),
        *(not_determined(solved) or control_on_a_line(solved)),
        *_errors_far_off(solved),
        *_undetermined(solved),
        *_unsettled(solved),
        *_principal_distance_and_scale(solved),
        *calibration_diagnosis(solved),
        *antenna_diagnosis(solved),
        *_behind(solved),
        *_at_one_of_two_places(solved),
        *unchecked_diagnosis(solved),
        *_as_a_whole(solved),
        *_correlated(solved),
    )


def _undetermined(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Name every unknown that was removed, record by record, with its probable cause."""
    names = solved.problem.unknowns.names
    normals = solved.normals
    together = _left_out_together(solved)
    columns = [
        int(column)
        for column in np.flatnonzero(normals.removed)
        if (found := names[column]) is not None and not (found.group == "POINT" and found.name in together)
    ]
    if together:
        names_of_some = first_names(together, _NAMED_POINTS)
        because = "their rays have no angle of intersection, or contradict each other"
        text = f"{len(together)} points were left out, as {because}: {names_of_some}"
        remedy = "measure them in photos taken from elsewhere, or check their names"
        yield Diagnosis("undetermined", f"point {together[0]}", text, remedy)

    if not columns:
        return
    lost_digits, most = normals.lost_digits, solved.block.definition.max_lost_digits

    def record(column: int) -> tuple[str, str]:
        name = names[column]
        assert name is not None
        return name.group, name.name

    for (group, name), members in groupby(columns, key=record):
        listed = list(members)
        of_record = [found.kind for column in listed if (found := names[column]) is not None]
        kinds = ", ".join(of_record)
        digits = float(lost_digits[listed].max())
        cause, remedy = (
            cause_of_antenna(solved, name, of_record) if group == "ANTENNA" else _cause(solved, group, name, of_record)
        )
        known = f"{digits:.0f} digits lost" if digits > most else f"a standard deviation above {LOOSE:.0%} of C"
        text = f"{kinds} of {group.lower()} {name} cannot be determined: {cause} ({known})"
        yield Diagnosis("undetermined", f"{group.lower()} {name}", text, remedy)


def _left_out_together(solved: SolvedBlock) -> tuple[str, ...]:
    """Return the names of points that were left out, if they are too many for a line of each."""
    names = solved.block.point_names
    left_out = tuple(names[point] for point in np.flatnonzero(solved.state.left_out))
    return left_out if len(left_out) > _NAMED_POINTS else ()


def _errors_far_off(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Say how good the photo points are, where the a-priori errors are so far off that the weights follow them."""
    if solved.scale == 1.0:
        return
    given = solved.block.definition.measurement_precision
    good = f"{solved.scale * given.value:.2g} {given.unit}"
    text = f"the photo points are about {good} good, not {given.value:g}: weights were reduced by that"
    yield Diagnosis("a-priori", f"bundle {solved.block.definition.name}", text, f"give measurement_precision as {good}")


def _unsettled(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Name the photo that iterations which did not converge would move farthest, in its standard deviations."""
    if solved.reason not in (TerminationReason.MAX_ITERATIONS, TerminationReason.DIVERGED):
        return
    correction, cofactor, scale = solved.normals.correction, solved.cofactors.reduced, solved.deviation_scale
    moves: list[tuple[float, str, str]] = []
    for photo, columns in zip(solved.block.photos, solved.problem.unknowns.photos, strict=True):
        sizes = [
            (float(abs(correction[column]) / np.sqrt(cofactor[column, column]) / scale), kind, photo.name)
            for kind, column in zip(PHOTO_PARAMETERS, columns.tolist(), strict=True)
            if column != CONSTANT and cofactor[column, column] > 0.0
        ]
        moves.extend([max(sizes)] if sizes else [])
    farthest = max(moves, default=(0.0, "", ""))
    if farthest[0] < _SETTLED:
        yield from _weights_unsettled(solved)
        return
    size, kind, name = farthest
    count = sum(move[0] >= _SETTLED for move in moves)
    text = (
        f"the iterations did not converge: one more would change {kind} of photo {name} by {size:.2g} standard "
        f"deviations, and {_photos(count)} by more than {_SETTLED}"
    )
    remedy = "look for wrong points there first; otherwise allow more iterations or give better preliminary values"
    yield Diagnosis("not-converged", f"photo {name}", text, remedy)


def _weights_unsettled(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Say what iterations lacked that no longer moved the photos: steady weights, or the last digits of ENP."""
    definition = solved.block.definition
    text = (
        f"max_iterations = {definition.max_iterations} was reached before ENP was {definition.enp_stop:g} and the "
        "weights of the observations were steady"
    )
    remedy = "correct the observations that do not fit first; otherwise increase max_iterations"
    if solved.reason is TerminationReason.MAX_ITERATIONS:
        yield Diagnosis("not-converged", f"bundle {definition.name}", text, remedy)


_CAUSES = {
    "MOUNTING": (
        "no exposure has a photo of this camera and of one whose mounting is known",
        "give offset and rotation in the [[rig]], or more exposures",
    ),
    "EXPOSURE": (
        "the points in its photos do not determine it", "measure more points in its photos, or give control"
    ),
    "THEODOLITE": ("none of its directions is used", "observe a direction, or give R"),
    "FIGURE": (
        "its points do not determine it", "name points of the figure further away from each other, or take it out"
    ),
}  # fmt: skip


def _cause(solved: SolvedBlock, group: str, name: str, kinds: Sequence[str]) -> tuple[str, str]:
    """Return why an unknown is not determined, and what to do."""
    block = solved.block
    if group == "POINT":
        rays = _rays(block, name)
        if rays < 2:
            cause = "it has one ray" if rays == 1 else "none of its photo points is used"
            return cause, "measure the point in another photo, give it control, or take it out"
        return "its rays are nearly parallel", "measure the point in a photo taken from elsewhere"
    if group == "PHOTO":
        points = _points_in_photo(block, name)
        if points < _POINTS_FOR_A_PHOTO:
            return f"it has {points} points, {_POINTS_FOR_A_PHOTO} are needed", "measure more points in this photo"
        count = control_count(block)
        if count < _POINTS_FOR_A_PHOTO:
            cause = f"only {_IN_WORDS[count]} {agreeing(count, 'control point')}" if count else "no control points"
            return cause, "add control points, three at least and not on one line"
        return "its points do not determine it", "measure points spread over the photo and at different depths"
    if group in _CAUSES:
        return _CAUSES[group]
    if "READOUT" in kinds and not solved.state.motions[_photos_of(block, name)].any():
        cause = "the motion of its photos is not known, and it acts together with the readout"
        return cause, "give exposure stations with times and strips, or hold READOUT constant"
    return "the photos do not determine it", "hold it constant, or add photos with other rotations and distances"


def _photos_of(block: Block, camera: str) -> NDArray[np.bool_]:
    return np.array([name == camera for name in (record.name for record in block.cameras)])[block.photo_camera]


_IN_WORDS = ("no", "one", "two")


def _rays(block: Block, name: str) -> int:
    points = block.photo_points
    used = points.partly_in_use & (points.point == block.point_index()[name])
    return len(np.unique(points.photo[used]))


def _points_in_photo(block: Block, name: str) -> int:
    points = block.photo_points
    place = [photo.name for photo in block.photos].index(name)
    return len(np.unique(points.point[points.partly_in_use & (points.photo == place)]))


def _same_unknown(block: Block, camera: Camera) -> bool:
    observed = {
        element.kind
        for element in block.elements
        if element.group == "CAMERA" and element.name.upper() == camera.name.upper()
    }
    return {"C", "A1"} <= set(camera.unknown) and not observed & {"C", "A1"}


def _principal_distance_and_scale(solved: SolvedBlock) -> Iterator[Diagnosis]:
    first = first_of_lens(solved.block.cameras)
    for row, camera in enumerate(solved.block.cameras):
        if first[row] != row or not _same_unknown(solved.block, camera):
            continue
        column = solved.problem.unknowns.cameras[row, CAMERA_PARAMETERS.index("A1")]
        lost = digits_lost(solved, int(column))
        yield Diagnosis(
            "same-unknown",
            f"camera {camera.name}",
            f"C and A1 of camera {camera.name} are the same unknown here ({lost:.0f} digits lost)",
            "hold A1 constant, or observe one of them",
        )


def _correlated(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Name the pairs of camera unknowns, and the photos, whose unknowns are highly correlated."""
    unknowns = solved.problem.unknowns
    first = first_of_lens(solved.block.cameras)
    for row, (camera, columns) in enumerate(zip(solved.block.cameras, unknowns.cameras, strict=True)):
        for _, a, b, r in _strong_pairs(solved, CAMERA_PARAMETERS, columns[None]):
            if first[row] != row and not {a, b} & set(OWN_PARAMETERS):
                continue  # said of the first camera with this lens
            text = f"{a} and {b} of camera {camera.name} correlate by {r:.3f}"
            yield Diagnosis("correlation", f"camera {camera.name}", text, "judge them together, or hold one constant")
    found: dict[tuple[str, str], list[tuple[float, str]]] = {}
    for row, a, b, r in _strong_pairs(solved, PHOTO_PARAMETERS, unknowns.photos):
        found.setdefault((a, b), []).append((abs(r), solved.block.photos[row].name))
    for (a, b), photos in found.items():
        largest, name = max(photos)
        text = f"{a} and {b} correlate above {STRONG_CORRELATION} in {_photos(len(photos))}, by {largest:.4f} in {name}"
        remedy = "judge them together; points at different depths or convergent photos separate them"
        yield Diagnosis("correlation", f"photo {name}", text, remedy)


def _photos(count: int) -> str:
    return f"{count} photo{'s' * (count > 1)}"


def _strong_pairs(
    solved: SolvedBlock, kinds: Sequence[str], columns: IntArray
) -> Iterator[tuple[int, str, str, float]]:
    """Yield record, the two unknowns and correlation of what correlates strongly in n records with `columns` (n, k)."""
    cofactor = reduced_cofactors(solved, columns)
    variance = np.einsum("nii->ni", cofactor)
    used = (columns != CONSTANT) & ~solved.normals.removed[columns] & (variance > 0.0)
    variance = np.where(used, variance, np.inf)
    r = cofactor / np.sqrt(variance[:, :, None] * variance[:, None, :])
    for record, place, other in np.argwhere(np.tril(np.abs(r), -1) > STRONG_CORRELATION).tolist():
        yield record, kinds[other], kinds[place], float(r[record, place, other])


def _another_block(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Name control points and photos most of whose rays are lost: what was adjusted is not what was measured."""
    remedy = "check OMEGA, PHI and KAPPA of the photos, or leave them out: orip finds preliminary values itself"
    for noun, names in (("control point", lost_control(solved)), ("photo", lost_photos(solved))):
        if names:
            where = counted_names(noun, names)
            lie = "lies" if len(names) == 1 else "lie"
            behind = f"{where} {lie} behind the cameras" if noun == "control point" else f"points lie behind {where}"
            text = f"{behind}, and the observations were left out: the preliminary values are wrong"
            yield Diagnosis("another-block", where, text, remedy)


def _behind(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Name the photo points that the solution puts behind their camera."""
    start = 0
    for observations in solved.problem.observations:
        rows = observations.rows
        active = solved.equations.active[start : start + len(rows.used)]
        start += len(rows.used)
        if not isinstance(observations, PhotoPointObservations):
            continue
        # used, but without influence: left out as a blunder, or since it is behind the camera
        idle: NDArray[np.bool_] = np.asarray((rows.used & ~active).reshape(-1, 2).any(axis=1))
        idle &= ~solved.state.left_out[observations.point]
        if not idle.any():
            continue
        some = observations.of(idle)
        rows = some.rows
        behind = rows.used & ~some.linearise_with_partials(solved.state).computable
        places = np.flatnonzero(behind).tolist()
        for photo, point in dict.fromkeys((rows.photo[row], rows.point[row]) for row in places):
            yield Diagnosis(
                "behind",
                f"photo {photo} point {point}",
                f"point {point} lies behind the camera of photo {photo}; its observation was left out",
                "check the point's name and the photo's preliminary values",
            )


def _at_one_of_two_places(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Name the points of which as many rays meet elsewhere: the lower cost is no proof of one ray more.

    Where residuals are far larger than their a-priori errors, rays do not fit by chance: it would be said of any point.
    """
    if not solved.converged or solved.variance.sigma0 > _SIGMA0_TOO_LARGE:
        return
    problem, factors = solved.problem, solved.weight_factors
    places = problem.rival_places(solved.state, solved.equations, factors, solved.weighing.final_limit)
    rays = 2 * len(solved.block.photo_points.photo)
    elsewhere = [
        place.columns[0]
        for place in places
        if _rays_that_fit(place.weights[place.rows < rays]) >= _rays_that_fit(factors[place.rows[place.rows < rays]])
    ]
    rows = np.flatnonzero(np.isin(problem.unknowns.points[:, 0], elsewhere))
    if not len(rows):
        return
    names = [solved.block.point_names[row] for row in rows]
    where = f"{agreeing(len(names), 'point')} {first_names(names, 2 * _NAMED_POINTS)}"
    text = "as many rays meet in another place, hardly worse: which of them are right cannot be told"
    yield Diagnosis(TWO_PLACES, where, text, "measure in another photo, or leave the point out")


def _rays_that_fit(weights: FloatArray) -> int:
    """Return how many rays have full weight in both of their coordinates; one often fits by chance."""
    return int(np.count_nonzero((weights >= 1.0).reshape(-1, 2).all(axis=1)))


def _as_a_whole(solved: SolvedBlock) -> Iterator[Diagnosis]:
    where = f"bundle {solved.block.definition.name}"
    sigma0, active = solved.variance.sigma0, solved.equations.active
    if np.isfinite(sigma0) and sigma0 > _SIGMA0_TOO_LARGE:
        text = f"sigma0 is {sigma0:.2f}: the residuals are that many times the a-priori errors"
        remedy = (
            "search for blunders with 'orip solve --snoop' (control needs errors above 0), then check a-priori errors"
        )
        yield Diagnosis("sigma0", where, text, remedy)
    if solved.variance.redundancy <= 0:
        text = "there is no redundancy: nothing checks the observations, and sigma0 cannot be computed"
        yield Diagnosis("no-redundancy", where, text, "measure more points or add control")
    if np.mean(solved.weight_factors[active] < 1.0) > 0.5:
        text = "more than half of the observations are down-weighted: the iterations diverge, or their start is poor"
        remedy = "check preliminary values and a-priori errors; solve without down-weighting first, then 'orip update'"
        yield Diagnosis("diverging", where, text, remedy)
