"""The recordings of all cameras of one Photron session."""

from __future__ import annotations

import os
import re
from pathlib import Path

from videogrammetry.errors import SequenceError
from videogrammetry.sequence.mraw import HEADER_SUFFIXES, one_of_each_recording
from videogrammetry.sequence.select import natural_key

#: Names that Photron's software gives: camera, head, session.
_NAME = re.compile(r"(C\d+H\d+)S(\d+)(.*)", re.IGNORECASE)


def photron_session(folder: str | os.PathLike[str], session: int | None = None) -> dict[str, Path]:
    """Header files by camera, from names like ``C001H001S0003/C001H001S0003.cihx``.

    Parameters
    ----------
    folder : where the recordings are, or folders with them.
    session : the number after S; None: the only one there is.

    Returns
    -------
    Camera and head (``C001H001``), and what follows the session's number (of partitions),
    to the header: what ``[cameras.NAME] sequence`` wants, and ``open_sequence`` opens.

    Raises
    ------
    SequenceError
        None is there, several are and none is chosen, or one camera has two.
    """
    root = Path(folder)
    headers = [p for p in sorted(root.rglob("*")) if p.suffix.lower() in HEADER_SUFFIXES]
    found: dict[int, dict[str, Path]] = {}
    for path in sorted(one_of_each_recording(headers), key=natural_key):
        match = _NAME.fullmatch(path.stem)
        if match is None:
            continue
        cameras = found.setdefault(int(match[2]), {})
        name = match[1].upper() + match[3]
        if name in cameras:
            raise SequenceError(
                f"{path}: camera {name} of session {int(match[2])} is there twice, also as "
                f"{cameras[name]}; take one away"
            )
        cameras[name] = path
    if not found or (session is not None and session not in found):
        which = "" if session is None else f" of session {session}"
        there = f"; there are the sessions {', '.join(map(str, sorted(found)))}" if found else ""
        raise SequenceError(
            f"{root}: no recording{which} with a name like C001H001S0001.cihx in it or its "
            f"folders{there}; give another folder, or name the files one by one"
        )
    if session is None and len(found) > 1:
        raise SequenceError(
            f"{root}: recordings of several sessions ({', '.join(map(str, sorted(found)))}): say "
            "which one"
        )
    return found[next(iter(found)) if session is None else session]
