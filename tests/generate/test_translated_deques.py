"""Deques with a `maxlen`, and ring buffers written by hand: each program is equal to Python in every period."""

from __future__ import annotations

from collections import deque

from helpers.written_programs import Cases, Program

CASES = Cases()
equal = CASES.is_equal


class Window(Program):
    def begin(self) -> None:
        self.window: deque[float] = deque(maxlen=3)


@equal
class Mean(Window):
    def control(self) -> None:
        before = len(self.window)
        self.window.append(self.u)
        self.c = before * 10 + len(self.window)
        self.k = sum(self.window) / len(self.window) + sum(self.window, 0.0) * 2
        self.yes = len(self.window) == self.window.maxlen


@equal
class FromTheLeft(Program):
    def begin(self) -> None:
        self.window = deque([1.0, 2.0], maxlen=4)

    def control(self) -> None:
        self.window.appendleft(self.u)
        self.k = max(self.window) - min(self.window, default=0.0) + self.window[0] * 2 + self.window[-1]
        self.window[1] = self.u + 1.0
        self.window[-1] += 0.5


@equal
class PlacesBeyondTheEnds(Program):
    def begin(self) -> None:
        self.window = deque([1, 2, 3], maxlen=4)

    def control(self) -> None:
        self.c = self.window[self.n % 9 - 4]
        self.window.append(self.n)


@equal
class BothEnds(Program):
    def begin(self) -> None:
        self.window = deque([1.0, 2.0, 3.0], maxlen=4)

    def control(self) -> None:
        self.k = self.window.pop() + self.window.popleft() * 10
        self.window.extend((self.u, self.u + 1.0))
        if self.n > 3:
            self.window.clear()
        self.window.rotate(1)
        if self.u > 1.0:
            self.window.rotate(-1)
            self.window.rotate(-1)
        self.c = 1 if self.window else 2


@equal
class OneElement(Program):
    def begin(self) -> None:
        self.window = deque([-0.0], maxlen=1)

    def control(self) -> None:
        self.k = sum(self.window) + max(self.window)
        self.window.append(self.u)
        self.window.appendleft(self.u + 1.0)
        self.window.rotate(1)
        self.k += self.window[0]


@equal
class NothingInIt(Window):
    def control(self) -> None:
        if self.n > 1:
            self.window.append(self.u)
        self.c = len([x for x in self.window if x > 0.0])
        self.k = max(self.window)


@equal
class LoopsOverADeque(Window):
    def control(self) -> None:
        self.window.append(self.u)
        for i, x in enumerate(reversed(self.window)):
            self.k += i * x
        for i in range(len(self.window)):
            self.k -= self.window[i]
        for i, x in enumerate(self.window):
            if x > 2.0:
                break
            self.k += self.window[i]
        else:
            self.c += 1
        for x in self.window:
            self.window[0] = self.k
            self.k += x
        self.yes = any(x > 2.0 for x in self.window) and not all(x < self.u for x in self.window)
        self.c += sum(1 for x in self.window if x > 0.0) + int(any(self.window)) + int(all(self.window)) * 10
        self.k += sum((x * x for x in self.window), 0.0) + max((x for x in self.window if x < 5.0), default=9.0)


@equal
class NamesForADeque(Program):
    def begin(self) -> None:
        self.window: deque[float] = deque(maxlen=3)
        self.other, self.both = self.window, (self.window, deque([5.0], maxlen=2))

    def put(self, window: deque[float], x: float) -> int:
        window.append(x)
        return len(window)

    def control(self) -> None:
        window = self.other
        window.append(self.u)
        self.c = self.put(self.window, 1.0) + self.put(self.both[1], 2.0)
        for each in self.both:
            each.append(self.k)
        self.k = self.window[0] + self.other[-1] + self.both[0][0] + self.both[1][-1]


@equal
class DequeOfBools(Program):
    def begin(self) -> None:
        self.last: deque[bool] = deque(maxlen=2)

    def control(self) -> None:
        self.last.append(self.u > 1.0)
        self.yes = all(self.last)
        self.c = sum(self.last)


@equal
class RingsWrittenByHand(Program):
    def begin(self) -> None:
        self.ring, self.at, self.filled = [0.0] * 4, 0, 0

    def control(self) -> None:
        self.ring[self.at] = self.u
        self.at = (self.at + 1) % len(self.ring)
        self.filled = min(self.filled + 1, len(self.ring))
        self.k = sum(self.ring[i] for i in range(self.filled)) / self.filled + self.ring[self.at - 1]


test_it_is_what_python_does = CASES.test()
