"""Workers of a cluster are killed while they measure: is the result the same, and at what cost?

A LocalCluster of some processes measures a rendered project of three cameras; every few seconds
one of the workers gets kill -9. The datasets are compared, byte for byte, with those that
threads give.

    python bench/python/cluster_kills.py [--stages 120000] [--workers 4] [--every 2] [--kills N]
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "python"))

from distributed import Client, LocalCluster
from measured_data import datasets
from small_project import write_small_project

from videogrammetry.pipeline import ClusterRunner, measure_to_file
from videogrammetry.project import Project, read_project


class Killer(threading.Thread):
    """Kills one worker after the other, the next every so many seconds."""

    def __init__(self, cluster: Any, every_s: float, most: int) -> None:
        super().__init__(daemon=True)
        self._cluster, self._every_s, self._most = cluster, every_s, most
        self.ended = threading.Event()
        self.killed = 0

    def run(self) -> None:
        turn = 0
        while self.killed < self._most and not self.ended.wait(self._every_s):
            # Those at work: one that is killed while it begins its nanny gives up.
            named = {info["name"] for info in self._cluster.scheduler_info["workers"].values()}
            there = {name: w for name, w in self._cluster.workers.items() if name in named}
            workers = [w for w in there.values() if getattr(w, "pid", None)]
            if workers:
                pid = workers[turn % len(workers)].pid
                turn += 1
                try:
                    os.kill(pid, signal.SIGKILL)
                    self.killed += 1
                except ProcessLookupError:
                    pass  # it is on its way up again


def measured(project: Project, **options: Any) -> tuple[float, dict[str, bytes]]:
    begun = time.perf_counter()
    measure_to_file(project, **options)
    took = time.perf_counter() - begun
    found = datasets(project.measurement_path)
    project.measurement_path.unlink()
    return took, found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stages", type=int, default=120000)
    parser.add_argument("--workers", type=int, default=4)
    parser.add_argument("--every", type=float, default=2.0, help="seconds between kills")
    parser.add_argument("--kills", type=int, default=sys.maxsize, help="no more than so many")
    parser.add_argument("--folder", type=Path, help="where the project is made")
    args = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory(dir=args.folder) as folder:
        project = read_project(write_small_project(Path(folder) / "kills", args.stages))
        took, expected = measured(project, num_threads=2)
        rows.append(("2 threads", took, 0, True))
        for kills in (False, True):
            with LocalCluster(
                n_workers=args.workers,
                threads_per_worker=1,
                dashboard_address=None,
                memory_limit=0,
                silence_logs="CRITICAL",
            ) as cluster:
                killer = Killer(cluster, args.every, args.kills)
                if kills:
                    killer.start()
                with Client(cluster) as client:
                    took, found = measured(project, run=ClusterRunner(client=client))
                killer.ended.set()
                if kills:
                    killer.join()
            name = f"{args.workers} workers" + (f", one killed every {args.every:g} s" * kills)
            rows.append((name, took, killer.killed, found == expected))
    print(f"{args.stages} stages of 3 cameras of 192x128 px, {len(expected)} datasets")
    print(f"{'measured by':40} {'s':>7} {'stages/s':>9} {'kills':>6}  datasets the same")
    for name, took, killed, same in rows:
        print(f"{name:40} {took:7.1f} {args.stages / took:9.0f} {killed:6d}  {same}")
    return 0 if all(same for *_, same in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
