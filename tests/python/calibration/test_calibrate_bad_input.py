"""Bad input of ``calibrate``: refused in one paragraph, or solved with the cause named."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from videogrammetry.cli.main import main

SIZE = (1024, 1024)


@dataclass
class Tables:
    """A project as its files hold it; cases spoil it."""

    rows: dict[str, list[list]]
    target: list[list]
    size: tuple[int, int] = SIZE
    calibration: list[str] = field(default_factory=lambda: ["r0_px = 400.0"])
    camera: str = ""
    bars: list[str] = field(default_factory=list)

    def write(self, folder):
        text = ["schema = 1"]
        for name, rows in self.rows.items():
            lines = ["image,point,x_px,y_px,sigma_px"]
            lines += [f"{i},{p},{x},{y},{s}" for i, p, x, y, s in rows]
            (folder / f"{name}.csv").write_text("\n".join(lines) + "\n")
            text += [f"[cameras.{name}]", f'calibration = "{name}.csv"']
            text += [f"image_size_px = [{self.size[0]}, {self.size[1]}]", self.camera]
        lines = ["id,x_mm,y_mm,z_mm"] + [",".join(map(str, row)) for row in self.target]
        (folder / "target.csv").write_text("\n".join(lines) + "\n")
        text += ["[calibration]", 'target = "target.csv"', *self.calibration]
        if self.bars:
            lines = ["point_a,point_b,length_mm,sigma_mm", *self.bars]
            (folder / "bars.csv").write_text("\n".join(lines) + "\n")
            text.append('scale_bars = "bars.csv"')
        (folder / "project.toml").write_text("\n".join(text) + "\n")

    def change(self, change, *cameras):
        """Every row (image, point, x, y, sigma) of some cameras (all) through a function."""
        for name in cameras or self.rows:
            self.rows[name] = [list(change(*row)) for row in self.rows[name]]

    def length(self, a, b):
        at = {row[0]: np.array(row[1:]) for row in self.target}
        return float(np.linalg.norm(at[a] - at[b]))


def tables_of(scene):
    rows = {
        camera.name: [
            [f"s{f.stage:02d}", int(n), round(float(x), 5), round(float(y), 5), 0.02]
            for f in camera.frames
            for n, (x, y) in zip(f.id, f.xy_px, strict=True)
        ]
        for camera in scene.frames
    }
    points = zip(scene.target.id, scene.target.position_mm.round(4), strict=True)
    return Tables(rows, [[int(n), *map(float, place)] for n, place in points])


def same_pose(t, seed=0):
    """The first stage's pictures again and again, with new noise."""
    rng = np.random.default_rng(seed)
    for name, rows in t.rows.items():
        first = [row for row in rows if row[0] == "s01"]
        t.rows[name] = [
            [f"s{k:02d}", n, x + rng.normal(0, 0.02), y + rng.normal(0, 0.02), s]
            for k in range(1, 9)
            for _, n, x, y, s in first
        ]


def three_points(t):
    t.rows = {name: [row for row in rows if row[1] <= 3] for name, rows in t.rows.items()}


def few_points(t):
    t.rows = {
        name: [row for row in rows if row[1] <= 4 and row[0] <= "s02"]
        for name, rows in t.rows.items()
    }


def third_camera_apart(t):
    t.change(lambda image, *rest: ("x" + image, *rest), "c3")


def two_groups(t):
    t.change(lambda image, *rest: ("x" + image, *rest), "c3", "c4")


def nan_place(t):
    t.rows["c1"][5][2] = "nan"


def nan_target(t):
    t.target[3][2] = "NaN"


def twice_observed(t):
    t.rows["c1"].append(list(t.rows["c1"][0]))


def twice_listed(t):
    t.target.append([t.target[0][0], 1.0, 2.0, 3.0])


def same_file(t):
    t.rows["c2"] = t.rows["c1"]


def copied_pictures(t):
    first = [row for row in t.rows["c1"] if row[0] == "s01"]
    t.rows["c1"] += [["s99", *row[1:]] for row in first]


def half_size(t):
    t.size = (512, 512)


