"""Identities over stages: swaps, lost and split tracks, and time a stage, per scenario.

    .venv/bin/python bench/accuracy/tracking.py [--seeds N] [--only WORD]

Positions with known identity go through the tracker. *swapped*: numbers that stood at
two points, at each for three of its stages in a row or more (where two points meet within
their noise, which is which is not known at that stage and does not matter); *wrong*: points
at stages whose number is not that which their point has at most stages; *split*: numbers
beyond one a point, over all points; *lost*: points whose main number stands at less than half
of the stages that
saw them; *unsure*: links below 4.6 log odds (100 to 1). Time: the median
stage of ``Tracker.add`` in processor time, the least of the seeds.

``--peer`` adds a plain linker to flow and cloud: every track where its last two positions put it,
scipy's ``linear_sum_assignment`` of the squared distances within two thirds of the mean spacing,
tracks given up after three stages without a point.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from videogrammetry.recognition import code_family
from videogrammetry.rendering.scenes.tyre import tyre_scene
from videogrammetry.tracking import Tracker

FIRST_FREE = 1000


@dataclass
class Scenario:
    """(S, N, 3) true places, NaN where a point is not there; sigma; share occluded; codes."""

    place: np.ndarray
    sigma_mm: float = 0.05
    occluded: float = 0.1
    code: np.ndarray | None = None
    read: float = 1.0


def smooth_noise(rng, stages, shape, period):
    """Sums of sines of unit variance whose periods are `period` stages and some more."""
    t = np.arange(stages)[(...,) + (None,) * len(shape)]
    total = np.zeros((stages, *shape))
    for factor in (1.0, 1.37, 2.21):
        total += np.sin(2 * np.pi * (t / (period * factor) + rng.uniform(size=shape)))
    return total / np.sqrt(1.5)


def crossing(rng, points=200, stages=1000, period=100.0, amplitude=120.0, size=700.0, flat=False):
    """Pairs that swing about a common place and meet there again and again, exactly."""
    pairs = points // 2
    middle = rng.uniform(0, size, (pairs, 3)) + amplitude * smooth_noise(
        rng, stages, (pairs, 3), 3 * period
    )
    t = np.arange(stages)[:, None, None]
    pace = period * rng.uniform(0.8, 1.3, (1, pairs, 1))
    direction = rng.normal(size=(1, pairs, 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    phase = rng.uniform(0, np.pi, (1, pairs, 1))
    half = 0.5 * amplitude * direction * np.sin(2 * np.pi * t / pace + phase)
    place = np.concatenate([middle + half, middle - half], axis=1)
    if flat:
        place[..., 2] = 0
    return place


def cloud(rng, points, stages, period, amplitude, size):
    """Points that swing each for itself."""
    return rng.uniform(0, size, (points, 3)) + amplitude * smooth_noise(
        rng, stages, (points, 3), period
    )


def flow(rng, points=1000, stages=60, share=1 / 3, disorder=0.0):
    """Particles in a vortex that is `share` of the spacing a stage fast at its rim.

    ``disorder``: this share of the velocity is each particle's own. Who leaves the
    cube comes in on the other side as another particle.
    """
    spacing = 10.0
    size = spacing * points ** (1 / 3)
    place = rng.uniform(0, size, (points, 3))
    own = rng.normal(size=(points, 3))
    own /= np.linalg.norm(own, axis=1, keepdims=True)
    turn = 2.0 * share * spacing / size  # rad a stage
    ways = [np.full((points, stages, 3), np.nan)]
    row = np.arange(points)
    tables, start = ways, row.copy()
    for s in range(stages):
        for k, (table, r) in enumerate(zip(start // points, start % points, strict=True)):
            while table >= len(tables):
                tables.append(np.full((points, stages, 3), np.nan))
            tables[table][r, s] = place[k]
        off = place - size / 2
        velocity = turn * np.stack([-off[:, 1], off[:, 0], 0.3 * off[:, 0]], axis=1)
        place = place + (1 - disorder) * velocity + disorder * share * spacing * own
        out = ((place < 0) | (place > size)).any(axis=1)
        place = place % size
        start[out] += points
    every = np.concatenate(tables).transpose(1, 0, 2)
    return every[:, np.isfinite(every[..., 0]).any(axis=0)]


def tyre(rng, read):
    """The paper's tyre, 18 coded points; a ring is read with the probability ``read``."""
    scene = tyre_scene(code_family("schneider-14"))
    target = scene.marks.is_target
    place = np.stack([scene.place(scene.time_s(s)).centre_mm[target] for s in range(1, 201)])
    code = np.arange(1, place.shape[1] + 1) if read > 0 else None
    return Scenario(place, occluded=0.05, code=code, read=read)


