"""Rays that other photos contradict are told from those that they confirm, and left out of preliminary values."""

from __future__ import annotations

import re
from itertools import combinations

import numpy as np
import pytest
from monte_carlo.outlier_blocks import outlier_records
from monte_carlo.preliminary_blocks import simulated_records
from monte_carlo.preliminary_records import gathered
from scipy.spatial.transform import Rotation

from orip.geometry.stereo import TwoPhotos
from orip.prelim.chain import preliminary_values
from orip.prelim.confirmed_block import (
    block_without_contradicted_rays,
    confirmed_block,
    confirmed_by_parts,
    excess_of_contradicted,
    has_many_misses,
)
from orip.prelim.confirmed_rays import Votes
from orip.prelim.growing_block import empty_growing_block, misplaced_photos
from orip.prelim.measured_block import measured_block
from orip.prelim.rays import photo_index
from orip.prelim.relative.given_scale import adjusted_at_scale, at_scale
from orip.prelim.relative.orientation import common_point_counts
from orip.prelim.relative.solution import Pairs, solve
from orip.prelim.resection.known_points import FEW_BLUNDERS, MANY_BLUNDERS, fits_beyond_chance
from orip.prelim.routes import by_pairs
from orip.records.names import record_key
from orip.structs import replace


@pytest.mark.parametrize("run", [6, 7], ids=["gross", "near the epipolar line"])
def test_wrong_rays_are_left_out_and_most_right_ones_stay(run):
    records = outlier_records(run)
    measured = measured_block(gathered(records))
    confirmed = confirmed_block(measured)
    assert confirmed is not None
    rays = measured.all_rays
    names = zip(rays.photo.tolist(), rays.point.tolist(), strict=True)
    wrong = np.array([(rays.photos[photo], rays.points[point]) in records.wrong for photo, point in names])
    assert wrong.mean() > 0.05
    # a wrong ray may be confirmed by chance, and a right one may meet wrong ones only
    assert np.mean(confirmed.confirmed[wrong]) < 0.02
    assert np.mean(confirmed.confirmed[~wrong]) > 0.9


def test_parts_of_a_block_tell_right_rays_from_wrong_ones():
    # parts of this block are tied by a few points, of which the right rays contradict wrong ones in threes
    records = outlier_records(187)
    by_threes = confirmed_block(measured_block(gathered(records)))
    by_parts = confirmed_by_parts(by_threes)
    rays = by_parts.all_rays
    names = zip(rays.photo.tolist(), rays.point.tolist(), strict=True)
    wrong = np.array([(rays.photos[photo], rays.points[point]) in records.wrong for photo, point in names])
    # three right rays stay in each point, and a tenth of a millimetre is twenty times the noise: with the photos known
    # each ray can be told
    assert not by_threes.confirmed[~wrong].all()
    assert by_parts.confirmed.tolist() == (~wrong).tolist()


def test_many_rays_of_tracks_miss_each_other_and_few_of_an_ordinary_block():
    tracks, ordinary = outlier_records(6), simulated_records(3, "convergent", largest=12)
    # a pair has twice the wrong rays of a photo
    assert tracks.blunders > 0.05
    assert ordinary.blunders < 0.05
    assert has_many_misses(measured_block(gathered(tracks)))
    assert not has_many_misses(measured_block(gathered(ordinary)))


def test_routes_have_what_has_grown_from_the_rays_that_parts_have_told():
    told = confirmed_by_parts(confirmed_block(measured_block(gathered(outlier_records(6)))))
    grown = dict(told.from_models.blocks)
    assert any(block.oriented.all() for block in grown.values())
    by_pairs(told.grower(), 0)
    assert told.from_models.blocks == grown


def test_the_deviation_of_the_contradicted_part_is_that_of_photos_that_are_wrong_together():
    measured = measured_block(gathered(simulated_records(3, "convergent", largest=12)))
    rays, random = measured.rays, np.random.default_rng(5)
    photos, each, repetitions = 30, 40, 400
    rays = replace(rays, photo=np.repeat(np.arange(photos), each), photos=tuple(map(str, range(photos))))
    found = []
    for _ in range(repetitions):
        votes = Votes(photos * each)
        votes.in_pairs[:, 0] = 1
        # a tenth of the photos has half of its rays contradicted, the others one in fifty
        part = np.where(random.random(photos) < 0.1, 0.5, 0.02)
        votes.in_pairs[:, 1] = random.random(photos * each) > np.repeat(part, each)
        found.append(excess_of_contradicted(rays, votes))
    excess, deviation = np.transpose(found)
    # 10 % of 0.5 and 90 % of 0.02 are 0.068; the mean of 400 is good to a twentieth of the deviation
    assert abs(excess.mean() - 0.038) < 4.0 * excess.std() / np.sqrt(repetitions)
    # the scatter of 400 is good to 1 / sqrt(800), 3.5 %; independent rays would have a quarter of it
    assert 0.85 < np.sqrt(np.mean(deviation**2)) / excess.std() < 1.15
    assert excess.std() > 3.0 * np.sqrt(0.068 * 0.932 / (photos * each))


