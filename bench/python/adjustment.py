"""Time of a network's adjustment with its complete covariance, and what comes out.

    python bench/python/adjustment.py [--small] [--threads N] [--json FILE]

Two industrial sizes: 115 pictures with 10 000 image points and 1150 unknowns, and ten
times that. The network is the one of the tests (tests/python/network_oracle.py):
one camera with nine free parameters, all points free, one scale bar, datum by inner
constraints, points that start 2 mm off. "processor" is the time of all
threads together, "clock" the time that passed.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
from pathlib import Path

import numpy as np

from videogrammetry.adjustment import AdjustOptions

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "python"))
from network_oracle import network_of, simulate

SIZES = ((115, 150), (1150, 1500))
PER_IMAGE = 87


def clocked(times, name, call):
    clock, processor = time.perf_counter(), time.process_time()
    result = call()
    times[name] = (time.perf_counter() - clock, time.process_time() - processor)
    return result


def measure(num_images, num_points, threads):
    """One size: adjustment, then dispersion and the covariance of all unknowns."""
    truth = simulate(1, num_images=num_images, num_points=num_points, per_image=PER_IMAGE)
    rng = np.random.default_rng(1)
    start = truth.points_mm + rng.normal(0, 2.0, truth.points_mm.shape)
    network = network_of(truth, truth.measured(rng), positions_mm=start)
    length = float(np.linalg.norm(truth.points_mm[0] - truth.points_mm[1]))
    network.set_scale_bars([0], [1], [length], [0.01])
    times: dict[str, tuple[float, float]] = {}
    options = AdjustOptions(num_threads=threads)
    result = clocked(times, "adjust", lambda: network.adjust(options))
    dispersion = clocked(times, "dispersion", lambda: network.dispersion(num_threads=threads))
    cov = clocked(times, "covariance", lambda: dispersion.full_covariance(num_threads=threads))
    point_sigma_mm = np.sqrt(np.trace(cov[-3:, -3:]))
    return {
        "pictures": num_images,
        "image points": len(truth.image),
        "unknowns": result.num_unknowns,
        "redundancy": result.redundancy,
        "sigma0": result.sigma0,
        "rounds": result.rounds,
        "last point's sigma (mm)": float(point_sigma_mm),
        "seconds": times,
        "memory (GB)": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", action="store_true", help="the smaller size only")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    results = []
    for num_images, num_points in SIZES[:1] if arguments.small else SIZES:
        result = measure(num_images, num_points, arguments.threads)
        results.append(result)
        for name, value in result.items():
            if name != "seconds":
                print(f"{name:24} {value:.6g}")
        for name, (clock, processor) in result["seconds"].items():
            print(f"{name:24} {clock:8.2f} s clock {processor:8.2f} s processor")
        print()
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
