"""Free networks, scale bars, a-priori positions: covariance, outliers, what is named."""

from __future__ import annotations

import numpy as np
import pytest
from network_oracle import CAMERA, FREE, network_of, simulate

from videogrammetry.adjustment import CAMERA_UNKNOWNS, AdjustOptions, Network
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import project, rotation_from_vector
from videogrammetry.types import RigCamera

PLAIN = AdjustOptions(critical_value=0, estimate_floor=False, robust_start=False)
SNOOPING = AdjustOptions(critical_value=4.5, estimate_floor=False)


def distance(points, a, b):
    return float(np.linalg.norm(points[a] - points[b]))


def helmert(points, scale):
    """(3N, 6 or 7): how the points move with the frame."""
    columns = []
    for x, y, z in points:
        turn = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
        block = np.hstack([np.eye(3), turn, np.array([[x], [y], [z]])])
        columns.append(block if scale else block[:, :6])
    return np.vstack(columns)


def bars_of(points, pairs, rng=None, sigma_mm=0.02):
    a, b = np.array(pairs).T
    length = np.array([distance(points, i, j) for i, j in pairs])
    if rng is not None:
        length = length + rng.normal(0, sigma_mm, len(length))
    return a, b, length, np.full(len(length), sigma_mm)


def chi_square_bound(degrees, draws):
    """4 standard deviations of the mean of ``draws`` chi-squares: exceeded once in 16 000."""
    return 4 * np.sqrt(2 * degrees / draws)


def place(dispersion):
    """Places of all points' coordinates among the unknowns."""
    return (dispersion.point_index[:, None] + np.arange(3)).ravel()


@pytest.mark.parametrize("with_bars", [False, True])
def test_inner_constraints_are_the_least_trace_of_all_datums(with_bars):
    truth = simulate(1, num_images=8, num_points=15)
    network = network_of(truth, truth.measured(np.random.default_rng(1)))
    if with_bars:
        network.set_scale_bars(*bars_of(truth.points_mm, [(0, 1), (2, 5)]))
    network.adjust(PLAIN)
    dispersion = network.dispersion()
    assert dispersion.datum_size == (6 if with_bars else 7)
    cov = dispersion.full_covariance()
    points = place(dispersion)
    inner = cov[np.ix_(points, points)]
    g = helmert(network.positions_mm, scale=not with_bars)
    # G'x = 0: no variance along the datum (the trace's rounding 1e-16 times cond 1e7).
    assert np.abs(g.T @ inner).max() < 1e-9 * np.sqrt(np.trace(inner)) * np.abs(g).max()
    # Any other datum, S = I - G (E'G)^-1 E' with three random points' weights, has more.
    rng = np.random.default_rng(2)
    for _ in range(5):
        e = rng.uniform(0, 1, (len(g), 1)) * g
        other = np.eye(len(g)) - g @ np.linalg.solve(e.T @ g, e.T)
        assert np.trace(other @ inner @ other.T) > np.trace(inner)


def test_the_frame_stays_at_the_start_values():
    truth = simulate(2, num_images=8, num_points=15)
    rng = np.random.default_rng(2)
    start = truth.points_mm + rng.normal(0, 1.0, truth.points_mm.shape)
    network = network_of(truth, truth.measured(rng), positions_mm=start)
    network.adjust(AdjustOptions(critical_value=0))
    found = network.positions_mm
    # The best similarity's residuals have no part along the datum: G'(x - start) = 0.
    g = helmert(found, scale=True)
    g /= np.linalg.norm(g, axis=0)
    assert np.abs(g.T @ (found - start).ravel()).max() < 1e-8
    assert np.abs(found - start).max() > 0.5


def errors_of(network, truth, dispersion):
    error = np.zeros(len(dispersion.unknown_names))
    values = network.camera_unknowns(0)
    true_values = np.r_[truth.camera.interior, 0, 0]
    for k, u in enumerate(dispersion.camera_index[0]):
        if u >= 0:
            error[u] = values[k] - true_values[k]
    error[place(dispersion)] = (network.positions_mm - truth.points_mm).ravel()
    return error


