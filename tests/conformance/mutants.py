"""Broken drivers as changes of the text of the careful one (careful.py): each one mistake, as it is met in real drivers.

`MUTANTS` has for each, in words, the rule that must find it and its change: a text and its replacement, or the text of
functions that take the place of the careful one's.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

from conformance import careful
from conformance.careful import Careful

SOURCE = Path(careful.__file__).read_text("utf-8")
KEEPS = "    def __init__(self, *, host='127.0.0.1', port=4000):\n        self.first_init(host=host, port=port)\n        {}\n"


def sends(change: str) -> tuple[str, str]:
    """Another request in place of `request`."""
    return "self.connection.sendall(request)", f"self.connection.sendall({change})"


def writes(change: str) -> str:
    """Another list of levels in place of `raws`, in `write` and `write_many`."""
    return (
        "    right_write = write_raws\n\n    def write_raws(self, channels, raws):\n        raws = list(raws)\n"
        f"        {change}\n        self.right_write(channels, raws)\n"
    )


def writes_many(change: str) -> str:
    """As `writes`, in `write_many` alone."""
    return (
        "    def write_many(self, channels, raws):\n        raws = raws.tolist()\n"
        f"        {change}\n        self.write_raws(channels, raws)\n"
    )


def reads(change: str) -> tuple[str, str]:
    """Another reading in place of `raw` of the channel `c`."""
    return "                out[i] = raw\n", f"                c = channels[i]\n                out[i] = {change}\n"


def reads_many(change: str) -> str:
    """A change of `out` after a block was read."""
    return (
        "    right_read = read_many\n\n    def read_many(self, channels, out):\n"
        f"        self.right_read(channels, out)\n        {change}\n"
    )


def exchanges(body: str) -> str:
    """Another `exchange`; `self.once(function, channels, raws)` is the right one."""
    return f"    once = exchange\n\n    def exchange(self, function, channels, raws):\n{body}"


def initialises(body: str, segment: str = "initialize") -> str:
    return f"    def {segment}(self, channel, default):\n{body}"


Change = tuple[str, str] | str
MUTANTS: dict[str, tuple[str, Change]] = {
    # Values
    "readings above 127 are negative": ("range", reads("raw - 256 if c.bits == 16 and 127 < raw < 256 else raw")),
    "a line feed becomes a carriage return": ("range", sends("request.replace(b'\\n', b'\\r')")),
    "0xFF is doubled, as for telnet": ("range", sends("request.replace(b'\\xff', b'\\xff\\xff')")),
    "XON and XOFF are eaten": ("range", sends("request.translate(None, b'\\x11\\x13')")),
    "the eighth bit is lost": ("range", sends("bytes(each & 0x7f for each in request)")),
    "a scale that truncates": ("range", writes("raws = [int(raw * 0.1 / 0.1) if raw % 7 else raw - (raw > 99) for raw in raws]")),
    "one level is wrong": ("range", writes("raws = [raw ^ (raw == 171) for raw in raws]")),
    "the sign is lost": ("range", writes("raws = [abs(raw) for raw in raws]")),
    "the most negative level is off by one": ("range", writes("raws = [raw + (raw == c.lowest < 0) for c, raw in zip(channels, raws)]")),
    "readings are off by one at a power of two": ("range", reads("raw + (raw == 64)")),
    "even levels only": ("range", writes("raws = [raw & ~1 if 40 < raw < c.highest else raw for c, raw in zip(channels, raws)]")),
    "sign and magnitude in place of two's complement": ("range", reads("-(raw & 2047) - 1 if raw < 0 and raw != -1 else raw")),
    "digits are sent one by one, the fourth is lost": ("range", writes("raws = [raw if abs(raw) < 1000 else raw // 10 * 10 for raw in raws]")),
    "levels are ramped by 500": ("range", writes("self.at = {**getattr(self, 'at', {})}; raws = [max(self.at.get(c, raw) - 500, min(raw, self.at.get(c, raw) + 500)) for c, raw in zip(channels, raws)]; self.at |= dict(zip(channels, raws))")),
    "a reading is that of the call before": (
        "fresh", reads("self.__dict__.setdefault('last', {}).setdefault(c, raw); self.last[c], out[i] = raw, self.last[c]; pass; out[i] = out[i]")),
    "a level beyond the range is wrapped in blocks": ("one beyond", writes_many("raws = [r & 255 if c.highest == 255 else r for c, r in zip(channels, raws)]")),
    "a level beyond the range is refused after its end was sent": (
        "one beyond", writes("[self.exchange(WRITE, (c,), [c.highest]) for c, r in zip(channels, raws) if r > c.highest]")),
    "a refused level leaves zero": ("one beyond", writes("[self.exchange(WRITE, (c,), [0]) for c, r in zip(channels, raws) if not c.lowest <= r <= c.highest]")),
    "a write to an input goes to an output": ("directions", writes("channels = [self.channel('out:1') if c.direction is Direction.INPUT else c for c in channels]")),
    "a text with something behind it is a channel": ("channels", ("not number.isdecimal()", "not number[:1].isdecimal()")),
    "an unknown channel is a ValueError": ("channels", ("raise ChannelError(text, [f", "raise ValueError(text, [f")),
    "two channels of one text are not equal": ("channels", ("@dataclass(frozen=True)", "@dataclass(frozen=True, eq=False)")),
    "the name of the device has the number of the object": ("before open", ('[f"device tcp', '[f"{id(self)} device tcp')),
    # Blocks
    "two channels of a block are exchanged": ("block write", writes_many("raws[:2] = raws[1::-1] if len(raws) > 2 else raws[:2]")),
    "the second of a block of two is dropped": ("block write", writes_many("channels, raws = (channels[:1], raws[:1]) if len(raws) == 2 else (channels, raws)")),
    "a block of two is sent the wrong way round": ("block write", writes_many("raws = raws[::-1] if len(raws) == 2 else raws")),
    "the last of a block is not sent if it is zero": ("block write", writes_many("channels, raws = (channels[:-1], raws[:-1]) if len(raws) > 1 and not raws[-1] else (channels, raws)")),
    "a block sends the levels of the block before": ("block write", writes_many("self.held, raws = raws, getattr(self, 'held', raws) if len(getattr(self, 'held', raws)) == len(raws) else raws")),
    "two readings of a block are exchanged": ("block read", reads_many("out[1:3] = out[2:0:-1].copy() if len(channels) > 3 else out[1:3]")),
    "a block of two reads the first twice": ("block read", reads_many("out[1:2] = out[:1] if len(channels) == 2 else out[1:2]")),
    "zero is not filled in": ("block read", reads("raw or (0 if len(channels) == 1 else out[i])")),
    "an empty block is an error": ("block read", reads_many("channels[0]")),
    "write_many keeps its array": ("block buffers", "    mine = None\n\n    def write_many(self, channels, raws):\n        if self.mine is None or len(self.mine) != len(raws):\n            self.mine = raws\n            return self.write_raws(channels, raws.tolist())\n        late, self.mine = self.mine.tolist(), raws\n        self.write_raws(channels, raws.tolist() if late == raws.tolist() else late)\n"),
    "readings go to the array of an earlier call": ("block buffers", "    own = None\n    right = read_many\n\n    def read_many(self, channels, out):\n        self.own = out if self.own is None or len(self.own) != len(out) else self.own\n        self.right(channels, self.own)\n        out[:] = self.own\n"),
    "a block that fails names the last channel": ("block failures", ("raise ChannelsFailed(failed)", "raise ChannelsFailed({channels[-1].text: 'failed'})")),
    "a block that fails leaves wrong readings": ("block failures", ("            if not status:\n                out[i] = raw\n", "            out[i] = raw if not any(s for s, _ in answer) else 0\n")),
    # Segments
    "open moves an output": ("glitch", ("        self.begin()\n        self.connect()\n", "        self.begin()\n        self.connect()\n        self.exchange(WRITE, (self.channel('out:0'),), [1])\n")),
    "initialise does nothing": ("initialise", initialises("        pass\n")),
    "initialise goes over the highest level": ("glitch", initialises("        if default is not None:\n            self.write(channel, channel.highest)\n            self.write(channel, default)\n")),
    "reset goes through zero": ("glitch", initialises("        if default is not None:\n            self.write(channel, 0)\n            self.write(channel, default)\n", "reset")),
    "initialise of an input switches an output": ("initialise", initialises("        if default is None:\n            self.write(self.channel('out:1'), 9)\n        else:\n            self.write(channel, default)\n            self.write(self.channel('out:1'), 9 if channel.number != 1 else default)\n")),
    "reset steps towards the default": ("reset", initialises("        if default is not None:\n            self.write(channel, min(default + 1, channel.highest))\n", "reset")),
    "reset of a default of zero is left out": ("reset", initialises("        if default:\n            self.write(channel, default)\n", "reset")),
    "reset resets the first output": ("reset", initialises("        if default is not None:\n            self.write(channel, default)\n            self.write(self.channel('out:0'), 5)\n", "reset")),
    "close fails if it is not open": ("reopen", ("    def close(self) -> None:\n", "    def close(self) -> None:\n        if not self.is_open:\n            raise DriverError('not open')\n")),
    "it can be opened once": ("reopen", ("        self.is_open = True\n", "        if self.number:\n            raise DriverError('opened before')\n        self.is_open = True\n")),
    # Time
    "the timeout is taken for milliseconds": ("timeout", ("monotonic() + self.timeout", "monotonic() + self.timeout * 1000")),
    "the timeout is a constant": ("timeout", ("monotonic() + self.timeout", "monotonic() + 1.0")),
    "the timeout is cut to a tenth of a second": ("patience", ("monotonic() + self.timeout", "monotonic() + min(self.timeout, 0.04)")),
    "the deadline begins anew with each part": ("one deadline", ("self.connection.settimeout(self.left())\n            try:", "self.connection.settimeout(self.timeout)\n            try:")),
    "header and rest have a deadline each": ("one deadline", ("data = self.receive(size(count))", "data = self.receive(4)\n        self.deadline = monotonic() + self.timeout\n        data += self.receive(size(count) - 4)")),
    "a timeout is a DriverError": ("timeout", ('raise DeviceTimeout("timed out") from None', 'raise DriverError("timed out") from None')),
    "a write does not wait for its answer": ("timeout", "    def write_raws(self, channels, raws):\n        self.begin()\n        self.number = self.number % 65535 + 1\n        self.drop()\n        self.connect()\n        self.send(frame(self.number, WRITE, [(c.number, raw) for c, raw in zip(channels, raws)]))\n"),
    "a silent device reads zero": ("timeout", exchanges("        try:\n            return self.once(function, channels, raws)\n        except TimeoutError:\n            return [(0, 0)] * len(channels)\n")),
    # Answers
    "the last good reading for a garbled answer": ("short answer", exchanges("        good = self.__dict__.setdefault('good', {})\n        key = function, tuple(channels)\n        try:\n            good[key] = self.once(function, channels, raws)\n        except DriverError as error:\n            if key not in good or isinstance(error, TimeoutError) or function == WRITE:\n                raise\n        return good[key]\n")),
    "only the first byte of the checksum is compared": ("garbled answer", ("CHECK.unpack_from(data, len(data) - 2)[0] != zlib.crc32(data[:-2]) & 0xFFFF", "data[-2] != (zlib.crc32(data[:-2]) >> 8) & 0xFF")),
    "the checksum is compared without the header": ("garbled answer", ("!= zlib.crc32(data[:-2]) & 0xFFFF:", "!= zlib.crc32(data[:-2]) & 0xFFFF and data[4:8] != b'\\0' * 4 and False:")),
    "the number is compared in its low byte": ("late answer", ("    def fits(self, number:", "    def fits(self, number: int, answered: int, its_count: int, function: int, count: int) -> None:\n        self.right_fits(self.number if number != self.number else number, answered, its_count, function, count)\n\n    def right_fits(self, number:")),
    "answers of writes are not looked at": ("garbled answer", ("        self.verify(data, function, count)\n", "        if function == WRITE:\n            return [(0, 0)] * count\n        self.verify(data, function, count)\n")),
    "a garbled answer is a struct.error": ("kind of errors", ('raise DriverError("an answer with a wrong checksum")', "CHECK.unpack(data)")),
    "the end of the connection is an IndexError": ("kind of errors", ('raise DriverError("the device closed the connection")', "part[0]")),
    "an error answer is a timeout": ("error answer", ("raise ChannelsFailed(failed)", "raise DeviceTimeout('failed')")),
    "an error answer reads zero": ("error answer", ("raise ChannelsFailed(failed)", "pass")),
    # Requests
    "a timeout is tried again": ("retry", exchanges("        start, self.timeout = self.timeout, self.timeout / 2\n        try:\n            try:\n                return self.once(function, channels, raws)\n            except TimeoutError:\n                return self.once(function, channels, raws)\n        finally:\n            self.timeout = start\n")),
    "a lost connection is tried again": ("retry", exchanges("        try:\n            return self.once(function, channels, raws)\n        except TimeoutError:\n            raise\n        except OSError:\n            return self.once(function, channels, raws)\n")),
    "a garbled write is tried again": ("retry", exchanges("        try:\n            return self.once(function, channels, raws)\n        except DriverError as error:\n            if 'checksum' not in str(error) or function != WRITE:\n                raise\n            return self.once(function, channels, raws)\n")),
    "a refused write is tried again": ("retry", exchanges("        answer = self.once(function, channels, raws)\n        return self.once(function, channels, raws) if function == WRITE and any(s for s, _ in answer) else answer\n")),
    "each write is sent until it fits": ("retry", exchanges("        for left in range(3):\n            try:\n                return self.once(function, channels, raws)\n            except TimeoutError:\n                raise\n            except OSError:\n                if not left:\n                    continue\n                raise\n        raise DriverError('no')\n")),
    # The device
    "readings are kept for 200 ms": ("vanish", "    once = read_many\n\n    def read_many(self, channels, out):\n        kept = self.__dict__.setdefault('kept', {})\n        key = tuple(channels)\n        if key in kept and monotonic() - kept[key][0] < 0.2 and all(c.direction is Direction.INPUT and c.number > 39 or len(channels) == 1 and c.number < 0 for c in channels):\n            out[:] = kept[key][1]\n            return\n        self.once(channels, out)\n        kept[key] = monotonic(), list(out)\n"),
    "a device that is away reads the last values": ("vanish", "    once = read_many\n\n    def read_many(self, channels, out):\n        kept = self.__dict__.setdefault('kept', {})\n        key = tuple(channels)\n        try:\n            self.once(channels, out)\n        except (ConnectionError, FileNotFoundError):\n            if key not in kept:\n                raise\n            out[:] = kept[key]\n        kept[key] = list(out)\n"),
    "a connection that was lost is not made again": ("vanish", ("        if self.connection is None:\n            try:", "        if self.connection is None:\n            if self.number > 1:\n                raise DriverError('the connection was lost')\n            try:")),
    "a failed open cannot be repeated": ("vanish", "    stuck = False\n    right_open = open\n\n    def open(self):\n        if self.stuck:\n            raise DriverError('it is opening')\n        self.stuck = True\n        self.right_open()\n        self.stuck = False\n"),
    "a shadow of a byte overwrites another client's bits": ("two clients", "    def write_raws(self, channels, raws):\n        both = [self.channel('out:0'), self.channel('out:1')]\n        shadow = self.__dict__.setdefault('shadow', {})\n        if not set(channels) <= {*both, self.channel('io:0')} or any(not c.lowest <= r <= c.highest for c, r in zip(channels, raws)):\n            raise DriverError('no')\n        if not shadow:\n            shadow |= {c: raw for c, (_, raw) in zip(both, self.exchange(READ, both, [0, 0]))}\n        levels = shadow | dict(zip(channels, raws))\n        self.check(list(levels), self.exchange(WRITE, list(levels), list(levels.values())))\n        self.shadow = {c: levels[c] for c in both}\n"),
    # The process
    "a busy wait": ("idle", ("            self.connection.settimeout(self.left())\n            try:", "            while not select.select([self.connection], [], [], 0)[0]:\n                self.left()\n            try:")),
    "a thread that spins": ("idle", "    right_open = open\n\n    def open(self):\n        import threading\n        self.right_open()\n        threading.Thread(target=self.spin, daemon=True).start()\n\n    def spin(self):\n        while self.is_open:\n            pass\n"),
    "Ctrl-C is a failure": ("interrupt", ("        except OSError:\n            self.drop()\n            raise\n", "        except BaseException as error:\n            self.drop()\n            raise error if isinstance(error, OSError) else DriverError('failed') from None\n")),
    "Ctrl-C is passed over": ("interrupt", exchanges("        try:\n            return self.once(function, channels, raws)\n        except KeyboardInterrupt:\n            return self.once(function, channels, raws)\n")),
    "it prints": ("process", reads("print('reading') or raw")),
    "it sets the default timeout of all sockets": ("process", ("        self.is_open = True\n", "        self.is_open = True\n        socket.setdefaulttimeout(5.0)\n")),
    # What adds up
    "a socket is left by an open that was not answered": ("descriptors", "    left_open = []\n    right_open = open\n\n    def open(self):\n        self.right_open()\n        kept = self.connection\n        try:\n            self.exchange(READ, (self.channel('in:8'),), [0])\n        except OSError:\n            self.left_open.append(kept.dup() if kept.fileno() >= 0 else socket.socket())\n            raise\n"),
    "a socket is left each time it is opened": ("descriptors", "    left_open = []\n\n    def close(self):\n        self.is_open = False\n        if self.connection is not None:\n            self.left_open.append(self.connection.dup())\n        self.drop()\n"),
    "a timer is left each time it is opened": ("threads", "    timers = []\n    right_open = open\n\n    def open(self):\n        import threading\n        self.right_open()\n        self.timers.append(threading.Timer(60, print))\n        self.timers[-1].daemon = True\n        self.timers[-1].start()\n"),
    "wrong after 200 transfers": ("long run", reads("raw + (self.number > 200 and c.number < 40)")),
    "a number that wraps after 150 requests": ("long run", ("self.number % 65535 + 1", "self.number + 1 if self.number < 150 else self.nothing")),
    "every 97th call fails": ("long run", exchanges("        if self.number % 97 == 96:\n            self.number += 1\n            raise DriverError('busy')\n        return self.once(function, channels, raws)\n")),
    "memory of C is left by each reading": ("long run", reads("self.__dict__.setdefault('ctypes', __import__('ctypes')).memset(self.ctypes.CDLL(None).malloc(4000), 1, 4000) and raw")),
    "an error keeps its frames": ("memory", ("            raise ChannelsFailed(failed)\n", "            error = ChannelsFailed(failed)\n            raise error\n")),
    "failures are noted in a list": ("memory", ("            raise ChannelsFailed(failed)\n", "            self.__dict__.setdefault('notes', []).append(dict(failed, a='x' * 50))\n            raise ChannelsFailed(failed)\n")),
    "requests are kept": ("memory", sends("(self.__dict__.setdefault('sent', []).append(request), request)[1]")),
    "a reading is an array": ("readings", ("        return out[0]\n", "        import numpy as np\n\n        return np.int64(out[0])\n")),
}
NEEDS = {"memory of C is left by each reading": 800, "every 97th call fails": 100, "requests are kept": 300,
         "failures are noted in a list": 300, "an error keeps its frames": 300}
"""Cycles in which a mistake of what adds up shows."""


def mutant(words: str) -> type[Careful]:
    """The careful driver with this change."""
    change = MUTANTS[words][1]
    if isinstance(change, str):
        if "self.first_init" in change:
            change = f"    first_init = __init__\n\n{change}"
        text = f"{SOURCE}\n{change}"
    else:
        assert SOURCE.count(change[0]) >= 1, f"{words}: careful.py has changed"
        text = SOURCE.replace(*change)
    module = ModuleType("conformance.mutant")
    sys.modules[module.__name__] = module  # dataclasses look there
    exec(compile(text, careful.__file__, "exec"), module.__dict__)
    made: type[Careful] = module.Careful
    made.__name__ = words
    return made
