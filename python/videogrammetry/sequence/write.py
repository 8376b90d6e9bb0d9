"""Writes the frames of one camera: as a Photron recording or as a folder of pictures."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Protocol, get_args

import numpy as np
import numpy.typing as npt

from videogrammetry.sequence.mraw_write import MrawOutput
from videogrammetry.sequence.parts import check_free_space, write_failed
from videogrammetry.sequence.picture_write import PictureOutput

SequenceFormat = Literal["mraw", "tiff", "png"]

#: What :func:`create_sequence` can write.
SEQUENCE_FORMATS: tuple[SequenceFormat, ...] = get_args(SequenceFormat)

#: Noted as the date of recording where none is given, so that the same frames
#: give the same bytes.
DEFAULT_DATE = datetime(2000, 1, 1)


class _Output(Protocol):
    """What a format does; ``discard`` removes everything, whatever was done before."""

    target: Path
    spec: str
    needed_bytes: int

    def check(self) -> None: ...
    def begin(self) -> None: ...
    def write(self, index: int, frame: npt.NDArray[Any]) -> None: ...
    def finish(self) -> None: ...
    def discard(self) -> None: ...


def create_sequence(
    path_or_folder: str | os.PathLike[str],
    *,
    format: SequenceFormat,
    image_size_px: tuple[int, int],
    num_frames: int,
    bit_depth: int,
    frame_rate_hz: float | None = None,
    exposure_s: float | None = None,
    camera_name: str = "",
    date: datetime | None = None,
    names: Sequence[str] | None = None,
) -> SequenceWriter:
    """Begins a sequence; nothing stands under its name until all frames have come.

    Parameters
    ----------
    path_or_folder : ``mraw``: ``cam1`` (or ``cam1.cihx``) gives ``cam1.cihx``
        and ``cam1.mraw``. ``tiff``, ``png``: the folder, not there yet, for
        ``cam1/cam1_000001.tif`` and so on. The folder above must be there.
    format : ``mraw`` (8 bit, 12 bit packed, 16 bit for all others), ``tiff``
        (uncompressed) or ``png``; both of 8 bit, or 16 bit for more than 8.
    image_size_px : (width, height).
    num_frames : how many will come, neither more nor less.
    bit_depth : 8 to 16; samples are 0 to 2**bit_depth - 1.
    frame_rate_hz, exposure_s, camera_name, date : kept by ``mraw`` alone, the
        exposure to the nanosecond and the date to the minute; where no date is
        given it is that of 1 January 2000, so that equal frames give equal files.
    names : of the pictures of a folder, without suffix, one a frame, all different;
        None: the folder's name and the frame's number.

    Raises
    ------
    ValueError
        An argument is out of its range.
    FileExistsError, FileNotFoundError, NotADirectoryError, PermissionError
        The place is taken, not there, or may not be written to.
    SequenceError
        The disk has less free space than the sequence needs.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> with create_sequence(
    ...     folder / "cam1", format="mraw", image_size_px=(64, 48), num_frames=2, bit_depth=12,
    ...     frame_rate_hz=5000, exposure_s=20e-6,
    ... ) as writer:
    ...     for grey in (100, 4095):
    ...         writer.append(np.full((48, 64), grey, np.uint16))
    >>> writer.spec, sorted(p.name for p in folder.iterdir())
    ('cam1.cihx', ['cam1.cihx', 'cam1.mraw'])
    """
    _check_arguments(format, image_size_px, num_frames, bit_depth, frame_rate_hz, exposure_s)
    if not camera_name.isprintable():
        raise ValueError(f"camera_name: expected printable characters, got {camera_name!r}")
    if names is not None and (
        format == "mraw"
        or len(names) != num_frames
        or len(set(names)) < num_frames
        or any(not name or Path(name).name != name for name in names)
    ):
        raise ValueError(
            f"names: expected {num_frames} different file names without folder, for pictures alone"
        )
    path = Path(path_or_folder)
    if not path.name:
        raise ValueError(f"path_or_folder: expected a name, got {os.fspath(path_or_folder)!r}")
    output: _Output
    if format == "mraw":
        output = MrawOutput(
            path,
            image_size_px=image_size_px,
            num_frames=num_frames,
            bit_depth=bit_depth,
            frame_rate_hz=frame_rate_hz,
            exposure_s=exposure_s,
            camera_name=camera_name,
            date=date or DEFAULT_DATE,
        )
    else:
        output = PictureOutput(
            path,
            format=format,
            image_size_px=image_size_px,
            num_frames=num_frames,
            bit_depth=bit_depth,
            names=names,
        )
    return SequenceWriter(output, image_size_px, num_frames, bit_depth)


class SequenceWriter:
    """Takes the frames of one camera one by one; made by :func:`create_sequence`.

    As a context manager it closes the sequence at the end of the block, or
    removes what was written if the block raises.

    Attributes
    ----------
    spec : name for ``project.toml``, from the folder above: "cam1.cihx", "cam1/*.tif".
    path : the header, or the folder of pictures, that will be there.
    needed_bytes : on the disk; for ``png`` the most that it can be.
    """

    def __init__(
        self, output: _Output, image_size_px: tuple[int, int], num_frames: int, bit_depth: int
    ) -> None:
        self._output = output
        self._shape = (image_size_px[1], image_size_px[0])
        self._num_frames = num_frames
        self._largest = 2**bit_depth - 1
        self._dtype = np.dtype(np.uint8 if bit_depth == 8 else np.uint16)
        self._written = 0
        self._open = True
        self.spec = output.spec
        self.path = output.target
        self.needed_bytes = output.needed_bytes
        output.check()
        check_free_space(output.target, output.needed_bytes)
        try:
            output.begin()
        except OSError as error:
            raise self._failed(error) from error

    def append(self, frame: npt.NDArray[Any]) -> None:
        """Writes the next frame.

        Parameters
        ----------
        frame : (height, width), uint8 or uint16, values 0 to 2**bit_depth - 1.

        Raises
        ------
        ValueError
            Another shape or type, a value that is too large, a frame too many,
            or the writer is closed; the sequence may go on with a right frame.
        SequenceError
            The disk is full or fails; what was written has been removed.
        """
        checked = self._checked(np.asarray(frame))
        try:
            self._output.write(self._written, checked)
        except OSError as error:
            raise self._failed(error) from error
        self._written += 1

    def close(self) -> None:
        """Gives the sequence its name; closing again does nothing.

        Raises
        ------
        ValueError
            Frames are missing; what was written has been removed.
        SequenceError
            The disk is full or fails; what was written has been removed.
        FileExistsError
            Somebody else has written there meanwhile.
        """
        if not self._open:
            return
        if self._written < self._num_frames:
            self.discard()
            raise ValueError(
                f"{self.path}: {self._written} of {self._num_frames} frames came; what was "
                "written has been removed"
            )
        try:
            self._output.finish()
        except FileExistsError:
            self.discard()
            raise
        except OSError as error:
            raise self._failed(error) from error
        self._open = False

    def discard(self) -> None:
        """Removes what was written, if the sequence is not closed."""
        if self._open:
            self._open = False
            self._output.discard()

    def __enter__(self) -> SequenceWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()

    def _checked(self, frame: npt.NDArray[Any]) -> npt.NDArray[Any]:
        if not self._open:
            raise ValueError(f"{self.path}: the sequence is closed, no frame can be added")
        if self._written == self._num_frames:
            raise ValueError(f"{self.path}: all {self._num_frames} frames have come already")
        if frame.shape != self._shape or frame.dtype not in (np.uint8, np.uint16):
            raise ValueError(
                f"frame: expected {self._shape} of uint8 or uint16, got {frame.shape} of "
                f"{frame.dtype}"
            )
        if frame.max() > self._largest:
            raise ValueError(
                f"frame: expected values up to {self._largest}, got {frame.max()} in frame "
                f"{self._written + 1}"
            )
        return np.ascontiguousarray(frame, dtype=self._dtype)

    def _failed(self, error: OSError) -> Exception:
        self.discard()
        return write_failed(self.path, self.needed_bytes, error)


def _check_arguments(
    format: str,
    image_size_px: tuple[int, int],
    num_frames: int,
    bit_depth: int,
    frame_rate_hz: float | None,
    exposure_s: float | None,
) -> None:
    if format not in SEQUENCE_FORMATS:
        raise ValueError(f"format: expected one of {', '.join(SEQUENCE_FORMATS)}, got {format!r}")
    if len(image_size_px) != 2 or not all(1 <= side <= 65536 for side in image_size_px):
        raise ValueError(f"image_size_px: expected (width, height) to 65536, got {image_size_px}")
    if num_frames < 1:
        raise ValueError(f"num_frames: expected at least 1, got {num_frames}")
    if not 8 <= bit_depth <= 16:
        raise ValueError(f"bit_depth: expected 8 to 16, got {bit_depth}")
    if frame_rate_hz is not None and not (
        math.isfinite(frame_rate_hz) and 0 < frame_rate_hz <= 1e9
    ):
        raise ValueError(f"frame_rate_hz: expected over 0 to 1e9, got {frame_rate_hz}")
    if exposure_s is not None and not 1e-9 <= exposure_s <= 3600:
        raise ValueError(f"exposure_s: expected 1 ns to an hour, got {exposure_s}")