@dataclass
class PlainLinks:
    """What the plain linker says of a stage; it revises nothing."""

    number: np.ndarray
    log_odds: np.ndarray

    def revise(self, numbers, log_odds):
        pass


class PlainLinker:
    """Nearest to where the last two positions lead, all at once; gaps of up to three stages."""

    def __init__(self, reach_mm):
        self._reach_mm = reach_mm
        self._next = FIRST_FREE
        self._number = np.empty(0, int)
        self._place = np.empty((0, 3))
        self._velocity = np.empty((0, 3))
        self._missed = np.empty(0, int)

    def add(self, code, position, cov):
        """Number the points of a stage."""
        expected = self._place + self._velocity
        number = np.full(len(position), -1, np.int32)
        cost = ((expected[:, None] - position[None]) ** 2).sum(axis=2)
        most = self._reach_mm**2
        track, row = linear_sum_assignment(np.minimum(cost, most))
        near = cost[track, row] < most
        track, row = track[near], row[near]
        number[row] = self._number[track]
        self._velocity[track] = position[row] - self._place[track]
        lost = np.ones(len(expected), bool)
        lost[track] = False
        self._place = expected
        self._place[track] = position[row]
        self._missed[track] = 0
        self._missed[lost] += 1
        fresh = np.flatnonzero(number < 0)
        number[fresh] = self._next + np.arange(len(fresh))
        self._next += len(fresh)
        kept = self._missed <= 3
        self._number = np.r_[self._number[kept], number[fresh]]
        self._place = np.r_[self._place[kept], position[fresh]]
        self._velocity = np.r_[self._velocity[kept], np.zeros((len(fresh), 3))]
        self._missed = np.r_[self._missed[kept], np.zeros(len(fresh), int)]
        return PlainLinks(number, np.full(len(number), np.nan))


def plain_linker(scenario):
    """For a scenario, by the mean spacing of its first stage."""
    place = scenario.place[0][np.isfinite(scenario.place[0][:, 0])]
    volume = np.prod(np.ptp(place, axis=0))
    return PlainLinker(2 / 3 * (volume / len(place)) ** (1 / 3))


def play(scenario, seed, tracker):
    """Run a scenario: the true index and the number of every point of every stage."""
    rng = np.random.default_rng(seed)
    truth, numbers, odds, spent = [], [], [], []
    for place in scenario.place:
        there = np.isfinite(place[:, 0]) & (rng.uniform(size=len(place)) >= scenario.occluded)
        order = rng.permutation(np.flatnonzero(there))
        code = np.full(len(order), -1, np.int32)
        if scenario.code is not None:
            read = rng.uniform(size=len(order)) < scenario.read
            code = np.where(read, scenario.code[order], -1).astype(np.int32)
        position = place[order] + rng.normal(0, scenario.sigma_mm, (len(order), 3))
        cov = np.tile(scenario.sigma_mm**2 * np.eye(3), (len(order), 1, 1))
        begin = time.process_time()
        links = tracker.add(code, position, cov)
        spent.append(time.process_time() - begin)
        links.revise(numbers, odds)
        truth.append(order)
        numbers.append(links.number)
        odds.append(links.log_odds)
    return truth, numbers, odds, float(np.median(spent))


