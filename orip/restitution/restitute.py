"""`orip restitute compute`: features from stereo measurements, put into NAME.GEO."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.bundle.solve import SolvedBlock
from orip.errors import Complaint, ProjectWarning
from orip.files.log.stereo import read_stereo
from orip.files.text.lines import existing_text
from orip.geometry.plane import IDENTITY, PlaneTransformation
from orip.records.measurement import StereoFeature, StereoVertex
from orip.records.names import record_key
from orip.restitution.feature import ENDING, Feature, Stereo, Vertex, read_features, snapped, text_with
from orip.restitution.intersection import Intersected, StereoMarks, intersect
from orip.workflow.adjust.results import solved_again
from orip.workflow.adjust.solve import ADJUSTED_FROM
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.commit import Change
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.outputs import EditedText, digest_of_text
from orip.workflow.project.state import Part
from orip.workflow.project.texts import raise_complaints
from orip.workflow.records.mentions import is_written

RESTITUTED_FROM: tuple[Part, ...] = (*ADJUSTED_FROM, "solutions")
"""What restitution needs of the stores."""

LARGEST_W = 3.29
"""A y-parallax of so many standard deviations has a probability of 0.001."""


class Restituted(Struct, frozen=True):
    """What was restituted.

    Parameters
    ----------
    file : str
        The file of all features, as the user would name it.
    features : tuple of Feature
        Those that were computed.
    w : tuple of tuples of float
        The y-parallax of each of their vertices over its standard deviation, before vertices snapped.
    snapped : int
        Vertices that took the place of one that was there.
    """

    file: str
    features: tuple[Feature, ...]
    w: tuple[tuple[float, ...], ...]
    snapped: int
    warnings: tuple[ProjectWarning, ...]


def geo_file(project: ProjectFolder) -> Path:
    """Return the file of all restituted features of a project."""
    return project.folder / f"{project.definition.control_files}{ENDING}"


def read_geo(project: ProjectFolder) -> tuple[Feature, ...]:
    """Return all restituted features of a project; none where there is no file.

    Raises
    ------
    InputError
        With all that is wrong in the file.
    """
    path = geo_file(project)
    found = read_features(path, project.shown(path))
    raise_complaints(found.complaints)
    return found.value


def restitute(bundle: BundleState, files: Sequence[Path], within: float = 0.0) -> Change[Restituted]:
    """Compute features from files of stereo measurements; those of a code and name that are there are replaced.

    Parameters
    ----------
    bundle : BundleState
        With `RESTITUTED_FROM`.
    files : sequence of Path
        Relative to the project folder.
    within : float
        Distance, ground units, within which a vertex snaps to one that is there; 0: none does.

    Raises
    ------
    InputError
        With all that is wrong in the files; if the bundle has not been adjusted, or has changed since.
    """
    project, path = bundle.project, geo_file(bundle.project)
    shown, digest = project.shown(path), digest_of_text(path)
    there = read_features(path, shown)
    measured, complaints = _read(project, files)
    raise_complaints([*there.complaints, *complaints])
    solved = solved_again(bundle)
    features, w = _computed(bundle, solved, measured)
    features, count = snapped(there.value, features, within)
    text = text_with(existing_text(path, shown), there.value, features)
    outcome = Restituted(shown, features, w, count, tuple(_doubtful(features, w)))
    lock = project.exterior
    edited = EditedText(path, digest, text, "the file is unchanged")
    return Change(
        bundle.state, outcome, locks=(lock,) if is_written(lock) else (), is_compared=False, edited_texts=(edited,)
    )


def _read(project: ProjectFolder, files: Sequence[Path]) -> tuple[list[tuple[str, StereoFeature]], list[Complaint]]:
    """Return the features of all files, each with its file, and all that is wrong."""
    measured: list[tuple[str, StereoFeature]] = []
    complaints: list[Complaint] = []
    for file in files:
        path = project.folder / file
        found = read_stereo(path, project.shown(path))
        complaints += found.complaints
        measured += [(project.shown(path), feature) for feature in found.value]
    first: dict[tuple[str, str], str] = {}
    for shown, feature in measured:
        before = first.setdefault((record_key(feature.code), feature.name), shown)
        if before != shown:
            text = f"{feature.code} {feature.name} is in {before} too; give one of them another name"
            complaints.append(Complaint(text, shown, feature.line))
    return measured, complaints


def _computed(
    bundle: BundleState, solved: SolvedBlock, measured: Sequence[tuple[str, StereoFeature]]
) -> tuple[tuple[Feature, ...], tuple[tuple[float, ...], ...]]:
    vertices = [(shown, vertex) for shown, feature in measured for vertex in feature.vertices]
    to_photo = _to_photo(bundle)
    place = {record_key(photo.name): row for row, photo in enumerate(solved.block.photos)}
    raise_complaints(list(_unknown_photos(vertices, place, to_photo)))
    found = intersect(solved, stereo_marks(solved, [vertex for _, vertex in vertices], place, to_photo))
    raise_complaints(
        [
            Complaint("its two rays do not meet in front of the cameras; measure this vertex again", shown, vertex.line)
            for (shown, vertex), xyz in zip(vertices, found.xyz, strict=True)
            if not np.isfinite(xyz).all()
        ]
    )
    features, w, start = [], [], 0
    for _, feature in measured:
        end = start + len(feature.vertices)
        rows = [_vertex(vertex, found, start + n) for n, vertex in enumerate(feature.vertices)]
        features.append(Feature(feature.kind, feature.code, feature.name, tuple(rows)))
        w.append(tuple(found.w[start:end].tolist()))
        start = end
    return tuple(features), tuple(w)


def _to_photo(bundle: BundleState) -> dict[str, PlaneTransformation]:
    """Return by `record_key` what takes measured coordinates to photo mm: pixels of digital frames, others are mm.

    What is measured on film stays true when it is mounted again: plate coordinates would not.
    """
    found = {}
    for key, photo in bundle.records.photos.items():
        is_digital = bundle.records.cameras[record_key(photo.camera)].sensor is not None
        if not is_digital:
            found[key] = IDENTITY
        elif key in bundle.interior.to_photo:
            found[key] = bundle.interior.to_photo[key]
    return found


def _unknown_photos(
    vertices: Sequence[tuple[str, StereoVertex]], place: Mapping[str, int], to_photo: Mapping[str, PlaneTransformation]
) -> Iterator[Complaint]:
    for shown, vertex in vertices:
        for name in (vertex.left, vertex.right):
            if record_key(name) not in place:
                text = f"photo {name} is not in the adjustment; name a photo that is, or adjust the block with it"
                yield Complaint(text, shown, vertex.line)
            elif record_key(name) not in to_photo:
                text = f"photo {name} has no valid interior orientation; measure its marks, then run 'orip measure'"
                yield Complaint(text, shown, vertex.line)


def stereo_marks(
    solved: SolvedBlock,
    vertices: Sequence[StereoVertex],
    place: Mapping[str, int],
    to_photo: Mapping[str, PlaneTransformation],
) -> StereoMarks:
    """Return measured vertices in photo coordinates with their a-priori errors.

    Parameters
    ----------
    place : mapping by `record_key`
        Places of photos in the block.
    to_photo : mapping by `record_key`
        From what is measured to photo mm.
    """
    usual = _usual_errors(solved)
    keys = [(record_key(vertex.left), record_key(vertex.right)) for vertex in vertices]
    photos = np.array([[place[key] for key in pair] for pair in keys], dtype=np.int64).reshape(-1, 2)
    xy, error = np.empty((len(vertices), 2, 2)), np.empty((len(vertices), 2, 2))
    for n, (vertex, pair) in enumerate(zip(vertices, keys, strict=True)):
        for side, (key, measured) in enumerate(zip(pair, (vertex.left_xy, vertex.right_xy), strict=True)):
            xy[n, side] = to_photo[key].apply(np.array([measured]))[0]
            scale = np.linalg.norm(to_photo[key].matrix, axis=1)
            error[n, side] = usual[photos[n, side]] if vertex.error is None else vertex.error * scale
    return StereoMarks(photos[:, 0], photos[:, 1], xy, error)


def _usual_errors(solved: SolvedBlock) -> FloatArray:
    """Return the a-priori errors (photos, 2) of the photos' points, mm: the medians."""
    points = solved.block.photo_points
    everywhere = np.median(points.error, axis=0)
    mine = [points.error[points.photo == photo] for photo in range(len(solved.block.photos))]
    return np.array([np.median(errors, axis=0) if len(errors) else everywhere for errors in mine])


def _vertex(measured: StereoVertex, found: Intersected, row: int) -> Vertex:
    x, y, z = found.xyz[row].tolist()
    sx, sy, sz = np.sqrt(np.diag(found.covariance[row])).tolist()
    stereo = Stereo(measured.left, measured.right, float(found.y_parallax[row]))
    return Vertex((x, y, z), (sx, sy, sz), stereo)


def _doubtful(features: Sequence[Feature], w: Sequence[Sequence[float]]) -> Iterator[ProjectWarning]:
    for feature, values in zip(features, w, strict=True):
        wrong = [str(n) for n, value in enumerate(values, start=1) if value > LARGEST_W]
        if wrong:
            text = (
                f"the rays of vertex {', '.join(wrong)} pass by each other by up to {max(values):.1f} standard "
                "deviations; measure again"
            )
            yield ProjectWarning("y-parallax", f"{feature.kind.lower()} {feature.code} {feature.name}", text)
