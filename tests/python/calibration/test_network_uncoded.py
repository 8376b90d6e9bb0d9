"""Un-coded dots of simulated networks: most are found, practically none is false."""

from __future__ import annotations

import time

import numpy as np
import pytest
from network_simulation import INTERIOR, photographs, position_errors

from videogrammetry.calibration.network_start import start_network
from videogrammetry.calibration.network_uncoded import link_uncoded
from videogrammetry.errors import CalibrationError


def judged(linked, truth):
    """Per new point: share of its rays with the identity of the most, that identity, rays."""
    observations = linked.network.observations
    first = truth.num_coded
    result = []
    for point in range(first, len(linked.network.points)):
        identity = truth.identity[observations.point == point]
        values, counts = np.unique(identity, return_counts=True)
        result.append((counts.max() / len(identity), values[counts.argmax()], len(identity)))
    return result


def findable(truth, least=4):
    """Un-coded points that at least four pictures see."""
    seen = np.bincount(truth.identity[truth.identity >= 0], minlength=len(truth.position))
    return np.flatnonzero(seen[truth.num_coded :] >= least) + truth.num_coded


def check(linked, truth, share=0.9):
    points = judged(linked, truth)
    false = [p for p in points if p[0] <= 0.5 or p[1] < truth.num_coded]
    assert not false, false
    found = [identity for _, identity, _ in points]
    assert len(found) == len(set(found)), "a dot became two points"
    wanted = findable(truth)
    assert np.isin(wanted, found).mean() > share, (len(found), len(wanted))
    mixed = sum(round((1 - p[0]) * p[2]) for p in points)
    assert mixed <= 0.01 * sum(p[2] for p in points)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_hundred_dots_on_the_cross(seed):
    network, truth = photographs(
        seed, uncoded=100, gross=0.05, swapped=2, clutter=20, f_start=1.3 * INTERIOR[0]
    )
    linked = link_uncoded(start_network(network).network)
    check(linked, truth)
    names = linked.network.points.name
    assert names[truth.num_coded] == str(truth.num_coded + 1)
    assert len(set(names)) == len(names)
    report = linked.report
    assert report.new_points == len(names) - truth.num_coded
    open_count = int((linked.network.observations.point < 0).sum())
    assert report.ambiguous + report.single == open_count
    # The new points stand as well as the coded ones.
    errors = position_errors(linked.network, truth)
    assert np.median(errors) < 0.5


def test_clutter_alone_gives_no_points():
    """300 spots at random in every one of 20 pictures: nothing to find, nothing is found."""
    network, truth = photographs(4, uncoded=0, clutter=300, f_start=INTERIOR[0])
    linked = link_uncoded(start_network(network).network)
    assert linked.report.new_points <= 1
    assert len(truth.position) == truth.num_coded


@pytest.mark.slow
def test_hundred_pictures_of_three_hundred_dots_in_a_minute():
    network, truth = photographs(5, count=100, uncoded=600, clutter=20, f_start=INTERIOR[0])
    started = start_network(network)
    begin = time.perf_counter()
    linked = link_uncoded(started.network)
    seconds = time.perf_counter() - begin
    check(linked, truth)
    # (printed, not judged: machines differ)
    print(f"{len(network.observations)} image points linked in {seconds:.1f} s")


def test_poses_are_needed():
    network, _ = photographs(6, count=4, uncoded=10)
    with pytest.raises(CalibrationError, match="with a pose"):
        link_uncoded(network)
