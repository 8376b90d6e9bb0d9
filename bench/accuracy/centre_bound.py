"""Cramer and Rao's bound for the centre of one dot in a picture.

Model: an ellipse of one grey value on another, blurred by a Gaussian lens of
standard deviation s, integrated over square pixels, lit by a light that changes
linearly:

    I(p) = (1 + g . (p - c) / r) (out + (in - out) C(p)),  C(p) = int_ellipse K(p - q) dq

with K = (Gaussian * box)(x) (Gaussian * box)(y). By Gauss' and Reynolds' theorems

    C(p) = closed int A(q_x - p_x) K(p_y - q_y) dq_y,   A the integral of K        (1)
    dC/dtheta = closed int K(p - q) n . dq/dtheta dl                               (2)

the trapezium rule on q(t) = c + E (cos t, sin t) is exact to rounding at 128
points for dots of some pixels. Unknown: centre, E, both grey values (free);
s, normal about the middle of the generator's range with that range's standard
deviation; g, normal about 0 with the generator's. Noise: independent, normal,
of the variance that the generator gives the noise-free grey value, plus 1/12
of rounding. Its own dependence on the unknowns is not used: only the grey
values' means carry information.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

_POINTS = 128
_STEP = 1e-3
#: Pixels used: so far from the contour as an edge of this width in standard deviations
#: and some plateau reach, not where a ring of code or a sticker's border is felt.
_REACH, _PLATEAU_PX, _RING = 3.0, 1.5, 2.5


def _density(t, s):
    """Gaussian of standard deviation s, averaged over a pixel."""
    return ndtr((t + 0.5) / s) - ndtr((t - 0.5) / s)


def _integral(t, s):
    def once(z):
        return z * ndtr(z) + np.exp(-0.5 * z * z) / np.sqrt(2 * np.pi)

    return s * (once((t + 0.5) / s) - once((t - 0.5) / s))


def coverage(x, y, centre, shape, s):
    """Eq. (1) at columns x and rows y: (len(y), len(x))."""
    q, tangent = _contour(centre, shape)
    kx = _integral(q[0] - x[:, None], s)
    return (_density(y[:, None] - q[1], s) * tangent[1]) @ kx.T


def _contour(centre, shape):
    t = 2 * np.pi * np.arange(_POINTS) / _POINTS
    u = np.stack([np.cos(t), np.sin(t)])
    turned = np.stack([-u[1], u[0]])
    return centre[:, None] + shape @ u, shape @ turned * (2 * np.pi / _POINTS)


def centre_covariance(
    centre, semi_axes, angle, *, white, black, psf, psf_sigma, gradient, variance, free_radii
):
    """(2, 2) covariance of the centre, px^2, that no unbiased estimate is below.

    Parameters
    ----------
    white, black : grey values. variance : of a grey value, a function.
    psf, psf_sigma : of the lens, and how well it is known beforehand, px.
    gradient : standard deviation of the light's relative change over a radius.
    free_radii : where something else begins, in radii of the dot.
    """
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    shape = turn @ np.diag(semi_axes) @ turn.T
    edge = np.sqrt(psf**2 + 1 / 12)
    reach = _REACH * edge + _PLATEAU_PX
    half = np.hypot(*shape.T) + reach
    x = np.arange(np.ceil(centre[0] - half[0]), np.floor(centre[0] + half[0]) + 1)
    y = np.arange(np.ceil(centre[1] - half[1]), np.floor(centre[1] + half[1]) + 1)
    cover = coverage(x, y, centre, shape, psf)
    q, tangent = _contour(centre, shape)
    kx, ky = _density(x[:, None] - q[0], psf), _density(y[:, None] - q[1], psf)
    u = np.linalg.solve(shape, q - centre[:, None])
    # n dl = (dq_y, -dq_x); q moves by dc and by dE u.
    zero = np.zeros_like(u[0])
    moves = [(zero + 1, zero), (zero, zero + 1), (u[0], zero), (u[1], u[0]), (zero, u[1])]
    columns = [
        (white - black) * ((ky * (m[0] * tangent[1] - m[1] * tangent[0])) @ kx.T) for m in moves
    ]
    columns += [cover, 1 - cover]
    wider = coverage(x, y, centre, shape, psf + _STEP)
    narrower = coverage(x, y, centre, shape, psf - _STEP)
    columns.append((white - black) * (wider - narrower) / (2 * _STEP))
    grey = black + (white - black) * cover
    radius = semi_axes.mean()
    columns.append(grey * (x[None, :] - centre[0]) / radius)
    columns.append(grey * (y[:, None] - centre[1]) / radius)
    # Pixels that belong to this dot alone.
    dx, dy = np.meshgrid(x - centre[0], y - centre[1])
    inverse = np.linalg.inv(shape)
    v = np.stack([inverse[0, 0] * dx + inverse[0, 1] * dy, inverse[1, 0] * dx + inverse[1, 1] * dy])
    radii = np.hypot(*v)
    length = np.hypot(dx, dy)
    outward = (radii - 1) * length / np.maximum(radii, 1e-9)
    free = (free_radii - 1) * length / np.maximum(radii, 1e-9) - _RING * edge
    used = outward < np.minimum(reach, np.maximum(2 * edge, free))
    rows = np.stack([column[used] for column in columns], axis=1)
    weight = 1 / (variance(grey[used]) + 1 / 12)
    information = rows.T @ (weight[:, None] * rows)
    information[7, 7] += 1 / psf_sigma**2
    information[[8, 9], [8, 9]] += 1 / gradient**2
    scale = np.sqrt(np.diag(information))
    return np.linalg.inv(information / np.outer(scale, scale))[:2, :2] / np.outer(
        scale[:2], scale[:2]
    )
