"""What is wrong with the marks of all films alike: unit, transformation, given coordinates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, islice

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import ProjectWarning
from orip.geometry.plane import PARAMETERS, fit_plane_transformation
from orip.interior.definitions import Definitions
from orip.mistakes.mistake import BENT_PICTURES, declare
from orip.records.interior import MarkAdjustment
from orip.records.measurement import TransformationKind
from orip.records.names import record_key
from orip.units import MILLIMETRES_PER_INCH

MARK_UNIT = declare("mark-unit", "", BENT_PICTURES, explains_misfit=True)
MARK_TRANSFORMATION = declare("mark-transformation", "", BENT_PICTURES, explains_misfit=True)
MARKS_GIVEN_WRONG = declare("marks-given-wrong", "", BENT_PICTURES)

_NEAR = 0.02
"""Part by which the scale of a film differs at most from the ratio of two units."""

_UNITS = {1e3: "micrometres", 1.0 / MILLIMETRES_PER_INCH: "inches"}
"""By the scale of films measured in millimetres: the unit in which their marks are given."""

_BEYOND_FRAME = 5.0
"""Ratio of the extents of marks and frame from which they are not in one unit."""

_UNLIKELY = 1e-6
"""Probability by chance below which residuals have a cause that all films share."""

_LARGER = 3.0
"""Ratio from which a common misfit matters beside that of single films."""

_FEWEST = 3
"""Films from which on a misfit is common."""


class _Record(Struct, frozen=True):
    """The films with the marks of one record: a camera's photos or a temtick's templates."""

    where: str
    kind: str
    adjustments: list[MarkAdjustment]
    frame: tuple[float, float] | None


def marks_of_all_films(definitions: Definitions, adjustments: Sequence[MarkAdjustment]) -> list[ProjectWarning]:
    """Return warnings of cameras and temticks whose marks do not fit all of their films in the same way.

    Parameters
    ----------
    adjustments : sequence of MarkAdjustment
        Of all templates and photos.
    """
    records: dict[str, _Record] = {}
    for adjustment in adjustments:
        name, is_photo = record_key(adjustment.summary.name), adjustment.summary.group == "photos"
        if is_photo:
            camera = definitions.camera_of(definitions.photos[name])
            record = _Record(f"camera {camera.name}", "fiducial", [], camera.frame)
        else:
            record = _Record(f"temtick {definitions.templates[name].temtick}", "tick", [], None)
        records.setdefault(record_key(record.where), record).adjustments.append(adjustment)
    return [
        warning
        for record in records.values()
        for warning in islice(chain(_in_another_unit(record), _too_simple(record), _given_wrong(record)), 1)
    ]


def _in_another_unit(record: _Record) -> Iterator[ProjectWarning]:
    """Yield a warning of given coordinates in another unit than mm, which films measured in mm or the frame show."""
    scales = [(film.summary.sx, film.summary.sy) for film in record.adjustments]
    for scale, unit in _UNITS.items():
        if abs(np.median(scales) / scale - 1.0) < _NEAR:
            text = (
                f"its {record.kind} marks are given in {unit}, and measured in mm (the scale is "
                f"{np.median(scales):.5g}); give them in mm"
            )
            yield ProjectWarning(MARK_UNIT, record.where, text)
    if record.frame is None:
        return
    extent = max(float(np.ptp(film.given, axis=0).max()) for film in record.adjustments)
    if not max(record.frame) / _BEYOND_FRAME < extent < max(record.frame) * _BEYOND_FRAME:
        text = (
            f"its {record.kind} marks are given over {extent:.4g} mm, and its frame is {max(record.frame):.4g} mm: one "
            "is in another unit; give both in mm"
        )
        yield ProjectWarning(MARK_UNIT, record.where, text)


def _too_simple(record: _Record) -> Iterator[ProjectWarning]:
    """Yield a warning of a transformation that does not fit, where one with more unknowns does."""
    films = [film for film in record.adjustments if film.kind != "A" and film.summary.redundancy > 0]
    as_given, freedom = sum(_square_sum(film) for film in films), sum(film.summary.redundancy for film in films)
    kinds: tuple[TransformationKind, ...] = ("C", "A")
    for kind in kinds:
        rest, left = _with_kind(films, kind)
        if left <= 0 or all(film.kind == kind for film in films):
            continue
        if not _is_common(as_given - rest, freedom - left, rest, left, as_given / freedom):
            continue
        reason = "scale" if kind == "C" else "scales along x and y differ, or the comparator's axes are skew"
        text = (
            f"its {record.kind} marks fit within {np.sqrt(rest / left):.2g} mm with the transformation {kind}, and "
            f"within {np.sqrt(as_given / freedom):.2g} mm as they were measured ({reason}); write {kind} in place of "
            f"{films[0].kind} in the {_KEYWORDS[record.kind]} lines"
        )
        yield ProjectWarning(MARK_TRANSFORMATION, record.where, text)


_KEYWORDS = {"fiducial": "PHOTO", "tick": "TEMPLATE"}


def _with_kind(films: Sequence[MarkAdjustment], kind: TransformationKind) -> tuple[float, int]:
    """Return square sum and redundancy of films with another transformation, where enough marks are measured."""
    square_sum, freedom = 0.0, 0
    for film in films:
        used = ~film.marks.disregarded
        left = 2 * int(np.count_nonzero(used)) - PARAMETERS[kind]
        if left > 0:
            try:
                fitted = fit_plane_transformation(kind, film.marks.measured[used], film.given[used])
            except ValueError:
                return np.inf, 0
            square_sum += float(np.sum((fitted.apply(film.marks.measured[used]) - film.given[used]) ** 2))
        freedom += left
    return square_sum, freedom


def _given_wrong(record: _Record) -> Iterator[ProjectWarning]:
    """Yield a warning of marks that every film has elsewhere than they are given."""
    films = [film for film in record.adjustments if film.summary.redundancy > 0]
    if len(films) < _FEWEST:
        return
    off: dict[str, list[FloatArray]] = {}
    for film in films:
        for name, residual, left_out in zip(film.marks.names, film.residuals, film.marks.disregarded, strict=True):
            if not left_out:
                off.setdefault(name, []).append(residual)
    means = {name: np.mean(residuals, axis=0) for name, residuals in off.items()}
    common = sum(len(residuals) * float(means[name] @ means[name]) for name, residuals in off.items())
    freedom = max(film.summary.redundancy for film in films)
    left = sum(film.summary.redundancy for film in films) - freedom
    rest = sum(_square_sum(film) for film in films) - common
    if not _is_common(common, freedom, rest, left, common / (len(films) * freedom)):
        return
    worst = max(means, key=lambda name: float(means[name] @ means[name]))
    x, y = means[worst]
    text = (
        f"its {record.kind} marks do not fit as given ({np.sqrt(common / (len(films) * freedom)):.2g} mm), in all "
        f"{len(films)} films alike (apart from that, within {np.sqrt(rest / left):.2g} mm), mark {worst} worst (x "
        f"{x:+.3f}, y {y:+.3f} mm): they are nominal ones, or those of another camera, or one is wrong; give those of "
        "the calibration"
    )
    yield ProjectWarning(MARKS_GIVEN_WRONG, record.where, text)


def _square_sum(film: MarkAdjustment) -> float:
    return float(np.sum(film.residuals[~film.marks.disregarded] ** 2))


def _is_common(gain: float, unknowns: int, rest: float, left: int, variance: float) -> bool:
    """Tell whether a part of a square sum, with its degrees of freedom, is too large beside what is left of it."""
    from scipy.special import fdtrc  # takes its time; most commands do without

    if unknowns <= 0 or left <= 0 or not gain > 0.0 or variance <= _LARGER**2 * rest / left:
        return False
    return rest <= 0.0 or float(fdtrc(unknowns, left, gain / unknowns / (rest / left))) < _UNLIKELY
