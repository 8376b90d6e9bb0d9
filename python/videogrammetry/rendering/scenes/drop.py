"""The way of a dropped wheel's middle: free fall, contact as a damped spring, rebound.

Free fall from rest with air drag k v^2 per unit of mass: s = ln(cosh(t sqrt(g k))) / k;
without drag, or with an initial speed, s = v0 t + g t^2 / 2. In contact the
compression d obeys d'' = g - w^2 d - 2 z w d', d(0) = 0, d'(0) = v; it ends
where d returns to 0. Height and velocity are continuous throughout. Only the
first fall feels the air: the rebounds are slow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_MIN_SPEED_MM_S = 1.0  # a slower rebound, of 0.05 um, is none


@dataclass(frozen=True)
class _Phase:
    """From ``start_s`` on: flight with ``speed`` upwards, or contact with ``speed`` downwards."""

    contact: bool
    start_s: float
    end_s: float
    speed_mm_s: float


class Drop:
    """Height of a wheel's middle over its height when it just touches the ground.

    Parameters
    ----------
    height_mm : at time 0, at rest or falling with ``speed_mm_s``.
    gravity_mm_s2 : the local g. drag_per_mm : k; only from rest.
    contact_s : half a period of the tyre's spring: how long a contact lasts, about.
    damping : of the spring, share of the critical one, 0.01 ... 0.99.

    Raises
    ------
    ValueError
        A number is out of its range, or a drag is given with an initial speed.

    Examples
    --------
    >>> drop = Drop(1000.0, gravity_mm_s2=9806.65)
    >>> round(drop.height_mm(0.2), 3), round(drop.touch_s, 4)
    (803.867, 0.4516)
    >>> drop.compression_mm(drop.touch_s + 0.015) > 20
    True
    """

    def __init__(
        self,
        height_mm: float,
        *,
        gravity_mm_s2: float,
        speed_mm_s: float = 0.0,
        drag_per_mm: float = 0.0,
        contact_s: float = 0.032,
        damping: float = 0.12,
    ) -> None:
        if not 0 < height_mm < math.inf:
            raise ValueError(f"height: expected more than 0 mm, got {height_mm:g} mm")
        if not 0 < gravity_mm_s2 < math.inf:
            raise ValueError(f"gravity: expected more than 0, got {gravity_mm_s2:g} mm/s^2")
        if not (0 <= speed_mm_s < math.inf and 0 <= drag_per_mm < math.inf):
            raise ValueError(
                f"speed and drag: expected 0 or more, got {speed_mm_s:g} mm/s and "
                f"{drag_per_mm:g}/mm"
            )
        if speed_mm_s and drag_per_mm:
            raise ValueError("drag: is known here for a fall from rest only; leave speed 0")
        if not (0 < contact_s < math.inf and 0.01 <= damping <= 0.99):
            raise ValueError("contact: expected a time over 0 s and a damping of 0.01 ... 0.99")
        self._h, self._g, self._v0, self._k = height_mm, gravity_mm_s2, speed_mm_s, drag_per_mm
        self._w = math.pi / contact_s
        self._zw = damping * self._w
        self._wd = math.sqrt(self._w**2 - self._zw**2)
        self.touch_s, touch_speed = self._first_touch()
        self._phases = self._bounces(touch_speed)

    def _first_touch(self) -> tuple[float, float]:
        g, k, v0 = self._g, self._k, self._v0
        if k:
            # acosh(e^x) = x + ln(1 + sqrt(1 - e^-2x)), which no x overflows.
            x = k * self._h
            end = (x + math.log1p(math.sqrt(-math.expm1(-2 * x)))) / math.sqrt(g * k)
            return end, math.sqrt(g / k) * math.tanh(end * math.sqrt(g * k))
        end = (math.sqrt(v0**2 + 2 * g * self._h) - v0) / g
        return end, v0 + g * end

    def _bounces(self, speed: float) -> list[_Phase]:
        phases: list[_Phase] = []
        time = self.touch_s
        while True:
            length = self._contact_length(speed)
            rebound = -self._spring(length, speed)[1] if math.isfinite(length) else 0.0
            if rebound < _MIN_SPEED_MM_S:
                return [*phases, _Phase(True, time, math.inf, speed)]
            phases.append(_Phase(True, time, time + length, speed))
            time += length
            flight = 2 * rebound / self._g
            phases.append(_Phase(False, time, time + flight, rebound))
            time += flight
            speed = rebound

    def _spring(self, t: float, speed: float) -> tuple[float, float]:
        """Compression and its rate, t after the touch."""
        rest = self._g / self._w**2
        a, b = -rest, (speed - self._zw * rest) / self._wd
        c, s, fade = math.cos(self._wd * t), math.sin(self._wd * t), math.exp(-self._zw * t)
        value = a * c + b * s
        rate = self._wd * (b * c - a * s) - self._zw * value
        return rest + fade * value, fade * rate

    def _contact_length(self, speed: float) -> float:
        """When the compression returns to 0, by bisection; inf if it never does."""
        rest = self._g / self._w**2
        a, b = -rest, (speed - self._zw * rest) / self._wd
        # The rate is 0 where tan(wd t) is this: at the deepest, and half a turn later.
        deepest = math.atan2(self._wd * b - self._zw * a, self._wd * a + self._zw * b) / self._wd
        low, high = deepest, deepest + math.pi / self._wd
        if self._spring(high, speed)[0] > 0:
            return math.inf
        for _ in range(200):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._spring(middle, speed)[0] > 0 else (low, middle)
        return high

    def fall_mm(self, t: float) -> float:
        """Way fallen since time 0, before the first touch; negative times go on backwards."""
        if self._k and t > 0:
            x = t * math.sqrt(self._g * self._k)
            return (x + math.log1p(math.exp(-2 * x)) - math.log(2)) / self._k  # ln cosh x
        return self._v0 * t + 0.5 * self._g * t * t

    def _phase(self, t: float) -> _Phase:
        """That of a time from the touch on; the last one has no end."""
        return next(p for p in self._phases if t < p.end_s)

    def height_mm(self, t: float) -> float:
        """Height of the middle over its height at the touch; negative in contact."""
        if t < self.touch_s:
            return self._h - self.fall_mm(t)
        phase = self._phase(t)
        past = t - phase.start_s
        if phase.contact:
            return -self._spring(past, phase.speed_mm_s)[0]
        return phase.speed_mm_s * past - 0.5 * self._g * past**2

    def compression_mm(self, t: float) -> float:
        """How far the ground presses the tyre in; 0 in flight."""
        return max(0.0, -self.height_mm(t)) if t >= self.touch_s else 0.0

    def releases(self, t: float) -> list[tuple[float, float]]:
        """Of every contact that has ended: the time since, and the speed upwards then."""
        return [
            (t - p.start_s, p.speed_mm_s) for p in self._phases if not p.contact and p.start_s <= t
        ]
