"""Codes in rendered pictures: tilt, noise, other families, things in the way."""

import sys
from pathlib import Path

import numpy as np
import pytest
import recognition_scenes as scenes

from videogrammetry.recognition import RING_STATUS, RecognitionOptions, code_family, recognize
from videogrammetry.recognition.recognize import recognize as recognize_one

sys.path.insert(0, str(Path(__file__).parents[3] / "bench" / "accuracy"))
import codes_rendered

STATUS = {name: number for number, name in enumerate(RING_STATUS)}


@pytest.mark.parametrize("name", codes_rendered.FAMILIES)
@pytest.mark.parametrize("seed", [21, 22])
def test_rendered_codes_are_read_and_none_is_wrong(name, seed):
    rows = []
    for index in range(8):
        rows += codes_rendered.frame((name, index, seed, "local-canny", False))[0]
    wrong = [r for r in rows if r[7] and r[4] != "hidden alike"]
    assert not wrong, f"{name}, seed {seed}: {wrong}"
    coded = [r for r in rows if r[4] == "coded" and r[1] >= 32 and r[2] <= 45 and r[3] >= 10]
    read = sum(bool(r[6]) for r in coded)
    # At least 97 % of many; of n at that rate, a fifth standard deviation below.
    least = 0.97 * len(coded) - 5 * np.sqrt(0.97 * 0.03 * len(coded))
    assert len(coded) > 15, f"{name}, seed {seed}"
    assert read >= least, f"{name}, seed {seed}: {read} of {len(coded)}"
    given = np.array([r[8] for r in rows if r[6]])
    assert (given >= 0.999).all()
    assert (given <= 1).all()
    assert all(np.isnan(r[8]) for r in rows if r[5] and not r[6] and not r[7])


def ring(code, *, bits=14, tilt=0.0, psf=0.7, noise=2.0):
    dot = scenes.Dot(70.3, 71.7, 11, 11 * np.cos(tilt), 0.5, scenes.code_bits(code, bits), turn=0.4)
    return scenes.render((142, 142), [dot], psf=psf, noise=noise, seed=3)


@pytest.mark.parametrize("degrees", [0, 30, 45, 60])
def test_confidence_stands_beside_an_id(degrees):
    family = code_family("schneider-14")
    image = scenes.quantise(ring(family.codes[123], tilt=np.radians(degrees)))
    targets = recognize(image)
    assert targets.id.tolist() == [124]
    assert 0.999 <= targets.id_confidence[0] <= 1
    other = recognize(image, RecognitionOptions(codes="metashape-14"))
    assert other.id.tolist() == [-1]
    assert np.isnan(other.id_confidence).all()
    assert np.isnan(targets.select([0, 0]).id_confidence).sum() == 0


def test_what_hides_a_part_of_the_ring_takes_the_id():
    family = code_family("schneider-14")
    clean = ring(family.codes[123])
    y, x = np.mgrid[:142, :142]
    statuses = set()
    for turn in np.arange(0, 2 * np.pi, 0.21):
        at = 70.3 + 2.5 * 11 * np.cos(turn), 71.7 + 2.5 * 11 * np.sin(turn)
        grey = np.where(np.hypot(x - at[0], y - at[1]) < 8, 90.0, clean)
        targets = recognize(scenes.quantise(grey))
        near = np.hypot(*(targets.centre_px - [70.3, 71.7]).T) < 2
        assert near.sum() == 1
        assert targets.id[near].tolist() == [-1], turn
        statuses.add(int(targets.ring_status[near][0]))
    assert statuses <= {STATUS["ring unclear"], STATUS["edges off"]}


def test_a_family_is_not_checked_anew_for_every_picture():
    assert recognize is recognize_one
    family = code_family("schneider-20")
    image = np.full((64, 64), 20, np.uint8)
    core = family.core
    recognize(image, family=family)
    assert family.core is core
