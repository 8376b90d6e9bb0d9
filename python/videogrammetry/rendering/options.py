"""Background, light, lens and sensor; equal to the C++ structs (a test holds them)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class SpecularSpot:
    """A spot of glare: a Gaussian added to the picture.

    Attributes
    ----------
    x_px, y_px : its middle. sigma_px : its size before the lens' blur, > 0.
    amplitude : share of full scale at the top, >= 0.
    """

    x_px: float = 0.0
    y_px: float = 0.0
    sigma_px: float = 5.0
    amplitude: float = 0.5


@dataclass(frozen=True, kw_only=True)
class Background:
    """What lies behind the targets, in reflectance; the same for a seed on all machines.

    Attributes
    ----------
    level : 0 ... 1. clutter : amplitude of clouds, lines, patches and discs, 0 (none) ... 1.
    num_discs, num_lines, num_patches : of the clutter, 0 ... 10000.
    seed : of the clutter. spots : glare, in front of everything.
    """

    level: float = 0.35
    clutter: float = 0.0
    num_discs: int = 15
    num_lines: int = 20
    num_patches: int = 20
    seed: int = 0
    spots: tuple[SpecularSpot, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Illumination:
    """Light over the picture: level (1 + gradient . ((x, y) - centre) / (width, height)).

    Attributes
    ----------
    level : share of full scale that reflectance 1 gives, > 0.
    gradient : relative change over the whole width and height, |gx| + |gy| < 2.
    """

    level: float = 1.0
    gradient: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """Lens blur, noise, samples.

    An edge of the picture has the spread sqrt(psf_sigma_px^2 + 1/12): lens and
    pixel. Noise is normal with the variance read_noise^2 + shot_noise_gain g at
    the grey value g, in grey levels of the picture.

    Attributes
    ----------
    psf_sigma_px : 0 ... 10. read_noise, shot_noise_gain : >= 0.
    bit_depth : 8 (uint8), 10, 12, 14 or 16 (uint16); saturating.
    """

    psf_sigma_px: float = 0.7
    read_noise: float = 0.0
    shot_noise_gain: float = 0.0
    bit_depth: int = 8