def sides_exchanged(t):
    t.size = (600, 1400)


def x_for_y(t):
    t.change(lambda image, n, x, y, s: (image, n, y, x, s))


def one_mirrored(t):
    t.change(lambda image, n, x, y, s: (image, n, SIZE[0] - 1 - x, y, s), "c2")


def cameras_exchanged(t):
    early = {name: [r for r in t.rows[name] if r[0] < "s05"] for name in t.rows}
    late = {name: [r for r in t.rows[name] if r[0] >= "s05"] for name in t.rows}
    t.rows["c1"], t.rows["c2"] = early["c1"] + late["c2"], early["c2"] + late["c1"]


def one_stage_late(t):
    t.change(lambda image, *rest: (f"s{int(image[1:]) + 1:02d}", *rest), "c2")


def other_numbers(t):
    t.target = [[row[0] + 1000, *row[1:]] for row in t.target]


def other_places(t):
    order = np.random.default_rng(5).permutation(len(t.target))
    t.target = [[row[0], *t.target[k][1:]] for row, k in zip(t.target, order, strict=True)]


def on_a_line(t):
    t.target = [[row[0], 50.0 * k, 0.0, 0.0] for k, row in enumerate(t.target)]


def names_by_camera(t):
    t.change(lambda image, *rest: ("right_" + image, *rest), "c2")


def no_rows(t):
    t.rows["c2"] = []


def zero_sigma(t):
    t.rows["c1"][0][4] = 0.0


def bar_of_nothing(t):
    t.bars = ["1,999,100.0,0.01"]


def bar_to_itself(t):
    t.bars = ["1,1,100.0,0.01"]


REFUSED = [
    (three_points, {}, "c1: none of its 8 pictures shows 4 known points", "(the most: 3)"),
    (few_points, {}, "too few observations: 32 image coordinates in 4 pictures"),
    (third_camera_apart, {"num_cameras": 3}, "no picture of camera c3 (xs01", "synchronous"),
    (two_groups, {"num_cameras": 4}, "c3, c4 cannot be tied to c1, c2", "stages 9-16"),
    (nan_place, {}, "c1.csv, line 7, column x_px", "not a finite number"),
    (nan_target, {}, "target.csv, line 5, column y_mm", "not a finite number"),
    (twice_observed, {}, "observation s01 1 stands twice, first on line 2"),
    (twice_listed, {}, "column id: point 1 stands twice"),
    (same_file, {}, "s01 of camera c2 and s01 of camera c1 hold the same 40 targets"),
    (copied_pictures, {}, "picture s99 of camera c1 and s01 of camera c1", "given twice"),
    (half_size, {}, "lie outside its pictures of 512 x 512 px", "image_size_px"),
    (sides_exchanged, {}, "outside its pictures of 600 x 1400 px", "width and height"),
    (x_for_y, {}, "mirror image of the target fits"),
    (one_mirrored, {}, "c2: the mirror image of the target fits"),
    (cameras_exchanged, {}, "c2 relative to c1 is not constant", "only 4 of 8"),
    (one_stage_late, {}, "c2 relative to c1 is not constant", "not synchronous"),
    (other_numbers, {}, "none of the 640 numbers", "target file is another one"),
    (other_places, {}, "no picture's points fit the target"),
    (on_a_line, {}, "along one line of the target"),
    (same_pose, {"relief_mm": 0.0}, "8 pictures show the flat target in one attitude", "tilt"),
    (names_by_camera, {}, "no picture of camera c1", "equal names"),
    (no_rows, {}, "c2.csv: the table has a header but no row"),
    (zero_sigma, {}, "c1.csv, line 2, column sigma_px", "positive sigma"),
    (bar_of_nothing, {}, "the scale bar 1-999 ends in point 999"),
    (bar_to_itself, {}, "bars.csv, line 2", "same point"),
]