def test_contradicted_rays_are_counted_in_one_sentence():
    values = preliminary_values(gathered(outlier_records(7)))
    assert all(photo.rotation is not None for photo in values.photos)
    (finding,) = values.findings
    number, total = re.match(r"(\d+) of the (\d+) photo points contradict those of other photos", finding).groups()
    assert 100 < int(number) < 0.4 * int(total)


def test_a_few_wrong_rays_are_left_out_where_no_route_is_enough():
    # 1.7 % of the photo points are wrong: too few for tracks; three photos are off by 10° if all of them count
    records = outlier_records(482)
    block = gathered(records)
    measured = measured_block(block)
    assert confirmed_block(measured) is None
    without = block_without_contradicted_rays(measured)
    rays = measured.all_rays
    names = zip(rays.photo.tolist(), rays.point.tolist(), strict=True)
    wrong = np.array([(rays.photos[photo], rays.points[point]) in records.wrong for photo, point in names])
    # a wrong ray may be confirmed by chance, and a right one may meet wrong ones only
    assert np.mean(without.confirmed[wrong]) < 0.1
    assert np.mean(without.confirmed[~wrong]) > 0.97
    turns = [
        np.degrees((Rotation.from_matrix(photo.rotation).inv() * Rotation.from_matrix(true)).magnitude())
        for photo in preliminary_values(block).photos
        for true in (records.orientations[record_key(photo.name)][1],)
    ]
    assert max(turns) < 1.0


def test_blocks_without_outliers_stay_as_they_are():
    measured = measured_block(gathered(simulated_records(3, "convergent", largest=12)))
    assert confirmed_block(measured) is None


def test_bent_models_are_replaced_by_those_at_the_usual_scale():
    # more than half of the points common to two photos are wrong, most of them near the epipolar lines of other photos
    records = outlier_records(3)
    rays = measured_block(gathered(records)).rays
    index, common = photo_index(rays), common_point_counts(rays)
    turns = []
    for left, right in combinations(range(len(rays.photos)), 2):
        if common[left, right] < 35:
            continue
        rows = index.common_points(left, right)
        pairs = Pairs(*(rays.vectors[part] for part in rows), np.hypot(*(rays.error[part] for part in rows)))
        bent = solve(pairs)
        if bent is None or bent.scale < 10.0 or (found := at_scale(bent, pairs, 1.5)) is None:
            continue
        true = [records.orientations[record_key(rays.photos[photo])][1] for photo in (left, right)]
        relative = Rotation.from_matrix(true[0].T @ true[1])
        turns.append(
            [(relative.inv() * Rotation.from_matrix(one.photos.rotation)).magnitude() for one in (bent, found)]
        )
    assert len(turns) > 5
    before, after = np.degrees(np.median(turns, axis=0))
    # a rotation from some twenty points of 5 µm at C 153 mm is good to minutes; a bent model is off by degrees
    assert after < 0.5
    assert before > 1.0


def test_a_photo_of_tracks_is_added_where_more_than_half_of_its_known_points_are_wrong():
    records = simulated_records(3, "convergent", largest=12)
    measured = measured_block(gathered(records))
    rays, grower = measured.rays, measured.grower()
    true = np.array([records.coordinates[record_key(name)] for name in rays.points])
    random = np.random.default_rng(8)
    seen = random.permutation(measured.index.points[0])
    wrong = seen[: round(0.55 * len(seen))]
    coordinates = true.copy()
    coordinates[wrong] += 0.3 * np.ptp(true, axis=0).max() * random.normal(size=(len(wrong), 3))
    current = replace(empty_growing_block(rays), coordinates=coordinates, deviations=np.zeros_like(true))
    known = np.ones(len(true), dtype=bool)
    assert grower.resection(current, rays, 0, known) is None
    found = replace(grower, blunders=MANY_BLUNDERS).resection(current, rays, 0, known)
    _, rotation = records.orientations[record_key(rays.photos[0])]
    turn = (Rotation.from_matrix(rotation).inv() * Rotation.from_matrix(found.rotation)).magnitude()
    # errors of 5 µm seen from a principal distance of 8 mm and more, by ten right points; a tenfold margin
    assert turn < 0.006


