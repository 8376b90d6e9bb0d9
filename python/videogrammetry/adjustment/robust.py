"""A bundle adjustment from rough start values: minimises, and says nothing of accuracy."""

from __future__ import annotations

from videogrammetry._core import adjustment as _adjustment
from videogrammetry.adjustment.network import Network


def robust_bundle(network: Network, *, cauchy_scale: float = 3.0, max_iterations: int = 50) -> bool:
    """Minimise Cauchy's loss over the free unknowns in place; whether it converged.

    For start values: no covariance, no test. A network without datum is allowed:
    the damping holds what nothing determines near its start.

    Parameters
    ----------
    network : every observation in units of its covariance.
    cauchy_scale : residuals beyond this many standard deviations lose their weight.
    max_iterations : steps of Levenberg and Marquardt.
    """
    return bool(
        _adjustment.robust_bundle(
            network._network,
            cauchy_scale,
            max_iterations,
        )
    )
