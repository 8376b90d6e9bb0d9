"""``videogrammetry simulate``: the paper's experiments as recordings with known truth."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from videogrammetry.cli.common import SubParsers, UsageError, add_verb
from videogrammetry.cli.progress import Progress
from videogrammetry.recognition import CodeFamily, code_family
from videogrammetry.rendering import scenes
from videogrammetry.rendering.disturbances import Conditions, exposure_for_blur
from videogrammetry.rendering.scenes import CrossTarget, PhotoScene, Scene
from videogrammetry.rendering.simulate import (
    Simulated,
    SimulateOptions,
    simulate,
    simulate_photos,
)
from videogrammetry.sequence import SEQUENCE_FORMATS

SCENES = ("calibration", "scale-bar", "tyre", "target-photos")


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments, scene by scene."""
    parser = add_verb(
        verbs,
        "simulate",
        None,
        help="render an experiment as a laboratory would record it, with its truth",
        description="Renders the paper's experiments as recordings of its four cameras (Photron "
        ".cihx and .mraw, 12 bit packed; or TIFF, PNG), with project.toml and the truth beside.",
        example="videogrammetry simulate tyre drop --stages 100 --calibration cal",
    )
    parts = parser.add_subparsers(dest="scene", metavar="SCENE", required=True)
    for add_scene in (_calibration, _scale_bar, _tyre, _photos):
        add_scene(parts)


def _scene(verbs: SubParsers, name: str, help: str, example: str) -> argparse.ArgumentParser:
    parser = add_verb(
        verbs, name, run, help=help, description=f"{help[0].upper()}{help[1:]}.", example=example
    )
    parser.add_argument("out", type=Path, metavar="OUT", help="folder to make; must not exist")
    return parser


def _common(parser: argparse.ArgumentParser, *, moving: bool = False, photos: bool = False) -> None:
    default = Conditions()
    group = parser.add_argument_group("pictures")
    add = group.add_argument
    formats = tuple(f for f in SEQUENCE_FORMATS if not photos or f != "mraw")
    add("--format", choices=formats, default=formats[0], help="default: %(default)s")
    add("--bits", type=int, choices=(8, 12, 16), default=12, help="default: %(default)s")
    add(
        "--contrast-noise",
        type=float,
        default=default.contrast_noise,
        metavar="R",
        help="grey-value step of a dot over the noise at white (default: %(default)g)",
    )
    add(
        "--psf-px",
        type=float,
        default=default.psf_sigma_px,
        metavar="PX",
        help="the lens' blur, standard deviation (default: %(default)g)",
    )
    add(
        "--clutter",
        type=float,
        default=default.clutter,
        metavar="SHARE",
        help="of the background, 0 to 1 (default: %(default)g)",
    )
    add(
        "--gradient",
        type=float,
        nargs=2,
        default=default.gradient,
        metavar=("X", "Y"),
        help="relative change of the light over the picture (default: 0.15 -0.1)",
    )
    add(
        "--spots",
        type=int,
        default=default.spots,
        metavar="N",
        help="specular spots a picture (default: %(default)d)",
    )
    _objects(add)
    parser.set_defaults(occluded=0.0, missing=0.0, exposure_us=None, blur_px=None)
    if not photos:
        _disturbances(add)
    if moving:
        _motion(add)


def _objects(add: Callable[..., object]) -> None:
    add("--seed", type=int, default=0, help="of everything random (default: 0)")
    add("--codes", default="schneider-14", metavar="FAMILY", help="default: %(default)s")
    add(
        "--dot-mm",
        type=float,
        default=40.0,
        metavar="MM",
        help="diameter of the dots (default: %(default)g)",
    )


def _disturbances(add: Callable[..., object]) -> None:
    add(
        "--occluded",
        type=float,
        default=0.0,
        metavar="SHARE",
        help="targets hidden wholly or in part at random (default: 0)",
    )
    add(
        "--missing",
        type=float,
        default=0.0,
        metavar="SHARE",
        help="stages at which one camera's picture is empty (default: 0)",
    )


