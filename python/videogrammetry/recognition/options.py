"""Options of recognition; fields and defaults equal those of the C++ structs (a test holds it)."""

from __future__ import annotations

from dataclasses import dataclass

#: Why a target has no ID, by ``Targets.ring_status``.
RING_STATUS = (
    "coded",  # 0: the ring agrees unambiguously with one code of the family
    "no ring",  # 1: nothing bright around the dot: an un-coded target
    "ring cut",  # 2: the ring leaves the picture
    "ring unclear",  # 3: grey values of the sectors are not two separate groups
    "edges off",  # 4: bright-dark changes do not fall on the sectors' borders
    "not in table",  # 5: a clear code that the family does not have
    "mirrored",  # 6: a code only when read in the other direction
    "duplicate",  # 7: the same ID stands elsewhere in the picture; kept if equally clear
)


@dataclass(frozen=True, kw_only=True)
class RecognitionOptions:
    """What to look for and how.

    Attributes
    ----------
    codes : a family (``schneider-14``, ...), the path of a table file, or ``none``.
    direction : ``clockwise`` or ``counter-clockwise`` as seen in the picture.
    polarity : ``white-on-black`` or ``black-on-white``.
    diameter_px : smallest minor and largest major axis of a dot, full lengths;
        3 <= smallest < largest <= 2000.
    method : ``edge-pair``, the fast one, which alone has a model of the camera and
        reads packed samples in place, or ``local-canny``, the paper's way.
    estimator : how a dot that was found is measured. ``mean-gradient``, the
        paper's way; ``dual-conic``: an ellipse through the tangents that its
        grey values' gradients give; or ``model``: its grey values as those of a
        blurred ellipse, noise-weighted, nearest to what the noise permits. ``auto``:
        the model for ``edge-pair``, the mean gradient for ``local-canny``.
    """

    codes: str = "schneider-14"
    direction: str = "clockwise"
    polarity: str = "white-on-black"
    diameter_px: tuple[float, float] = (5.0, 200.0)
    method: str = "edge-pair"
    estimator: str = "auto"


@dataclass(frozen=True, kw_only=True)
class TrackedOptions:
    """How targets are followed from frame to frame.

    Attributes
    ----------
    full_every : every so many frames the whole frame is searched for what is new, beside
        the targets that are followed there too; 1: always. At the first frame, where a
        target was lost, and at the first of these after a hundred it is searched as if
        nothing were known.
    margin_px : how far a target may be from where it is expected; 1 to 1000.
    """

    full_every: int = 100
    margin_px: float = 4.0
