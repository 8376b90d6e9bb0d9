"""Progress on standard error: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from typing import TextIO

_BAR = 24
_TERMINAL_INTERVAL_S = 0.1
_PLAIN_INTERVAL_S = 10.0


class Progress:
    """Shows how far the work is; call it with (done, total, what).

    On a terminal one line with bar, rate and time left is drawn over and over;
    elsewhere (files, pipes) a plain line appears every ten seconds and at the end.
    """

    def __init__(self, what: str = "", unit: str = "", stream: TextIO | None = None) -> None:
        self._what = what
        self._unit = unit
        self._stream = sys.stderr if stream is None else stream
        self._terminal = self._stream.isatty()
        self._start = time.monotonic()
        self._shown = -1e9 if self._terminal else self._start
        self._width = 0
        self._called = self._start

    def __call__(self, done: int, total: int, what: str = "") -> None:
        """States that ``done`` of ``total`` are done; ``what`` names a new part of the work."""
        now = time.monotonic()
        if what and what != self._what:
            # Told only when something is done already, it began when the last part ended.
            self._what, self._start = what, now if done == 0 else self._called
        self._called = now
        interval = _TERMINAL_INTERVAL_S if self._terminal else _PLAIN_INTERVAL_S
        if done < total and now - self._shown < interval:
            return
        self._shown = now
        line = self._line(done, total, now - self._start)
        if self._terminal:
            self._stream.write("\r" + line.ljust(self._width))
            self._width = len(line)
            if done >= total:
                self._stream.write("\n")
                self._width = 0
        else:
            self._stream.write(line + "\n")
        self._stream.flush()

    def close(self) -> None:
        """Ends an unfinished line, so that a message starts on its own."""
        if self._width:
            self._stream.write("\n")
            self._stream.flush()
            self._width = 0

    def _line(self, done: int, total: int, elapsed_s: float) -> str:
        rate = done / elapsed_s if elapsed_s > 0 else 0.0
        parts = [f"{self._what}:" if self._what else ""]
        if self._terminal and total > 0:
            full = round(_BAR * min(done, total) / total)
            parts.append(f"[{'#' * full}{'.' * (_BAR - full)}]")
        parts.append(f"{done}/{total} {self._unit}".rstrip())
        if rate > 0:
            parts.append(f"{rate:.3g}/s")
        if done < total:
            parts.append(f"{_duration((total - done) / rate)} left" if rate > 0 else "")
        elif elapsed_s >= 1:
            parts.append(f"in {_duration(elapsed_s)}")
        return " ".join(part for part in parts if part)


def _duration(seconds: float) -> str:
    """A time as people say it.

    Examples
    --------
    >>> _duration(5.2), _duration(65), _duration(3720)
    ('5 s', '1 min 05 s', '1 h 02 min')
    """
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