def _motion(add: Callable[..., object]) -> None:
    add(
        "--exposure-us",
        type=float,
        default=None,
        metavar="US",
        help="exposure, microseconds (default: 200)",
    )
    add(
        "--blur-px",
        type=float,
        default=None,
        metavar="PX",
        help="choose the exposure so that the fastest target moves by this much",
    )
    add("--calibration", type=Path, metavar="DIR",
        help="calibration project that project.toml shall name")  # fmt: skip


def _calibration(verbs: SubParsers) -> None:
    parser = _scene(
        verbs,
        "calibration",
        "the two-sided cross held at many orientations",
        "videogrammetry simulate calibration cal --orientations 16",
    )
    parser.add_argument(
        "--orientations",
        type=int,
        default=24,
        metavar="N",
        help="the paper takes 8 to 24 (default: %(default)d)",
    )
    parser.add_argument(
        "--tilt-deg",
        type=float,
        default=25.0,
        metavar="DEG",
        help="largest tilt about two axes (default: %(default)g)",
    )
    parser.add_argument(
        "--span-mm",
        type=float,
        default=1400.0,
        metavar="MM",
        help="of the cross (default: %(default)g)",
    )
    parser.add_argument(
        "--target-sigma-mm",
        type=float,
        default=0.1,
        metavar="MM",
        help="error of the coordinates in cross.csv (default: %(default)g)",
    )
    _common(parser)


def _scale_bar(verbs: SubParsers) -> None:
    parser = _scene(
        verbs,
        "scale-bar",
        "a scale bar moving through the field",
        "videogrammetry simulate scale-bar bar --speeds 200 1000 --calibration cal",
    )
    parser.add_argument("--stages", type=int, default=44, metavar="N", help="default: %(default)d")
    parser.add_argument(
        "--speeds",
        type=float,
        nargs="+",
        default=[200.0, 500.0, 1000.0, 2000.0],
        metavar="MM_S",
        help="mm/s, one after the other (default: 200 500 1000 2000)",
    )
    parser.add_argument(
        "--length-mm",
        type=float,
        default=1100.057,
        metavar="MM",
        help="between the targets (default: %(default)g)",
    )
    parser.add_argument(
        "--cross-pair", action="store_true", help="one end is seen by cameras 1-2, the other by 3-4"
    )
    _common(parser, moving=True)


def _tyre(verbs: SubParsers) -> None:
    parser = _scene(
        verbs,
        "tyre",
        "a tyre that falls, hits the ground and rebounds",
        "videogrammetry simulate tyre drop --stages 200 --calibration cal",
    )
    add = parser.add_argument
    add("--stages", type=int, default=200, metavar="N", help="default: %(default)d")
    add("--frame-rate", type=float, default=250.0, metavar="HZ", help="default: %(default)g")
    add(
        "--height-mm",
        type=float,
        default=1038.0,
        metavar="MM",
        help="of the fall (default: %(default)g)",
    )
    add(
        "--speed", type=float, default=0.0, metavar="MM_S", help="downwards at stage 1 (default: 0)"
    )
    add(
        "--gravity",
        type=float,
        default=9.80665,
        metavar="M_S2",
        help="the local g (default: %(default)g)",
    )
    add(
        "--drag",
        type=float,
        default=0.0,
        metavar="PER_M",
        help="k of the air's drag k v^2 (default: 0)",
    )
    add(
        "--spin-deg-s",
        type=float,
        default=5.0,
        metavar="DEG_S",
        help="about the axis (default: %(default)g)",
    )
    add("--uncoded", action="store_true", help="plain dots instead of coded ones")
    _common(parser, moving=True)


def _photos(verbs: SubParsers) -> None:
    parser = _scene(
        verbs,
        "target-photos",
        "photographs all round the standing cross",
        "videogrammetry simulate target-photos photos",
    )
    add = parser.add_argument
    add(
        "--heights-mm",
        type=float,
        nargs="+",
        default=[500.0, 1400.0, 2400.0],
        metavar="MM",
        help="of the camera over the floor (default: 500 1400 2400)",
    )
    add(
        "--step-deg",
        type=float,
        default=45.0,
        metavar="DEG",
        help="between stations (default: %(default)g)",
    )
    add("--distance-mm", type=float, default=3200.0, metavar="MM", help="default: %(default)g")
    add(
        "--size-px",
        type=int,
        nargs=2,
        default=[2592, 1728],
        metavar=("W", "H"),
        help="of a picture (default: 2592 1728)",
    )
    _common(parser, photos=True)