def test_covariance_of_a_free_network_by_monte_carlo():
    """Normalised squared error of the camera and of the points' own distances."""
    truth = simulate(3, num_images=8, num_points=14)
    draws, sums, count = 40, [], 0
    for draw in range(draws):
        rng = np.random.default_rng(100 + draw)
        network = network_of(truth, truth.measured(rng))
        network.set_scale_bars(*bars_of(truth.points_mm, [(0, 1), (2, 5), (3, 7)], rng))
        assert network.adjust(PLAIN).converged
        dispersion = network.dispersion()
        camera = [u for u in dispersion.camera_index[0] if u >= 0]
        unknowns = np.r_[camera, place(dispersion)]
        cov = dispersion.covariance(unknowns)
        scale = 1 / np.sqrt(np.diag(cov))
        error = errors_of(network, truth, dispersion)[unknowns] * scale
        # The covariance is singular in the six datum directions: pseudo-inverse.
        values, vectors = np.linalg.eigh(cov * np.outer(scale, scale))
        assert values[5] < 1e-9 < 1e-7 < values[6]
        sums.append(np.sum((vectors[:, 6:].T @ error) ** 2 / values[6:]))
        count = len(unknowns) - 6
    assert abs(np.mean(sums) - count) < chi_square_bound(count, draws)


@pytest.mark.parametrize("singular", [False, True])
def test_prior_block_by_monte_carlo(singular):
    """A later network on the points of an earlier one, with their full covariance."""
    truth = simulate(4, num_images=8, num_points=12)
    rows = np.arange(6)
    first = network_of(truth, truth.exact_px)
    first.set_scale_bars(*bars_of(truth.points_mm, [(0, 1), (2, 5)]))
    cov = first.dispersion().point_covariance(rows) if not singular else None
    if singular:
        cov = 100 * first.dispersion().point_covariance(np.arange(12))
        rows = np.arange(12)
    else:
        cov = 100 * cov + 1e-4 * np.eye(len(cov))
    draws, sums, degrees = 40, [], 0
    kind = np.full(12, "free", dtype=object)
    kind[rows] = "weighted"
    lower = np.linalg.svd(cov)
    root = lower.U * np.sqrt(lower.S)
    for draw in range(draws):
        rng = np.random.default_rng(200 + draw)
        mean = truth.points_mm[rows] + (root @ rng.normal(size=len(cov))).reshape(-1, 3)
        network = network_of(
            truth,
            truth.measured(rng),
            kind=list(kind),
            datum="weighted",
            cov_mm2=np.tile(np.eye(3), (12, 1, 1)),
        )
        network.set_point_prior(rows, mean, cov)
        result = network.adjust(PLAIN)
        dispersion = network.dispersion()
        camera = [u for u in dispersion.camera_index[0] if u >= 0]
        error = errors_of(network, truth, dispersion)[camera]
        sums.append(error @ np.linalg.solve(dispersion.covariance(camera), error))
        degrees = len(camera)
        assert result.points.used[rows].all()
    assert abs(np.mean(sums) - degrees) < chi_square_bound(degrees, draws)


