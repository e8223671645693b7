"""What is looked for and tried where a block does not fit, the most likely first.

The order decides between two mistakes that explain a block equally. A mistake has a line here, and `checks` one for its
signs before the adjustment; what it is, is said where it is found (`declare`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes.camera_values import (
    distortion_of_lens,
    distortion_sign,
    other_principal_distance,
    other_principal_point,
    principal_point_sign,
    square_pixels,
    unequal_axes,
)
from orip.mistakes.control.contradicting_control import released_control
from orip.mistakes.control.free_network import control_of_free_network
from orip.mistakes.control.reduced_control import reduced_control
from orip.mistakes.control.seen_control import misread_control_points
from orip.mistakes.doubted_observations import (
    down_weighted_share,
    is_in_the_picture,
    photos_by_misfit,
    points_by_misfit,
)
from orip.mistakes.exchanged_photos import another_flight, exchanged_photos, other_cameras
from orip.mistakes.ground_systems import control_axes, control_units, mirrored_control
from orip.mistakes.hypothesis import Fit, Hypothesis, Misfit, Readjuster, fit_of_adjustment, is_good
from orip.mistakes.left_out_photos import misread_beside, misread_photos
from orip.mistakes.marks.shifted_points import shifted_points
from orip.mistakes.other_units import angle_units, control_error_units, direction_units, measurement_precision_units
from orip.mistakes.photo_coordinates import mirrored_photos, reduced_pictures
from orip.mistakes.rigs.contradicting_rigs import contradicting_rigs
from orip.mistakes.stations.doubted_camera import camera_instead_of_stations
from orip.mistakes.stations.heights_apart import heights_apart
from orip.mistakes.stations.misread_angles import misread_angles
from orip.mistakes.stations.misread_antennas import along_the_flight, misread_antennas
from orip.mistakes.stations.misread_positions import misread_places, other_heights
from orip.mistakes.stations.off_alike import one_strip_off
from orip.mistakes.stations.strips import moved_stations
from orip.mistakes.stations.two_lenses import two_lenses
from orip.records.block import Block
from orip.records.results.solution import Solution
from orip.structs import replace

SIGNS_IN_RESULT: tuple[Callable[[Misfit], list[ProjectWarning]], ...] = (
    contradicting_rigs,
    reduced_control,
    shifted_points,
    misread_control_points,
    misread_angles,
    misread_places,
    misread_antennas,
    two_lenses,
    camera_instead_of_stations,
    other_heights,
    heights_apart,
    along_the_flight,
    one_strip_off,
)
"""What is wrong with rigs, films, control or stations, from where the block has them; the first that is found is told.

All positions or angles of a file come before photos of another lens, which may make them appear wrong.
"""

_MOST_DIRECTIONS = 0.5
_MUCH_CONTROL = 0.2
"""Part of the directions, and of the control coordinates, that loses weight where not only single ones are wrong."""

_MANY_STATIONS = 0.3
"""Part of the coordinates or angles of stations that loses weight where they are not those of their photos."""

_PHOTOS, _CONTROL_POINTS = 2, 3
"""Most photos and control points that are tried one by one, those that fit worst first."""

_LEFT_OUT = 8
"""Most photos that are left out one by one."""

_MANY_PHOTOS, _LEFT_OUT_OF_MANY = 12, 3
"""Of more photos, where nothing fits, so few are left out: the search for preliminary values is repeated each time, and
one photo hardly keeps all others from being oriented."""


def hypotheses_of_misfit(
    solution: Solution, solved: SolvedBlock, given: Fit, started: Block, readjuster: Readjuster
) -> Iterator[Hypothesis]:
    """Yield what may be the reason that a block does not fit.

    Parameters
    ----------
    solved : SolvedBlock
        The adjustment that it comes from.
    given : Fit
        How its observations fit.
    started : Block
        The block with its starting values.
    """
    block = readjuster.block
    # cameras and directions hardly influence the preliminary orientations: those found before are used again
    oriented = replace(block, photo_orientation=started.photo_orientation)
    fits = is_good(given)
    if down_weighted_share(solution, "station") > _MANY_STATIONS or (block.stations and _has_failed(solution)):
        yield from moved_stations(block)
    if not fits:
        yield from reduced_pictures(block)
        yield from measurement_precision_units(block)
        turned = down_weighted_share(solution, "attitude") > _MANY_STATIONS
        if readjuster.is_oriented and (turned or _has_failed(solution)):
            yield from mirrored_photos(block)
            yield from exchanged_photos(block)
            yield from angle_units(block)
            yield from control_axes(block)
            yield from control_units(block)
        yield from other_cameras(block, photos_by_misfit(given)[:_PHOTOS])
        yield from _of_cameras(oriented)
        yield from misread_photos(readjuster, photos_by_misfit(given)[:_LEFT_OUT], solved)
        yield from control_of_free_network(readjuster)
    if not readjuster.is_oriented and down_weighted_share(solution, "control") > _MUCH_CONTROL:
        yield from mirrored_control(block)
    if down_weighted_share(solution, "direction") > _MOST_DIRECTIONS:
        yield from direction_units(oriented)
    if not fits:
        yield from released_control(block, _worst_constant_control(block, given))


def _has_failed(solution: Solution) -> bool:
    return solution.status == "not_converged" or is_in_the_picture(solution)


def hypotheses_of_failure(
    readjuster: Readjuster, not_oriented: Sequence[str], rest: SolvedBlock | None
) -> Iterator[Hypothesis]:
    """Yield what may be the reason that a block cannot be adjusted at all, or not with all of its photos.

    Where most photos fit without the others, what concerns all of them is right, and these are compared with them.

    Parameters
    ----------
    not_oriented : sequence of str
        Photos for which no preliminary orientation was found.
    rest : SolvedBlock or None
        The adjustment without the photos that could not be oriented, if there is one.
    """
    block = readjuster.block
    yield from another_flight(block, not_oriented)
    if rest is not None and 2 * len(rest.block.photos) >= len(block.photos) and is_good(fit_of_adjustment(rest)):
        yield from other_cameras(block, not_oriented if len(not_oriented) <= _PHOTOS else ())
        yield from misread_beside(block, rest)
        return
    yield from moved_stations(block)
    yield from measurement_precision_units(block)
    yield from control_error_units(block)
    yield from reduced_pictures(block)
    yield from other_cameras(block, not_oriented if len(not_oriented) <= _PHOTOS else ())
    names = dict.fromkeys([*not_oriented, *(photo.name for photo in block.photos)])
    most = _LEFT_OUT if len(block.photos) <= _MANY_PHOTOS else _LEFT_OUT_OF_MANY
    yield from misread_photos(readjuster, list(names)[:most])
    yield from control_of_free_network(readjuster)
    yield from _of_cameras(block)


_OF_A_CAMERA = (
    square_pixels,
    distortion_sign,
    principal_point_sign,
    other_principal_point,
    distortion_of_lens,
    other_principal_distance,
    unequal_axes,
)
"""Each of all cameras, before the next one: the distortion of one may make up for the principal point of another."""


def _of_cameras(block: Block) -> Iterator[Hypothesis]:
    for hypotheses in _OF_A_CAMERA:
        for row in range(len(block.cameras)):
            yield from hypotheses(block, row)


def _worst_constant_control(block: Block, given: Fit) -> list[str]:
    """Return the constant control points whose photo points fit worst."""
    constant = {name for name, held in zip(block.point_names, block.constant_points, strict=True) if held.any()}
    return [name for name in points_by_misfit(given) if name in constant][:_CONTROL_POINTS]
