"""What ties the pictures of a network together, and what is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from videogrammetry.calibration.network_input import NetworkInput
from videogrammetry.types import IntArray

#: Common points, not in a line, that tie two groups of pictures firmly.
_ENOUGH = 8
_NAMES_SHOWN = 4


@dataclass(frozen=True, kw_only=True)
class MissingLink:
    """Two groups of pictures that too few points tie together.

    Attributes
    ----------
    groups : numbers of the groups.
    points : names of the points that both see.
    pictures : of each group the one that sees most of what the other sees too.
    """

    groups: tuple[int, int]
    points: tuple[str, ...]
    pictures: tuple[str, str]


def missing_links(
    network: NetworkInput, groups: Sequence[Sequence[int]], count: IntArray
) -> tuple[MissingLink, ...]:
    """Between every two groups (picture indices): common points and the closest pictures."""
    seen = [_points_of(network, group) for group in groups]
    links = []
    for i in range(len(groups)):
        for j in range(i + 1, len(groups)):
            shared = np.intersect1d(seen[i], seen[j])
            between = count[np.ix_(groups[i], groups[j])]
            a, b = np.unravel_index(int(between.argmax()), between.shape)
            links.append(
                MissingLink(
                    groups=(i, j),
                    points=tuple(network.points.name[k] for k in shared),
                    pictures=(
                        network.images[groups[i][int(a)]].name,
                        network.images[groups[j][int(b)]].name,
                    ),
                )
            )
    return tuple(links)


def describe_groups(
    network: NetworkInput, groups: Sequence[Sequence[int]], links: Sequence[MissingLink]
) -> str:
    """One paragraph: the groups, what they share, what to photograph."""
    parts = [
        f"group {k + 1}: {len(group)} pictures ({_names(network, group)}) of "
        f"{len(_points_of(network, group))} points"
        for k, group in enumerate(groups)
    ]
    text = (
        f"the pictures fall into {len(groups)} groups that too few common points tie together: "
        f"{'; '.join(parts)}. "
    )
    for link in links:
        a, b = link.groups
        shared = f"{len(link.points)} points" if link.points else "no point"
        which = f" ({_few(link.points)})" if link.points else ""
        near = f", most of them in {link.pictures[0]} and {link.pictures[1]}" if link.points else ""
        text += f"Groups {a + 1} and {b + 1} have {shared} in common{which}{near}. "
    return text + (
        f"Take further pictures that show at least {_ENOUGH} points of two groups at once, not all "
        "in a line (for two sides of an object: from the edges, with targets beside the object "
        "that both sides' pictures see), or state known points in each group"
    )


def _points_of(network: NetworkInput, group: Sequence[int]) -> IntArray:
    observations = network.observations
    mask = np.isin(observations.image, np.asarray(group, int)) & (observations.point >= 0)
    result: IntArray = np.unique(observations.point[mask])
    return result


def _names(network: NetworkInput, group: Sequence[int]) -> str:
    return _few([network.images[k].name for k in group])


def _few(names: Sequence[str]) -> str:
    shown = ", ".join(names[:_NAMES_SHOWN])
    return shown + (", ..." if len(names) > _NAMES_SHOWN else "")