def test_a_singular_prior_gives_what_its_network_would_together():
    """Camera from pictures 1-8 and 9-16 at once = from the second with the first as prior."""
    truth = simulate(5, num_images=16, num_points=12)
    pixels = truth.measured(np.random.default_rng(5))
    early = truth.image < 8

    def part(mask, **options):
        network = network_of(truth, pixels, free=(), **options)
        cov = np.tile([truth.sigma_px**2, 0, truth.sigma_px**2], (len(mask), 1))
        network.set_observations(truth.image, truth.point, pixels, cov, used=mask)
        return network

    bars = bars_of(truth.points_mm, [(0, 1), (2, 5)])
    whole, first = part(np.ones(len(early), bool)), part(early)
    for network in (whole, first):
        network.set_scale_bars(*bars)
    whole.adjust(PLAIN)
    first.adjust(PLAIN)
    second = part(~early, kind="weighted", datum="weighted", cov_mm2=np.tile(np.eye(3), (12, 1, 1)))
    second.set_point_prior(
        np.arange(12), first.positions_mm, first.dispersion().point_covariance(np.arange(12))
    )
    second.adjust(PLAIN)
    # Distances do not depend on the datum. Linearisation: 1e-3 of a standard deviation (10 um).
    pairs = [(i, j) for i in range(12) for j in range(i)]
    difference = [
        distance(whole.positions_mm, *pair) - distance(second.positions_mm, *pair) for pair in pairs
    ]
    moved = [
        distance(whole.positions_mm, *pair) - distance(first.positions_mm, *pair) for pair in pairs
    ]
    assert np.abs(difference).max() < 1e-4
    assert np.abs(moved).max() > 0.01


def test_a_wrong_bar_is_found_and_bends_nothing():
    truth = simulate(6, num_images=12, num_points=30)
    for seed in range(3):
        rng = np.random.default_rng(300 + seed)
        network = network_of(truth, truth.measured(rng))
        a, b, length, sigma = bars_of(truth.points_mm, [(0, 1), (2, 5), (6, 9), (11, 14)], rng)
        length[2] *= 1.1
        network.set_scale_bars(a, b, length, sigma)
        result = network.adjust(SNOOPING)
        assert result.scale_bars.used.tolist() == [True, True, False, True], seed
        assert result.used.all(), seed
        # 1 um/mm would be the scale's error if three bars of 0.02 mm in 500 mm were all:
        # sigma 2e-5; five of them.
        sizes = [distance(network.positions_mm, 3 * k, 3 * k + 1) for k in range(9)]
        true = [distance(truth.points_mm, 3 * k, 3 * k + 1) for k in range(9)]
        assert abs(np.mean(np.divide(sizes, true)) - 1) < 3e-4, seed
        assert 0.2 < result.sigma0 < 1.3, seed


def test_a_wrong_a_priori_position_is_found():
    truth = simulate(7, num_images=12, num_points=20)
    for seed, block in ((0, False), (1, True)):
        rng = np.random.default_rng(400 + seed)
        prior = truth.points_mm + rng.normal(0, 0.05, truth.points_mm.shape)
        prior[4] += [0.7, -0.5, 0.6]
        cov = np.tile(0.05**2 * np.eye(3), (20, 1, 1))
        network = network_of(
            truth,
            truth.measured(rng),
            kind="weighted",
            datum="weighted",
            cov_mm2=cov,
            positions_mm=prior,
        )
        if block:
            full = 0.05**2 * (0.7 * np.eye(60) + 0.3 * np.kron(np.ones((20, 20)), np.eye(3)))
            network.set_point_prior(np.arange(20), prior, full)
        result = network.adjust(SNOOPING)
        assert result.points.used.tolist() == [i != 4 for i in range(20)], block
        assert result.used.all()
        assert np.linalg.norm(network.positions_mm[4] - truth.points_mm[4]) < 0.3
        of_pictures = result.redundancy_numbers[result.used].sum()
        assert abs(of_pictures + result.point_redundancy - result.redundancy) < 1e-4
        # Variance factor: 1 within four of its own standard deviations.
        assert abs(result.point_factor - 1) < 4 * np.sqrt(2 / result.point_redundancy)


def test_planted_image_outliers_are_found():
    truth = simulate(8, num_images=15, num_points=40)
    rng = np.random.default_rng(8)
    pixels = truth.measured(rng)
    wrong = rng.choice(len(pixels), 12, replace=False)
    pixels[wrong] += rng.choice([-1, 1], (12, 2)) * rng.uniform(0.8, 200, (12, 2))
    for baarda in (True, False):
        network = network_of(truth, pixels)
        result = network.adjust(
            AdjustOptions(critical_value=4.5, estimate_floor=False, baarda=baarda)
        )
        assert set(np.flatnonzero(~result.used)) == set(wrong), baarda


