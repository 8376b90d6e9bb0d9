"""``measure`` with several projects that share one rig, followed or on a cluster."""

from __future__ import annotations

import csv

from small_project import write_small_project


def two_sessions(tmp_path):
    path = write_small_project(tmp_path / "a", 30)
    (path.parent / "rig.json").rename(tmp_path / "rig.json")
    if (path.parent / "rig.npz").exists():
        (path.parent / "rig.npz").rename(tmp_path / "rig.npz")
    text = path.read_text().replace("schema = 1\n", 'schema = 1\nrig = "../rig.json"\n')
    path.write_text(text)
    (tmp_path / "b").mkdir()
    recordings = text.replace('sequence = "', 'sequence = "../a/')
    (tmp_path / "b" / "project.toml").write_text(recordings + "[sequence]\nlast = 20\n")


def test_several_projects_with_one_rig(run, tmp_path) -> None:
    two_sessions(tmp_path)
    done = run("measure", "a", "b/project.toml")
    assert (tmp_path / "a" / "measurement.h5").exists()
    assert (tmp_path / "b" / "measurement.h5").exists()
    assert done.stdout.count("8 points, 8 of them in every stage") == 2


def test_one_that_fails_does_not_stop_the_others_and_done_ones_are_passed_over(
    run, tmp_path
) -> None:
    two_sessions(tmp_path)
    (tmp_path / "a" / "c2.mraw").rename(tmp_path / "c2.mraw")
    (tmp_path / "b" / "project.toml").write_text(
        (tmp_path / "b" / "project.toml").read_text().replace("../a/c2", "../c2")
    )
    (tmp_path / "a" / "c2.cihx").rename(tmp_path / "c2.cihx")
    done = run("measure", "a", "b", status=1)
    assert "c2.cihx" in done.stderr
    assert "1 of 2 projects could not be measured" in done.stderr
    assert (tmp_path / "b" / "measurement.h5").exists()
    (tmp_path / "c2.mraw").rename(tmp_path / "a" / "c2.mraw")
    (tmp_path / "c2.cihx").rename(tmp_path / "a" / "c2.cihx")
    again = run("measure", "a", "b")
    assert "b/measurement.h5 is there already: passed over" in again.stderr
    assert (tmp_path / "a" / "measurement.h5").exists()
    one = run("measure", "b", status=1)
    assert "is there already" in one.stderr


def test_follow_prints_lines(run, tmp_path) -> None:
    path = write_small_project(tmp_path / "small", 130)
    done = run("measure", "small", "--follow", "--idle", "0.5", "--live", "-")
    rows = list(csv.DictReader(done.stdout.splitlines()))
    assert len(rows) == 130 * 8
    assert rows[0].keys() >= {"stage", "time_s", "point", "x_mm", "sigma_x_mm", "cameras"}
    assert "longest delay of a stage:" in done.stderr
    assert (path.parent / "measurement.h5").exists()
    run("measure", "small", "--follow", "--idle", "0.5", "--force")
    assert (path.parent / "trajectories.live.csv").read_text() == done.stdout


def test_what_does_not_go_together(run, tmp_path) -> None:
    path = write_small_project(tmp_path / "small", 3)
    for wrong in (["--follow", "--scheduler", "local"], ["--workers", 2], ["--follow", path]):
        run("measure", "small", *wrong, status=2)
