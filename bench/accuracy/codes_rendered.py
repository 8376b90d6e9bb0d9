"""Codes read in rendered pictures of known truth: how many, and is one of them wrong.

    python bench/accuracy/codes_rendered.py [--targets 400] [--seed 1]
        [--method edge-pair] [--family NAME ...] [--processes 0] [--list]

`--targets` coded targets of every family, among un-coded dots, rings of all other
families, partly hidden rings, mirrored ones (of the user's table alone: Schneider's
and Metashape's rules do not see a direction) and a background of clutter. A
frame has one noise (contrast over the noise's standard deviation at white), PSF,
light, depth and polarity; dots of 8 to 40 px are one size, up to a quarter, in a
frame. `dot` is the diameter before the tilt; the tilt is against the line of sight,
even over the solid angle up to 70 degrees in half of the frames and even in angle
in the others.

`hidden` rings have a disc of another grey before a part of them, `hidden alike` one
that is exactly as black or white as their sticker: where it happens to cover whole
runs of sectors, what is left is a perfect print of another code, and nothing can tell.

Shown, found and read count coded targets that nothing covers. `wrong` counts every
other ID, on whatever it stands. Targets that a hot spot touches are a row of their own,
and dots whose minor axis is below the 5 px that recognition looks for are left out
of the tables of what is read (not of what is wrong). A ring of another family that
is also, line for line, a print of the family looked for is not shown (schneider-8
seen as schneider-16, for one: nothing could tell).
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from functools import cache

import numpy as np

from videogrammetry.recognition import (
    CODE_FAMILIES,
    RING_STATUS,
    CodeFamily,
    RecognitionOptions,
    code_family,
    recognize,
)
from videogrammetry.rendering import Background, Renderer, SceneTargets, Sensor, SpecularSpot
from videogrammetry.rendering.disturbances import Conditions
from videogrammetry.types import RigCamera

F_PX, DISTANCE_MM = 3000.0, 1000.0
NOISES = (13.0, 32.0, 75.0, 150.0)
TILTS = (30.0, 45.0, 60.0, 70.0)
SIZES = (8.0, 10.0, 14.0, 20.0, 40.0)
SMALLEST_PX = 5.0
USERS = "user-13"
COLUMNS = (
    "family",
    "noise",
    "tilt",
    "size",
    "kind",
    "found",
    "right",
    "wrong",
    "confidence",
    "status",
)


@cache
def family_of(name: str) -> CodeFamily:
    if name != USERS:
        return code_family(name)
    # Odd parity (distance 2), and of two mirror images one.
    bits = 13
    codes = sorted(
        {canonical(c, bits) for c in range(1 << bits) if c.bit_count() >= 3 and c.bit_count() % 2}
    )
    codes = [c for c in codes if c < canonical(mirrored(c, bits), bits) and "0" * 7 not in ring(c)]
    return CodeFamily(name=USERS, bits=bits, ring=(1.8, 2.8), codes=tuple(codes))


def ring(code: int) -> str:
    return 2 * f"{code:013b}"


def canonical(code: int, bits: int) -> int:
    mask = (1 << bits) - 1
    return min(((code << i) | (code >> (bits - i))) & mask for i in range(bits))


def mirrored(code: int, bits: int) -> int:
    return int(f"{code:0{bits}b}"[::-1], 2)


FAMILIES = (*(n for n in CODE_FAMILIES if n != "none"), USERS)


def stretched(code: int, bits: int, times: int) -> int:
    return int("".join(b * times for b in f"{code:0{bits}b}"), 2)


def same_print(code: int, other: CodeFamily, family: CodeFamily) -> bool:
    """Whether a code of another family is printed like one of this family."""
    if other.ring != family.ring:
        return False
    fine = int(np.lcm(other.bits, family.bits))
    mine = printed(family, fine)
    return canonical(stretched(code, other.bits, fine // other.bits), fine) in mine


@cache
def printed(family: CodeFamily, fine: int) -> frozenset[int]:
    times = fine // family.bits
    return frozenset(canonical(stretched(c, family.bits, times), fine) for c in family.codes)


def cells_of(rng, family):
    """What stands in a frame: (kind, id, bits, code, ring) of every cell, shuffled."""
    n = len(family)
    coded, hidden = min(24, max(n - 3, 1)), min(3, n)
    ids = rng.choice(n, min(n, coded + hidden + 4), replace=False)
    cells = []
    for k, i in enumerate(ids):
        code = family.codes[i]
        kind = "coded" if k < coded else "hidden" if k < coded + hidden else "mirrored"
        if kind == "mirrored":
            if family.name != USERS:
                continue
            code = mirrored(code, family.bits)
        cells.append((kind, int(i) + 1, family.bits, code, family.ring))
    cells += [("plain", -1, 0, 0, family.ring)] * 4
    for name in rng.choice([f for f in FAMILIES if f != family.name], 5):
        other = family_of(str(name))
        code = int(rng.choice(other.codes))
        if not same_print(code, other, family):
            cells.append((f"of {name}", -1, other.bits, code, other.ring))
    rng.shuffle(cells)
    return cells


def sightline_pose(rng, pixel, middle, tilt):
    """Centre on the line of sight, normal tilted against it, the first sector's direction."""
    sight = np.array([*((pixel - middle) / F_PX), 1.0])
    centre = DISTANCE_MM * sight
    sight /= np.linalg.norm(sight)
    aside = np.cross(sight, rng.normal(size=3))
    aside /= np.linalg.norm(aside)
    normal = -sight * np.cos(tilt) + aside * np.sin(tilt)
    x_axis = np.cross(normal, rng.normal(size=3))
    return centre, normal, x_axis / np.linalg.norm(x_axis)