def test_pope_needs_no_true_standard_deviations():
    """Stated three times too small: Baarda's test rejects good points, Pope's none."""
    truth = simulate(9, num_images=12, num_points=30)
    pixels = truth.exact_px + np.random.default_rng(9).normal(0, 0.15, truth.exact_px.shape)
    rejected = {}
    for baarda in (True, False):
        network = network_of(truth, pixels)
        options = AdjustOptions(
            critical_value=4.5, estimate_floor=False, robust_start=False, baarda=baarda
        )
        result = network.adjust(options)
        rejected[baarda] = int(np.sum(~result.used))
    assert rejected[True] > 20
    assert rejected[False] == 0
    assert abs(result.sigma0 - 3) < 4 * 3 / np.sqrt(2 * result.redundancy)


def test_partial_datum_is_named_and_never_silent():
    truth = simulate(10, num_images=6, num_points=12)
    for datum in ("fixed", "free"):
        kind = ["fixed"] + ["free"] * 11
        network = network_of(truth, truth.exact_px, kind=kind, datum=datum)
        with pytest.raises(CalibrationError, match=r"rank defect.*(picture|point) \d+ [rt]?[xyz]"):
            network.dispersion()
    with pytest.raises(CalibrationError, match="rank defect"):
        network_of(truth, truth.exact_px, datum="weighted").dispersion()
    kind[1:3] = ["fixed"] * 2
    whole = network_of(truth, truth.exact_px, kind=kind, datum="fixed").dispersion()
    assert whole.redundancy == 2 * len(truth.image) - len(whole.unknown_names)
    assert np.all(whole.point_cov_mm2[:3] == 0)


def test_a_point_with_one_ray_is_starved_by_name():
    truth = simulate(11, num_images=8, num_points=15)
    keep = (truth.point != 3) | (truth.image == truth.image[truth.point == 3][0])
    network = network_of(truth, truth.exact_px)
    cov = np.tile([truth.sigma_px**2, 0, truth.sigma_px**2], (len(keep), 1))
    network.set_observations(truth.image, truth.point, truth.exact_px, cov, used=keep)
    result = network.adjust(PLAIN)
    assert np.flatnonzero(result.points.starved).tolist() == [3]
    dispersion = network.dispersion()
    assert np.isnan(dispersion.point_cov_mm2[3]).all()
    assert np.isfinite(np.delete(dispersion.point_cov_mm2, 3, axis=0)).all()


@pytest.mark.parametrize("measured", [True, False])
def test_aspect_and_time_offset_are_estimated(measured):
    """Planted 0.02 and 0.3 of an interval; their errors within four standard deviations."""
    interior = CAMERA.interior.copy()
    camera = RigCamera(
        image_size_px=CAMERA.image_size_px,
        interior=interior,
        r0_px=CAMERA.r0_px,
        rotation=np.eye(3),
        translation_mm=np.zeros(3),
        measured=measured,
    )
    truth = simulate(12, num_images=16, num_points=40, camera=camera)
    rng = np.random.default_rng(12)
    velocity = rng.uniform(-20, 20, truth.exact_px.shape)
    centre_y = camera.interior[2] + 0.5 * (camera.image_size_px[1] - 1)
    pixels = truth.measured(rng)
    pixels[:, 1] = centre_y + (pixels[:, 1] - centre_y) / 1.02
    pixels += 0.3 * velocity
    network = Network()
    # E1 is an affinity as well: of the two only one can be estimated.
    free = (*(name for name in FREE if name != "E1"), "aspect", "time_offset")
    network.add_camera("cam", camera, free=free)
    for i, pose in enumerate(truth.poses):
        network.add_image(str(i), 0, inner=network.add_pose(str(i), *pose))
    network.set_points(np.arange(40), truth.points_mm, kind="free")
    cov = np.tile([truth.sigma_px**2, 0, truth.sigma_px**2], (len(pixels), 1))
    network.set_observations(truth.image, truth.point, pixels, cov, velocity_px=velocity)
    network.set_datum("free")
    result = network.adjust(AdjustOptions(critical_value=0, estimate_floor=False))
    dispersion = network.dispersion()
    values = network.camera_unknowns(0)
    for name, wanted in (("aspect", 0.02), ("time_offset", 0.3)):
        k = CAMERA_UNKNOWNS.index(name)
        u = dispersion.camera_index[0, k]
        assert dispersion.unknown_names[u] == f"cam {name}"
        assert abs(values[k] - wanted) < 4 * np.sqrt(dispersion.covariance([u])[0, 0]), name
        assert dispersion.covariance([u])[0, 0] < 1e-6
    assert abs(result.sigma0 - 1) < 4 / np.sqrt(2 * result.redundancy)


