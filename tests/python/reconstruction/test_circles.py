"""Circles' centres instead of ellipses': what the correction does, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from videogrammetry.geometry import ellipse_centres, rotation_from_vector
from videogrammetry.reconstruction import CIRCLE_STATUS, TRIANGULATION_STATUS, Circles, triangulate
from videogrammetry.types import RigCamera, RigData

CENTRE = np.array([30.0, -20.0, 1000.0])
NORMAL = np.array([0.5, 0.3, -np.sqrt(1 - 0.34)])
DIAMETER_MM = 16.0


def pair() -> RigData:
    cameras = {}
    for name, turn in (("a", -0.3), ("b", 0.3)):
        rotation = rotation_from_vector([0, turn, 0])
        aim = np.array([0, 0, 1000.0])
        cameras[name] = RigCamera(
            image_size_px=(1024, 1024), interior=np.r_[1900.0, np.zeros(9)], r0_px=400.0,
            rotation=rotation, translation_mm=aim - rotation @ aim,
        )  # fmt: skip
    return RigData(cameras=cameras)


def sightings(rig: RigData) -> tuple[list[int], list[int], np.ndarray, np.ndarray]:
    xy = [
        ellipse_centres(
            c, [c.rotation @ CENTRE + c.translation_mm], [c.rotation @ NORMAL], DIAMETER_MM
        )[0]
        for c in rig.cameras.values()
    ]
    return [0, 2], [0, 1], np.array(xy), np.tile([2.5e-5, 0, 2.5e-5], (2, 1))


def test_a_known_normal_gives_the_circles_centre() -> None:
    rig = pair()
    seen = sightings(rig)
    plain = triangulate(rig, *seen)["position_mm"][0]
    result = triangulate(rig, *seen, circles=Circles(diameter_mm=16.0, normal=[NORMAL]))
    assert CIRCLE_STATUS[result["circle"][0]] == "normal given"
    # 1e-9 px of the iterations' end on 0.5 mm a pixel, a decade left.
    assert np.linalg.norm(result["position_mm"][0] - CENTRE) < 1e-8
    assert np.linalg.norm(plain - CENTRE) > 0.01
    assert (np.linalg.norm(result["offset_px"], axis=1) > 0.02).all()


def test_an_uncertain_normal_adds_to_the_covariance() -> None:
    rig = pair()
    seen = sightings(rig)
    spread = 0.3**2 * (np.eye(3) - np.outer(NORMAL, NORMAL))
    exact = triangulate(rig, *seen, circles=Circles(diameter_mm=16.0, normal=[NORMAL]))
    loose = triangulate(
        rig, *seen, circles=Circles(diameter_mm=16.0, normal=[NORMAL], normal_cov=[spread])
    )
    more = loose["cov_image_mm2"][0] - exact["cov_image_mm2"][0]
    values = np.linalg.eigvalsh(more)
    assert values[-1] > 0
    # Rounding of a difference of matrices of that size.
    assert values[0] > -1e-12 * np.trace(loose["cov_image_mm2"][0])


def test_thickness_without_a_normal_is_refused_and_said() -> None:
    rig = pair()
    result = triangulate(rig, *sightings(rig), circles=Circles(diameter_mm=16.0, thickness_mm=1.0))
    assert TRIANGULATION_STATUS[result["status"][0]] == "no normal"
    assert np.isnan(result["position_mm"]).all()
    moved = triangulate(rig, *sightings(rig), circles=Circles(normal=[-NORMAL], thickness_mm=1.0))
    plain = triangulate(rig, *sightings(rig))
    shift = moved["position_mm"][0] - plain["position_mm"][0]
    assert shift == pytest.approx(-NORMAL, abs=1e-9)


@pytest.mark.parametrize(
    ("circles", "said"),
    [
        (Circles(diameter_mm=-1.0), "positive"),
        (Circles(diameter_mm=16.0, normal=[[0.0, 0, 0]]), "unit length"),
        (Circles(diameter_mm=16.0, thickness_mm=np.nan), "thickness_mm"),
        (Circles(diameter_mm=16.0, normal=np.zeros((2, 3))), "normal: expected"),
    ],
)
def test_bad_circles_are_named(circles: Circles, said: str) -> None:
    rig = pair()
    with pytest.raises(ValueError, match=said):
        triangulate(rig, *sightings(rig), circles=circles)
