"""Errors of recognition against what the edges and the noise permit."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest
import recognition_scenes as scenes

from videogrammetry.recognition import RecognitionOptions, recognize

DATA = Path(os.environ.get("VIDEOGRAMMETRY_DATA", "../shared/data"))
CONTRAST = 2700.0
PLAIN = RecognitionOptions(codes="none")
MODEL = RecognitionOptions(codes="none", estimator="model")


def errors(dots, grey, snr, seeds, options=PLAIN):
    """Normalised and absolute errors of the centres and axes over noisy copies."""
    centre, normalised, axes = [], [], []
    for seed in seeds:
        noise = np.random.default_rng(seed).normal(0, CONTRAST / snr, grey.shape)
        targets = recognize(scenes.quantise(grey + noise, np.uint16), options)
        gap = np.hypot(
            *np.moveaxis(np.array([[d.x, d.y] for d in dots])[:, None] - targets.centre_px, -1, 0)
        )
        assert (gap.min(axis=1) < 1).mean() > 0.95, f"seed {seed}"
        for k in np.flatnonzero(gap.min(axis=1) < 1):
            j, dot = gap[k].argmin(), dots[k]
            error = targets.centre_px[j] - [dot.x, dot.y]
            centre.append(error)
            normalised.append(error / targets.sigma_px[j])
            sigma = np.sqrt(np.diag(targets.cov[j])[2:4])
            axes.append((targets.semi_axes_px[j] - [dot.a, dot.b]) / sigma)
    return np.array(centre), np.array(normalised), np.array(axes)


@pytest.mark.parametrize("semi_major_px", [5.0, 10.0])
@pytest.mark.parametrize("snr", [75, 32, 13])
def test_predicted_covariance_is_the_true_one(semi_major_px, snr):
    pitch = int(2 * semi_major_px + 16)
    dots = scenes.grid_of_dots(7, 7, pitch, a=semi_major_px, seed=3)
    grey = scenes.render((pitch * 8,) * 2, dots, white=3000, black=300)
    centre, normalised, axes = errors(dots, grey, snr, seeds=(1, 2, 3))
    # 294 normalised errors: their RMS scatters by 1 / sqrt(2 * 294) = 0.04;
    # the model's own error may be 25 %.
    assert 0.75 - 0.12 < np.sqrt((normalised**2).mean()) < 1.25 + 0.12
    assert 0.65 < np.sqrt((axes**2).mean()) < 1.45
    # Bound for a disc with known edge: sigma_n / C sqrt(2 sigma_e / (sqrt(pi) r)).
    spread = np.sqrt(0.7**2 + 1 / 12)
    radius = np.sqrt(dots[0].a * dots[0].b)
    bound_px = np.sqrt(2 * spread / (np.sqrt(np.pi) * radius)) / snr
    assert np.sqrt((centre**2).mean()) < 1.8 * bound_px
    assert np.abs(centre.mean(axis=0)).max() < 5 * bound_px * 1.8 / np.sqrt(len(centre))


@pytest.mark.parametrize("semi_major_px", [3.6, 8.0, 30.0])
def test_bias_without_noise(semi_major_px):
    pitch = int(2 * semi_major_px + 16)
    dots = scenes.grid_of_dots(4, 4, pitch, a=semi_major_px, seed=5)
    grey = scenes.render((pitch * 5,) * 2, dots, white=3000, black=300, sampling=12)
    targets = recognize(scenes.quantise(grey, np.uint16), PLAIN)
    gap = np.hypot(
        *np.moveaxis(np.array([[d.x, d.y] for d in dots])[:, None] - targets.centre_px, -1, 0)
    )
    # Bilinear interpolation of an edge of spread 0.76 px errs by up to 0.02 px
    # at single places; over a contour of 20 and more it averages.
    assert np.sqrt((gap.min(axis=1) ** 2 / 2).mean()) < 0.02 / np.sqrt(20) * 1.5
    order = gap.argmin(axis=1)
    axes = targets.semi_axes_px[order] - [[d.a, d.b] for d in dots]
    assert np.abs(axes).max() < 0.04


@pytest.mark.parametrize("semi_major_px", [3.2, 5.0, 10.0])
@pytest.mark.parametrize("snr", [75, 13])
def test_the_model_is_nearer_to_the_bound(semi_major_px, snr):
    pitch = int(2 * semi_major_px + 16)
    dots = scenes.grid_of_dots(7, 7, pitch, a=semi_major_px, aspect=0.95, seed=3)
    grey = scenes.render((pitch * 8,) * 2, dots, white=3000, black=300)
    centre, normalised, axes = errors(dots, grey, snr, seeds=(1, 2, 3), options=MODEL)
    # The scatter of an RMS of 294 errors is 0.04; the covariance may be 20 % off.
    assert 0.8 - 0.12 < np.sqrt((normalised**2).mean()) < 1.2 + 0.12
    assert 0.65 < np.sqrt((axes**2).mean()) < 1.45
    spread = np.sqrt(0.7**2 + 1 / 12)
    bound_px = np.sqrt(2 * spread / (np.sqrt(np.pi) * np.sqrt(dots[0].a * dots[0].b))) / snr
    # The closed form is 2 to 10 % above the bound; unknown light and a window that
    # keeps clear of rings, more so around small dots, take the rest: measured 1.21.
    assert np.sqrt((centre**2).mean()) < (1.4 if semi_major_px < 4 else 1.25) * bound_px


@pytest.mark.parametrize("semi_major_px", [2.75, 8.0, 30.0])
@pytest.mark.parametrize("polarity", ["white-on-black", "black-on-white"])
def test_bias_of_the_model_without_noise(semi_major_px, polarity):
    pitch = int(2 * semi_major_px + 16)
    dots = scenes.grid_of_dots(4, 4, pitch, a=semi_major_px, aspect=0.93, seed=5)
    grey = scenes.render((pitch * 5,) * 2, dots, white=3000, black=300, sampling=16)
    if polarity == "black-on-white":
        grey = 3300 - grey
    options = RecognitionOptions(codes="none", estimator="model", polarity=polarity)
    targets = recognize(scenes.quantise(grey, np.uint16), options)
    gap = np.hypot(
        *np.moveaxis(np.array([[d.x, d.y] for d in dots])[:, None] - targets.centre_px, -1, 0)
    )
    # The drawing's 16 x 16 points place an edge to 1 / 64 px at single places,
    # around a contour of 17 px and more, two points to the pixel, to 1 / 64 / sqrt(34).
    assert gap.min(axis=1).max() < 3 / 64 / np.sqrt(34) / np.sqrt(2)


@pytest.mark.parametrize("diameter_px", [5.5, 8, 16, 50, 190])
def test_all_sizes_are_found(diameter_px):
    a = diameter_px / 2
    pitch = int(diameter_px + 16)
    dots = scenes.grid_of_dots(3, 3, pitch, a=a, aspect=0.95, seed=1)
    grey = scenes.render((pitch * 4,) * 2, dots, white=3000, black=300, sampling=4)
    grey += np.random.default_rng(2).normal(0, CONTRAST / 50, grey.shape)
    targets = recognize(scenes.quantise(grey, np.uint16), PLAIN)
    assert len(targets) == len(dots)


def _pictures(folder):
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    return pytest.importorskip("cv2"), folder


@pytest.mark.data
@pytest.mark.parametrize("noise", ["S150", "S75", "S75_8bit", "S32", "S13"])
def test_rendered_pictures(noise):
    cv2, folder = _pictures(DATA / "rendered-targets")
    # Mean-gradient rays and an ellipse on these pictures, by another program.
    limit_px = {"S150": 0.0056, "S75": 0.0092, "S75_8bit": 0.0092, "S32": 0.0195, "S13": 0.046}
    squares, found, total = [], 0, 0
    for frame in range(3):
        image = cv2.imread(str(folder / f"frame{frame}_{noise}.png"), cv2.IMREAD_UNCHANGED)
        targets = recognize(image)
        with open(folder / f"frame{frame}_truth.csv") as file:
            truth = list(csv.DictReader(file))
        for row in truth:
            xy = np.array([float(row["ellipse_x_px"]), float(row["ellipse_y_px"])])
            gap = np.hypot(*(targets.centre_px - xy).T)
            total += 1
            if gap.min() < 1:
                found += 1
                squares.append(gap.min() ** 2 / 2)
                identity = int(targets.id[gap.argmin()])
                assert identity in (-1, int(row["id"]) if row["coded"] == "1" else -1)
        assert len(targets) <= len(truth)
    assert found >= 0.98 * total
    assert np.sqrt(np.mean(squares)) < 1.1 * limit_px[noise]


@pytest.mark.data
@pytest.mark.parametrize(
    ("noise", "limit_px"),
    # Figures of the literature's estimator on these pictures, by another program.
    [("S150", 0.0053), ("S75", 0.0074), ("S75_8bit", 0.0074), ("S32", 0.0145), ("S13", 0.040)],
)
def test_the_dual_conic_in_rendered_pictures(noise, limit_px):
    cv2, folder = _pictures(DATA / "rendered-targets")
    error, sigma = [], []
    for frame in range(3):
        image = cv2.imread(str(folder / f"frame{frame}_{noise}.png"), cv2.IMREAD_UNCHANGED)
        targets = recognize(image, RecognitionOptions(estimator="dual-conic"))
        with open(folder / f"frame{frame}_truth.csv") as file:
            for row in csv.DictReader(file):
                xy = np.array([float(row["ellipse_x_px"]), float(row["ellipse_y_px"])])
                nearest = np.hypot(*(targets.centre_px - xy).T).argmin()
                error.append(targets.centre_px[nearest] - xy)
                sigma.append(targets.sigma_px[nearest])
    error, sigma = np.array(error), np.array(sigma)
    assert len(error) == 147
    assert np.sqrt((error**2).mean()) < 1.05 * limit_px
    # Without noise it errs less than what its sigma has for that.
    assert 0.6 < np.sqrt(((error / sigma) ** 2).mean()) < 1.2


@pytest.mark.data
@pytest.mark.parametrize(
    ("noise", "limit_px"),
    # The bound of these dots times what is asked: 2.2, 1.3, 1.3, 1.15, 1.15.
    [("S150", 0.0042), ("S75", 0.0053), ("S75_8bit", 0.0053), ("S32", 0.0113), ("S13", 0.0288)],
)
def test_the_model_in_rendered_pictures(noise, limit_px):
    cv2, folder = _pictures(DATA / "rendered-targets")
    squares = []
    for frame in range(3):
        image = cv2.imread(str(folder / f"frame{frame}_{noise}.png"), cv2.IMREAD_UNCHANGED)
        targets = recognize(image, RecognitionOptions(estimator="model"))
        with open(folder / f"frame{frame}_truth.csv") as file:
            for row in csv.DictReader(file):
                xy = np.array([float(row["ellipse_x_px"]), float(row["ellipse_y_px"])])
                gap = np.hypot(*(targets.centre_px - xy).T).min()
                if gap < 1:
                    squares.append(gap**2 / 2)
    assert len(squares) > 140
    assert np.sqrt(np.mean(squares)) < limit_px


@pytest.mark.data
def test_panel_photographs():
    cv2, folder = _pictures(DATA / "aicon-panel")
    reference = {}
    with open(folder / "coded_elsewhere.csv") as file:
        for row in csv.DictReader(file):
            xy = (float(row["x_px"]), float(row["y_px"]))
            reference.setdefault(row["image"], {})[int(row["id"])] = np.array(xy)
    same = total = 0
    for name, dots in reference.items():
        targets = recognize(cv2.imread(str(folder / f"{name}.tif"), cv2.IMREAD_UNCHANGED))
        mine = {int(i): c for i, c in zip(targets.id, targets.centre_px, strict=True) if i > 0}
        total += len(dots)
        same += sum(i in mine and np.hypot(*(mine[i] - xy)) < 0.3 for i, xy in dots.items())
        for i, xy in mine.items():
            assert 2 <= i <= 74, (name, i)
            for j, other in dots.items():
                assert i == j or np.hypot(*(xy - other)) > 3, (name, i, j)
    assert same >= 0.99 * total