def runs(truth, numbers):
    """For every number the points that it stood at for three of its stages in a row or more."""
    points: dict[int, list] = {}
    for who, what in zip(truth, numbers, strict=True):
        for p, n in zip(who.tolist(), what.tolist(), strict=True):
            points.setdefault(n, []).append(p)
    return [
        {a for a, b, c in zip(p, p[1:], p[2:], strict=False) if a == b == c}
        for p in points.values()
    ]


def judge(truth, numbers, odds):
    """swapped, wrong, split, lost, unsure of a run."""
    by_point: dict[int, Counter] = {}
    for who, what in zip(truth, numbers, strict=True):
        assert len(set(what.tolist())) == len(what)
        for p, n in zip(who.tolist(), what.tolist(), strict=True):
            by_point.setdefault(p, Counter())[n] += 1
    swapped = sum(len(held) > 1 for held in runs(truth, numbers))
    main = {p: c.most_common(1)[0] for p, c in by_point.items()}
    wrong = sum(sum(c.values()) - main[p][1] for p, c in by_point.items())
    lost = sum(main[p][1] < 0.5 * sum(c.values()) for p, c in by_point.items())
    split = len(set(np.concatenate(numbers).tolist())) - len(by_point)
    every = np.concatenate(odds)
    return swapped, wrong, split, lost, int((every < 4.6).sum())


SCENARIOS = {
    "tyre, coded": lambda rng: tyre(rng, 1.0),
    "tyre, half of the rings read": lambda rng: tyre(rng, 0.5),
    "tyre, un-coded": lambda rng: tyre(rng, 0.0),
    "crossing 200 x 1000": lambda rng: Scenario(crossing(rng)),
    "crossing 200 x 1000, fast": lambda rng: Scenario(crossing(rng, period=40.0)),
    "crossing 200 x 1000, slow": lambda rng: Scenario(crossing(rng, period=300.0)),
    "crossing 200 x 1000, dense": lambda rng: Scenario(crossing(rng, size=350.0)),
    "crossing 200 x 1000, flat": lambda rng: Scenario(crossing(rng, flat=True)),
    "crossing 200 x 1000, 30 %": lambda rng: Scenario(crossing(rng), occluded=0.3),
    "cloud 50 x 1000": lambda rng: Scenario(cloud(rng, 50, 1000, 100.0, 60.0, 500.0)),
    "cloud 1000 x 100": lambda rng: Scenario(cloud(rng, 1000, 100, 100.0, 60.0, 1000.0)),
    "cloud 5000 x 30": lambda rng: Scenario(cloud(rng, 5000, 30, 100.0, 60.0, 2000.0)),
    "flow 1000, spacing/3": lambda rng: Scenario(flow(rng), occluded=0.0),
    "flow 1000, spacing/3, own 50 %": lambda rng: Scenario(flow(rng, disorder=0.5), occluded=0.0),
    "flow 1000, spacing/3, 5 % unseen": lambda rng: Scenario(flow(rng), occluded=0.05),
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--only", default="")
    parser.add_argument("--peer", action="store_true", help="a plain linker beside ours")
    arguments = parser.parse_args()
    print(f"{'scenario':34} {'points':>7} {'stages':>6} {'swapped':>7} {'wrong':>6} {'split':>6}"
          f" {'lost':>5} {'unsure':>6} {'us a stage':>10}")  # fmt: skip
    for name, make in SCENARIOS.items():
        if arguments.only not in name:
            continue
        linkers = {name: lambda scenario: Tracker(FIRST_FREE)}
        if arguments.peer and name.startswith(("flow", "cloud 50 ", "cloud 1000")):
            linkers["  plain linker (scipy)"] = plain_linker
        for label, linker in linkers.items():
            total, least = np.zeros(5, int), np.inf
            for seed in range(1, arguments.seeds + 1):
                scenario = make(np.random.default_rng(seed))
                *run, spent = play(scenario, seed, linker(scenario))
                total += judge(*run)
                least = min(least, spent)
            stages, points = scenario.place.shape[:2]
            print(f"{label:34} {points:7} {stages:6} {total[0]:7} {total[1]:6} {total[2]:6}"
                  f" {total[3]:5} {total[4]:6} {1e6 * least:10.1f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