def scene(rng, cells, white_on_black):
    """Targets (cells first, then patches), their tilts and sizes, and the picture's size."""
    smallest = float(np.exp(rng.uniform(np.log(8.0), np.log(32.0))))
    size = smallest * rng.uniform(1.0, 1.25, len(cells))
    pitch = 1.25 * 3.5 * 1.25 * smallest + 6
    columns = int(np.ceil(np.sqrt(1.4 * len(cells))))
    rows = -(-len(cells) // columns)
    shape = (int(columns * pitch) + 8, int(rows * pitch) + 8)
    middle = (np.array(shape) - 1) / 2
    over_solid_angle = rng.uniform() < 0.5
    low = np.cos(np.radians(TILTS[-1]))
    tilts, poses = [], []
    for k in range(len(cells)):
        tilt = (
            np.arccos(rng.uniform(low, 1)) if over_solid_angle else np.radians(rng.uniform(0, 70))
        )
        pixel = pitch * (np.array([k % columns, k // columns]) + 0.5) + 4 + rng.uniform(-1, 1, 2)
        tilts.append(np.degrees(tilt))
        poses.append(sightline_pose(rng, pixel, middle, tilt))
    centre, normal, x_axis = (np.array([p[i] for p in poses]) for i in range(3))
    values = {
        "centre_mm": centre, "normal": normal, "x_axis": x_axis,
        "radius_mm": size / 2 * DISTANCE_MM / F_PX,
        "id": np.array([c[1] for c in cells]), "num_bits": np.array([c[2] for c in cells]),
        "code": np.array([c[3] for c in cells]), "ring": np.array([c[4] for c in cells]),
    }  # fmt: skip
    values["sticker_mm"] = 1.25 * values["ring"][:, 1] * values["radius_mm"]
    values["white"] = np.full(len(cells), 0.8)
    values["black"] = np.full(len(cells), 0.06)
    patches = [patch(rng, values, k) for k, c in enumerate(cells) if c[0] == "hidden"]
    for key in values:
        values[key] = np.concatenate([values[key], *([p[key]] for p in patches)])
    targets = SceneTargets(**values, square=False, white_on_black=white_on_black)
    return targets, np.array(tilts), size, shape


def patch(rng, values, k):
    """A disc before a part of the k-th target's ring that leaves its dot free."""
    radius = values["radius_mm"][k]
    along = values["x_axis"][k]
    across = np.cross(values["normal"][k], along)
    angle, reach = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 1.4)
    aside = (1.3 + reach + rng.uniform(0, 0.6)) * radius
    centre = values["centre_mm"][k] + aside * (np.cos(angle) * along + np.sin(angle) * across)
    grey = rng.choice([0.06, 0.3, 0.8])
    return {
        "centre_mm": centre * 0.999 + 0.002 * radius * values["normal"][k],
        "normal": values["normal"][k], "x_axis": along, "radius_mm": 0.2 * reach * radius,
        "id": -1, "num_bits": 0, "code": 0, "ring": np.array([2.0, 3.0]),
        "sticker_mm": reach * radius, "white": grey, "black": grey,
    }  # fmt: skip


def renderer_of(rng, shape, noise):
    width, height = shape
    camera = RigCamera(
        image_size_px=shape,
        interior=np.r_[F_PX, np.zeros(9)],
        r0_px=width / 3,
        rotation=np.eye(3),
        translation_mm=np.zeros(3),
    )
    conditions = Conditions(
        bit_depth=int(rng.choice([8, 12])),
        contrast_noise=noise,
        psf_sigma_px=float(rng.uniform(0.6, 1.2)),
        gradient=tuple(rng.uniform(-0.3, 0.3, 2)),
    )
    spots = tuple(
        SpecularSpot(
            x_px=float(rng.uniform(0, width)),
            y_px=float(rng.uniform(0, height)),
            sigma_px=float(rng.uniform(1.5, 8)),
            amplitude=float(rng.uniform(0.1, 0.8)),
        )
        for _ in range(rng.integers(0, 3))
    )
    background = Background(level=0.35, clutter=0.3, seed=int(rng.integers(2**31)), spots=spots)
    sensor: Sensor = conditions.sensor()
    return Renderer(
        camera, background=background, illumination=conditions.illumination(), sensor=sensor
    )


def frame(task):
    """Rows of COLUMNS: the cells of one frame, and IDs at no cell."""
    name, index, seed, method, number_of = task
    rng = np.random.default_rng([seed, FAMILIES.index(name), index])
    family = family_of(name)
    noise = float(NOISES[index % len(NOISES)])
    cells = cells_of(rng, family)
    white_on_black = bool(rng.uniform() < 0.8)
    scenery, tilts, size, shape = scene(rng, cells, white_on_black)
    renderer = renderer_of(rng, shape, noise)
    picture = renderer.render(scenery, seed=index)
    polarity = "white-on-black" if white_on_black else "black-on-white"
    start = time.perf_counter()
    targets = recognize(
        picture.image, RecognitionOptions(polarity=polarity, method=method), family=family
    )
    seconds = time.perf_counter() - start
    gap = np.linalg.norm(
        targets.centre_px[None] - picture.truth.centre_px[: len(cells), None], axis=-1
    )
    rows, used = [], set()
    hidden = [k for k, c in enumerate(cells) if c[0] == "hidden"]
    covers = dict(zip(hidden, scenery.white[len(cells) :], strict=True))
    confidence = getattr(targets, "id_confidence", np.ones(len(targets)))
    for k, cell in enumerate(cells):
        minor = picture.truth.semi_axes_px[k, 1]
        at = int(gap[k].argmin()) if len(targets) else -1
        found = at >= 0 and gap[k, at] < 0.5 * minor
        kind = cell[0]
        if kind == "hidden" and covers[k] == (0.06 if white_on_black else 0.8):
            kind = "hidden alike"
        if kind == "coded":
            kind = "small" if 2 * minor < SMALLEST_PX + 0.5 else kind
            kind = "spot" if touched(renderer, picture.truth, k, cell[4][1]) else kind
        read = int(targets.id[at]) if found else -1
        if found:
            used.add(at)
        own = cell[0] in ("coded", "hidden")
        rows.append((name, noise, tilts[k], size[k], kind, found, own and read == cell[1],
                     read > 0 and not (own and read == cell[1]),
                     confidence[at] if found else np.nan,
                     int(targets.ring_status[at]) if found else -1))  # fmt: skip
        if rows[-1][7] and number_of:
            what = f"{name} frame {index} S{noise:.0f} {kind} {cell[1:]} read {read}"
            where = (
                f"dot {size[k]:.1f} px, tilt {tilts[k]:.0f}, at {targets.centre_px[at].round(1)}"
            )
            print(f"wrong: {what}, {where}", flush=True)
    for at in set(np.flatnonzero(targets.id > 0).tolist()) - used:
        rows.append((name, noise, 0.0, 0.0, "elsewhere", True, False, True, confidence[at], 0))
        if number_of:
            print(f"wrong: {name} frame {index} S{noise:.0f} elsewhere: {targets.id[at]} at "
                  f"{targets.centre_px[at].round(1)}, axes {targets.semi_axes_px[at].round(1)}",
                  flush=True)  # fmt: skip
    return rows, seconds


def touched(renderer, truth, k, outer) -> bool:
    reach = outer * truth.semi_axes_px[k, 0]
    x, y = truth.centre_px[k]
    return any(
        np.hypot(s.x_px - x, s.y_px - y) < reach + 2.5 * s.sigma_px
        for s in renderer.background.spots
    )


def share(part) -> str:
    n = len(part["right"])
    if n == 0:
        return f"{'-':>7} {'-':>7} {'-':>7}"
    return f"{n:7} {100 * part['found'].mean():7.2f} {100 * part['right'].mean():7.2f}"


def table(rows):
    data = {c: np.array([r[i] for r in rows]) for i, c in enumerate(COLUMNS)}

    def part(mask):
        return {c: v[mask] for c, v in data.items()}

    coded = data["kind"] == "coded"
    bar = coded & (data["tilt"] <= 45) & (data["size"] >= 10) & (data["noise"] >= 32)
    print(
        "family           shown  found %  read %  |  the bar: shown found % read %  |  wrong IDs on"
    )
    for name in (*FAMILIES, "all"):
        mine = (data["family"] == name) | (name == "all")
        if not mine.any():
            continue
        wrong = Counter(data["kind"][mine & data["wrong"]].tolist())
        text = ", ".join(f"{k}: {n}" for k, n in wrong.items()) or "0"
        print(f"{name:13} {share(part(mine & coded))}  | {share(part(mine & bar))}  |  {text}")
    classes = (
        ("tilt", "tilt, deg", (0.0, *TILTS)), ("size", "dot, px", SIZES),
        ("noise", "noise", (0.0, *NOISES)),
    )  # fmt: skip
    print("\nclass                     shown  found %  read %")
    for key, label, edges in classes:
        for low, high in itertools.pairwise(edges):
            mask = coded & (data[key] > low) & (data[key] <= high)
            text = f"S{high:.0f}" if key == "noise" else f"{low:.0f} to {high:.0f}"
            print(f"{label:10} {text:12} {share(part(mask))}")
    for kind in ("spot", "small", "hidden", "hidden alike"):
        print(f"{kind:23} {share(part(data['kind'] == kind))}")
    others = np.char.startswith(data["kind"].astype(str), "of ")
    for label, mask in (
        ("not read at the bar", bar & data["found"] & ~data["right"]),
        ("not read, all", coded & data["found"] & ~data["right"]),
        ("hidden", np.isin(data["kind"], ("hidden", "hidden alike")) & data["found"]),
        ("other families", others & data["found"]),
        ("mirrored", (data["kind"] == "mirrored") & data["found"]),
    ):
        counts = Counter(data["status"][mask & (data["status"] >= 0)].tolist())
        print(f"{label}: " + ", ".join(f"{RING_STATUS[s]} {n}" for s, n in counts.most_common()))
    print("\nconfidence of IDs        given   right")
    given = (data["right"] | data["wrong"]) & np.isfinite(data["confidence"])
    edges = (0.0, 0.5, 0.9, 0.99, 0.999, 0.9999, 0.99999, 1.0)
    for low, high in itertools.pairwise(edges):
        mask = given & (data["confidence"] > low) & (data["confidence"] <= high)
        if mask.any():
            print(f"{low:8g} to {high:<8g} {mask.sum():11} {data['right'][mask].mean():9.6f}")
    print(f"sum of 1 - confidence: {(1 - data['confidence'][given]).sum():.3f} expected wrong, "
          f"{data['wrong'][given].sum()} wrong of {given.sum()}")  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--targets", type=int, default=400, help="coded ones of every family")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", default="edge-pair")
    parser.add_argument("--family", nargs="+", default=FAMILIES, choices=FAMILIES)
    parser.add_argument("--processes", type=int, default=0, help="0: one a core")
    parser.add_argument("--list", action="store_true", help="name every wrong ID")
    args = parser.parse_args()
    tasks = []
    for name in args.family:
        frames = -(-args.targets // min(24, max(len(family_of(name)) - 3, 1)))
        tasks += [(name, i, args.seed, args.method, args.list) for i in range(frames)]
    start = time.perf_counter()
    rows, seconds = [], 0.0
    with ProcessPoolExecutor(args.processes or None) as pool:
        for part, took in pool.map(frame, tasks, chunksize=8):
            rows += part
            seconds += took
    table(rows)
    print(
        f"{len(tasks)} frames in {time.perf_counter() - start:.0f} s, recognition {seconds:.0f} s"
    )


if __name__ == "__main__":
    main()