@dataclass(frozen=True, kw_only=True)
class _Built:
    """A scene, or photographs, with the codes and the cross in it."""

    family: CodeFamily
    scene: Scene | PhotoScene
    cross: CrossTarget | None = None


def run(args: argparse.Namespace) -> int:
    """Renders and writes the scene."""
    progress = Progress("simulate", "pictures" if args.scene == "target-photos" else "stages")
    try:
        done = _simulate(args, progress)
    except ValueError as error:  # what is wrong with files is no ValueError
        raise UsageError(str(error)) from error
    finally:
        progress.close()
    print(
        f"{done.num_pictures} pictures, {done.num_visible} targets whole in them, "
        f"{done.num_hidden} hidden in part or wholly"
    )
    for stage, camera in done.missing.items():
        print(f"stage {stage}: camera {camera} delivers an empty picture")
    print(f"wrote {args.out}", file=sys.stderr)
    return 0


def _simulate(args: argparse.Namespace, progress: Progress) -> Simulated:
    conditions = Conditions(
        bit_depth=args.bits, contrast_noise=args.contrast_noise, psf_sigma_px=args.psf_px,
        clutter=args.clutter, gradient=(args.gradient[0], args.gradient[1]),
        spots=args.spots, occluded=args.occluded, missing=args.missing, seed=args.seed,
    )  # fmt: skip
    options = SimulateOptions(
        conditions=conditions,
        format=args.format,
        target_sigma_mm=getattr(args, "target_sigma_mm", 0.1),
        calibration=getattr(args, "calibration", None),
    )
    built = _build(args)
    if isinstance(built.scene, PhotoScene):
        return simulate_photos(built.scene, args.out, built.family, options, progress=progress)
    return simulate(
        built.scene, args.out, built.family, options, cross=built.cross, progress=progress
    )


def _build(args: argparse.Namespace) -> _Built:
    """The scene of the arguments; ValueError says what is impossible."""
    family = code_family(args.codes)
    if args.scene in ("calibration", "target-photos"):
        return _build_cross(args, family)
    if args.exposure_us is not None and args.blur_px is not None:
        raise ValueError("--exposure-us and --blur-px both set the exposure; leave one out")
    # With --blur-px the exposure is found from the scene.
    exposure = 0.0 if args.blur_px is not None else 200e-6
    exposure = exposure if args.exposure_us is None else 1e-6 * args.exposure_us
    if args.scene == "scale-bar":
        scene = scenes.scale_bar_scene(
            family, num_stages=args.stages, speeds_mm_s=args.speeds, exposure_s=exposure,
            length_mm=args.length_mm, cross_pair=args.cross_pair, dot_mm=args.dot_mm,
            seed=args.seed,
        )  # fmt: skip
    else:
        scene = scenes.tyre_scene(
            family, num_stages=args.stages, frame_rate_hz=args.frame_rate, exposure_s=exposure,
            height_mm=args.height_mm, gravity_m_s2=args.gravity, speed_mm_s=args.speed,
            drag_per_m=args.drag, spin_deg_s=args.spin_deg_s, dot_mm=args.dot_mm,
            uncoded=args.uncoded,
        )  # fmt: skip
    if args.blur_px is not None:
        scene = replace(scene, exposure_s=exposure_for_blur(scene, args.blur_px))
    return _Built(family=family, scene=scene)


def _build_cross(args: argparse.Namespace, family: CodeFamily) -> _Built:
    """The scenes of which the cross is the object."""
    if args.scene == "calibration":
        cross = scenes.cross_target(family, dot_mm=args.dot_mm, span_mm=args.span_mm)
        scene = scenes.calibration_scene(
            family, num_orientations=args.orientations, cross=cross, tilt_deg=args.tilt_deg,
            seed=args.seed,
        )  # fmt: skip
        return _Built(family=family, scene=scene, cross=cross)
    cross = scenes.cross_target(family, dot_mm=args.dot_mm)
    photos = scenes.photos_scene(
        family, cross=cross, heights_mm=args.heights_mm, step_deg=args.step_deg,
        distance_mm=args.distance_mm, image_size_px=tuple(args.size_px), seed=args.seed,
    )  # fmt: skip
    return _Built(family=family, scene=photos)