def test_a_poor_start_is_no_obstacle():
    """Poses off by 2 degrees and 30 mm, points by 20 mm, f by 5 %."""
    truth = simulate(13, num_images=10, num_points=25)
    rng = np.random.default_rng(13)
    network = Network()
    start = np.r_[CAMERA.interior[0] * 1.05, np.zeros(9)]
    camera = RigCamera(
        image_size_px=CAMERA.image_size_px,
        interior=start,
        r0_px=CAMERA.r0_px,
        rotation=np.eye(3),
        translation_mm=np.zeros(3),
    )
    network.add_camera("cam", camera, free=FREE)
    for i, (rotation, shift) in enumerate(truth.poses):
        pose = network.add_pose(
            str(i),
            rotation @ rotation_from_vector(0.02 * rng.normal(size=3)),
            shift + rng.normal(0, 30, 3),
        )
        network.add_image(str(i), 0, inner=pose)
    network.set_points(np.arange(25), truth.points_mm + rng.normal(0, 20, (25, 3)), kind="free")
    cov = np.tile([truth.sigma_px**2, 0, truth.sigma_px**2], (len(truth.image), 1))
    network.set_observations(truth.image, truth.point, truth.measured(rng), cov)
    network.set_scale_bars(*bars_of(truth.points_mm, [(0, 1), (2, 5)]))
    network.set_datum("free")
    result = network.adjust(AdjustOptions(critical_value=4.5))
    assert result.converged
    assert result.used.all()
    assert abs(result.sigma0 - 1) < 4 / np.sqrt(2 * result.redundancy)
    assert abs(network.camera_unknowns(0)[0] - CAMERA.interior[0]) < 3


def test_the_simulator_projects_as_the_camera_does():
    truth = simulate(14, num_images=3, num_points=10)
    rotation, shift = truth.poses[1]
    of_second = truth.image == 1
    in_cam = truth.points_mm[truth.point[of_second]] @ rotation.T + shift
    assert np.allclose(project(CAMERA, in_cam), truth.exact_px[of_second])


def test_wrong_input_is_named():
    truth = simulate(15, num_images=3, num_points=10)
    network = network_of(truth, truth.exact_px)
    with pytest.raises(ValueError, match="datum: expected"):
        network.set_datum("loose")
    with pytest.raises(ValueError, match="kind: expected one a point"):
        network.set_points(np.arange(10), truth.points_mm, kind=["free"] * 9)
    with pytest.raises(ValueError, match="not a weighted one"):
        network.set_point_prior([1], truth.points_mm[:1], np.eye(3))
    with pytest.raises(ValueError, match="as many points a and b"):
        network.set_scale_bars([0], [1, 2], [100.0], 0.1)
    network.set_scale_bars([0], [0], [100.0], 0.1)
    with pytest.raises(ValueError, match="two different points"):
        network.adjust(PLAIN)
    with pytest.raises(ValueError, match="free: expected names of f"):
        network.set_free(0, ("focal",))