@pytest.mark.parametrize("case", REFUSED, ids=lambda case: case[0].__name__)
def test_refused_in_one_paragraph(scene, tmp_path, capsys, case):
    spoil, how, *words = case
    tables = tables_of(scene(seed=3, **how))
    spoil(tables)
    tables.write(tmp_path)
    assert main(["calibrate", str(tmp_path)]) == 1
    said = capsys.readouterr().err.splitlines()
    [message] = [line for line in said if line.startswith("videogrammetry calibrate: ")]
    for word in words:
        assert word in message, message
    assert not list(tmp_path.glob("rig*"))


def in_metres(t):
    t.target = [[row[0], *(v / 1000 for v in row[1:])] for row in t.target]


def half_pixels(t):
    t.change(lambda image, n, x, y, s: (image, n, x / 2, y / 2, s))


def one_place(t):
    t.target.append([99, *t.target[0][1:]])


def one_long_bar(t):
    t.bars = [f"1,2,{t.length(1, 2):.4f},0.05", f"3,4,{1.02 * t.length(3, 4):.4f},0.05"]


def long_bars(t):
    t.bars = [f"{a},{a + 1},{1.02 * t.length(a, a + 1):.4f},0.05" for a in (1, 3)]


def stretched(t):
    t.target = [[n, x, 1.01 * y, z] for n, x, y, z in t.target]


def held_f(t):
    t.camera = 'start = {f_px = 2200.0}\nfree = ["x0", "y0", "A1"]'


def all_held(t):
    t.camera = "start = {f_px = 2000.0}\nfree = []"


def camera_turned(t):
    t.change(lambda im, n, x, y, s: (im, n, x + (3.0 if im >= "s05" else 0.0), y, s), "c2")


def some_other_numbers(t):
    t.target = [[row[0] + (1000 if row[0] > 6 else 0), *row[1:]] for row in t.target]


def five_points(t):
    t.rows = {
        name: [row for row in rows if row[1] <= 5 and row[0] <= "s02"]
        for name, rows in t.rows.items()
    }
    t.camera = 'start = {f_px = 2000.0}\nfree = ["f", "x0", "y0"]'


WARNED = [
    (in_metres, {}, "the target is 1.01 mm across", "metres"),
    (half_pixels, {}, "the principal point lies", "pictures of another size"),
    (one_place, {}, "points 1 and 99 lie at one place"),
    (one_long_bar, {}, "the known length 3-4", "is left out"),
    (long_bars, {}, "all 2 known lengths contradict", "1.96% longer"),
    (stretched, {}, "the target's points deviate"),
    (held_f, {}, "its points scatter by 0."),
    (all_held, {}, "a parameter held at a wrong value"),
    (camera_turned, {}, "a camera that moved"),
    (some_other_numbers, {}, "numbers read are not in the target's point list"),
    (five_points, {}, "the redundancy is", "is known to"),
]


@pytest.mark.parametrize("case", WARNED, ids=lambda case: case[0].__name__)
def test_solved_with_a_warning_that_names_the_cause(scene, tmp_path, capsys, case):
    spoil, how, *words = case
    tables = tables_of(scene(seed=3, **how))
    spoil(tables)
    tables.write(tmp_path)
    assert main(["calibrate", str(tmp_path)]) == 0
    warnings = [x for x in capsys.readouterr().err.splitlines() if x.startswith("warning: ")]
    assert any(all(word in w for word in words) for w in warnings), warnings
    assert (tmp_path / "rig.json").exists()


def nothing(t):
    del t


@pytest.mark.parametrize(
    ("spoil", "how"),
    [
        (nothing, {}),
        (nothing, {"num_cameras": 1}),
        (nothing, {"relief_mm": 0.0}),
        (nothing, {"relief_mm": 0.0, "tilt_rad": 0.25}),
        (same_pose, {}),
    ],
)
def test_what_is_in_order_warns_of_nothing(scene, tmp_path, capsys, spoil, how):
    """One camera, a plane, little tilt, a target in space that never moved: solved, and rightly."""
    s = scene(seed=3, **how)
    tables = tables_of(s)
    spoil(tables)
    tables.write(tmp_path)
    assert main(["calibrate", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert "warning: " not in err
    f_px, sigma = (float(v) for v in out.splitlines()[1].split()[5:7])
    assert abs(f_px - 2000.0) < 4.0 * sigma