@pytest.mark.parametrize(
    ("blunders", "part", "misplaced"),
    [(FEW_BLUNDERS, 0.15, False), (FEW_BLUNDERS, 0.25, True), (MANY_BLUNDERS, 0.3, False), (MANY_BLUNDERS, 0.4, True)],
)
def test_in_tracks_a_photo_is_in_its_place_with_more_rays_that_do_not_fit(blunders, part, misplaced):
    records = simulated_records(3, "convergent", largest=12)
    rays = measured_block(gathered(records)).rays
    true = [records.orientations[record_key(name)] for name in rays.photos]
    grown = replace(
        empty_growing_block(rays),
        centres=np.array([centre for centre, _ in true]),
        rotations=np.array([rotation for _, rotation in true]),
    )
    lengths = np.ones(len(rays.photo))
    (mine,) = np.nonzero(rays.photo == 0)
    lengths[mine[: round(part * len(mine))]] = 100.0
    assert misplaced_photos(rays, grown, lengths, blunders)[0] == misplaced
    assert not misplaced_photos(rays, grown, lengths, blunders)[1:].any()


def test_points_placed_at_random_give_no_model_at_a_scale():
    random = np.random.default_rng(2)
    n = 40
    vectors = [np.column_stack([random.uniform(-50.0, 50.0, (n, 2)), np.full(n, -100.0)]) for _ in range(2)]
    pairs = Pairs(*vectors, np.full(n, 0.007))
    solution = solve(pairs)
    assert solution is None or solution.by_chance or at_scale(solution, pairs, 1.0) is None


def test_an_orientation_that_is_nearly_right_is_adjusted_to_the_points_that_fit_it():
    random = np.random.default_rng(11)
    n, wrong = 60, 35
    true = TwoPhotos(np.array([0.96, 0.28, 0.0]), Rotation.from_rotvec([0.02, 0.1, -0.05]).as_matrix())
    points = np.column_stack(
        [random.uniform(-2.0, 3.0, n), random.uniform(-2.5, 2.5, n), random.uniform(-6.0, -4.0, n)]
    )
    in_right = (points - true.base) @ true.rotation
    vectors = [-100.0 * part / part[:, 2:] for part in (points, in_right)]
    for part in vectors:
        part[:, :2] += 0.005 * random.normal(size=(n, 2))
    vectors[1][:wrong, :2] += random.choice([-1.0, 1.0], (wrong, 2)) * random.uniform(1.0, 20.0, (wrong, 2))
    pairs = Pairs(*vectors, np.full(n, 0.005 * np.sqrt(2.0)))
    # a tenth of a degree is 0.17 mm in these photos: 25 standard deviations
    start = TwoPhotos(true.base, true.rotation @ Rotation.from_rotvec([0.001, -0.001, 0.001]).as_matrix())
    found = adjusted_at_scale(start, pairs, 1.0)
    assert found is not None
    # 25 points of 5 µm at C 100 mm: some 20 µrad, and a few times that where base and rotation are correlated
    assert Rotation.from_matrix(true.rotation.T @ found.photos.rotation).magnitude() < 3e-4
    assert np.linalg.norm(found.photos.base - true.base) < 3e-3
    assert np.count_nonzero(found.usable[wrong:]) > 0.9 * (n - wrong)
    assert np.count_nonzero(found.usable[:wrong]) < 3
    shuffled = Pairs(pairs.left, random.permutation(pairs.right), pairs.error)
    assert adjusted_at_scale(start, shuffled, 1.0) is None


@pytest.mark.parametrize(("fitting", "beyond"), [(3, False), (5, True), (12, True)])
def test_few_points_that_fit_well_are_beyond_chance(fitting, beyond):
    random = np.random.default_rng(3)
    xy = random.uniform(-50.0, 50.0, (20, 2))
    residuals = np.where(np.arange(20)[:, None] < fitting, 0.005 * random.normal(size=(20, 2)), 10.0)
    assert fits_beyond_chance(xy, residuals, np.arange(20) < fitting) is beyond


def test_many_points_that_fit_badly_are_not_beyond_chance():
    random = np.random.default_rng(4)
    xy, residuals = random.uniform(-50.0, 50.0, (2, 20, 2))
    assert not fits_beyond_chance(xy, residuals, np.arange(20) < 12)
