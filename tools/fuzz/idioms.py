"""What controls engineers write: each idiom has attributes of its own, and an output, or a name, for the rest."""

from __future__ import annotations

from collections.abc import Sequence

from tools.fuzz.writer import WriteLines, Writer


def debounced(w: Writer) -> list[str]:
    count, out = w.field("seen", "0"), w.field("stable", "False")
    return [f"{count} = min({count} + 1, 5) if {w.truth(1)} else 0", f"{out} = {count} >= {w.pick('2', '3')}"]


def on_delay(w: Writer) -> list[str]:
    left, out = w.field("delay", "3"), w.field("done", "False")
    return [f"if {w.truth(1)}:", f"    if {left} > 0:", f"        {left} -= 1", "else:", f"    {left} = 3",
            f"{out} = {left} == 0"]  # fmt: skip


def off_delay_in_seconds(w: Writer) -> list[str]:
    since, out = w.field("since", "0.0"), w.field("runs_on", "False")
    return [f"{since} = 0.0 if {w.truth(1)} else {since} + self.dt", f"{out} = {since} < {w.pick('0.004', '0.01')}"]


def deadline(w: Writer) -> list[str]:
    since = w.field("begun", "None")
    return [f"if {w.truth(1)}:", f"    {since} = None", f"elif {since} is None:", f"    {since} = self.now",
            f"self.yes = {since} is not None and self.now - {since} > 0.005"]  # fmt: skip


def ramp(w: Writer) -> list[str]:
    out, step = w.field("ramp", "0.0"), w.new("step")
    return [f"{step} = {w.pick('20.0', '350.0')} * self.dt",
            f"{out} += max(-{step}, min({step}, {w.real(1)} - {out}))", f"self.a.write({out})"]  # fmt: skip


def filtered(w: Writer) -> list[str]:
    out = w.field("smooth", "0.0")
    return [f"{out} += ({w.real(1)} - {out}) * self.dt / ({w.pick('0.01', '0.003')} + self.dt)", f"self.s = {out}"]


def moving_average(w: Writer) -> list[str]:
    ring, at = w.field("ring", "[0.0] * 4"), w.field("at", "0")
    return [f"{ring}[{at}] = {w.real(1)}", f"{at} = ({at} + 1) % len({ring})", f"self.t = sum({ring}) / len({ring})"]


def moving_sum(w: Writer) -> list[str]:
    ring, at, total = w.field("ring", "[0] * 3"), w.field("at", "0"), w.field("total", "0")
    return [f"{total} -= {ring}[{at} % 3]", f"{ring}[{at} % 3] = {w.whole(1)} % 1000", f"{total} += {ring}[{at} % 3]",
            f"{at} += 1"]  # fmt: skip


def dead_time(w: Writer) -> list[str]:
    late = w.field("late", "(0.0, 0.0, 0.0)")
    return [f"{late} = (*{late}[1:], {w.real(1)})", f"self.b.write({late}[0])"]


def median(w: Writer) -> list[str]:
    one, two, three = w.new("one"), w.new("two"), w.new("three")
    return [f"{one}, {two}, {three} = {w.real(1)}, {w.real(1)}, {w.real(0)}",
            f"self.s = max(min({one}, {two}), min(max({one}, {two}), {three}))"]  # fmt: skip


def two_out_of_three(w: Writer) -> list[str]:
    out, votes = w.field("trip", "False"), w.new("votes")
    return [f"{votes} = ({w.truth(1)}) + ({w.truth(1)}) + ({w.truth(0)})", f"{out} = {out} or {votes} >= 2",
            f"if {w.truth(0)} and {votes} == 0:", f"    {out} = False"]  # fmt: skip


def interpolated(w: Writer) -> list[str]:
    x, y = w.new("x"), w.new("y")
    return [f"{x} = {w.real(1)}", f"{y} = CURVE[0][1]", "for (low, first), (high, last) in zip(CURVE, CURVE[1:]):",
            f"    if low <= {x} < high:", f"        {y} = first + ({x} - low) * (last - first) / (high - low)",
            "        break", "else:", f"    {y} = CURVE[0][1] if {x} < CURVE[0][0] else CURVE[-1][1]",
            f"self.s = {y}"]  # fmt: skip


def selected(w: Writer) -> list[str]:
    best, which, number, each = (w.new(stem) for stem in ("best", "which", "k", "e"))
    return [f"{best}, {which} = {w.pick('-math.inf', 'self.row[0]')}, -1",
            f"for {number}, {each} in enumerate({w.pick('self.row', 'self.recent')}):", f"    if {each} > {best}:",
            f"        {best}, {which} = {each}, {number}", f"self.c = {which}"]  # fmt: skip


def latched(w: Writer) -> list[str]:
    alarm, seen = w.field("alarm", "False"), w.field("seen", "True")
    return [f"if {w.truth(1)} and not {alarm}:", f"    {alarm}, {seen} = True, False",
            f"if {w.truth(0)}:", f"    {seen} = True",
            f"{alarm} = {alarm} and not ({seen} and {w.truth(0)})"]  # fmt: skip


def two_point(w: Writer) -> list[str]:
    out, value = w.field("heats", "False"), w.new("value")
    return [f"{value} = {w.real(1)}", f"if {value} < self.low:", f"    {out} = True", f"elif {value} > self.high:",
            f"    {out} = False", f"self.fan.write(OnOff.ON if {out} else OnOff.OFF)"]  # fmt: skip


def pid(w: Writer) -> list[str]:
    integral, before = w.field("integral", "0.0"), w.field("before", "0.0")
    error, out = w.new("error"), w.new("out")
    return [f"{error} = {w.real(1)} - {w.real(1)}", f"{integral} += 0.3 * {error} * self.dt",
            f"{out} = 0.8 * {error} + {integral} + 0.01 * ({error} - {before}) / self.dt + 0.1 * {w.real(0)}",
            f"{before} = {error}", f"if abs({out}) > 10.0:", f"    {integral} -= 0.3 * {error} * self.dt",
            f"self.a.write(max(-10.0, min(10.0, {out})))"]  # fmt: skip


def umo_pid(w: Writer) -> list[str]:
    law = w.field("law", f"PID(gain={w.pick('0.2', '-1.5')}, integral_time={w.pick('0.5', '0.05')})")
    feed = w.pick("", f", feed_forward={w.real(0)}")
    return [f"self.b.write({law}.step({w.real(1)}, {w.real(1)}, self.dt{feed}, low=-10.0, high=10.0))"]


def umo_servo(w: Writer) -> list[str]:
    servo = w.field("servo", "Servo(self.x, self.a, gain=0.2, integral_time=0.6)")
    return [f"self.yes = {servo}.control({w.real(1)}, dt=self.dt)"]


def umo_hysteresis(w: Writer) -> list[str]:
    law = w.field("regulator", "Hysteresis(self.x, self.fan, low=10.0, high=30.0, raising=OnOff.ON)")
    return [f"self.yes = {law}.control() is OnOff.ON"]


def sequence(w: Writer) -> list[str]:
    step, age = w.field("step", "0"), w.field("age", "0")
    before = w.new("before")
    return [f"{before} = {step}", f"match {step}:", "    case 0:", f"        {step} = 1 if {w.truth(1)} else 0",
            "    case 1:", f"        {step} = 2 if {w.truth(1)} or {age} > 4 else 1", "    case 2 | 3:",
            f"        {step} += 1", "    case _:", f"        {step} = 0",
            f"{age} = {age} + 1 if {step} == {before} else 0"]  # fmt: skip


def state_machine(w: Writer) -> list[str]:
    age = w.field("age", "0")
    return ["if self.mode is Mode.OFF:", f"    if {w.truth(1)}:", f"        self.mode, {age} = Mode.HEAT, 0",
            "elif self.mode is Mode.HEAT:", f"    {age} += 1", f"    if {age} >= 3 or {w.truth(0)}:",
            "        self.mode = Mode.COOL", "else:",
            f"    self.mode = Mode.OFF if {w.truth(1)} else self.mode"]  # fmt: skip


def text_machine(w: Writer) -> list[str]:
    return [f"if self.phase == 'idle' and {w.truth(1)}:", "    self.phase = 'heat'", "elif self.phase == 'heat':",
            f"    self.phase = 'hold' if {w.truth(1)} else 'heat'", f"elif {w.truth(0)}:", "    self.phase = 'idle'",
            "self.a.write(POWERS[self.phase])"]  # fmt: skip


def edges(w: Writer) -> list[str]:
    before, count, now = w.field("before", "False"), w.field("edges", "0"), w.new("now")
    return [f"{now} = {w.truth(1)}", f"if {now} and not {before}:", f"    {count} += 1", f"{before} = {now}",
            f"self.yes = {count} % 2 == 1"]  # fmt: skip


def pulse_width(w: Writer) -> list[str]:
    tick = w.field("tick", "0")
    return [f"{tick} = ({tick} + 1) % 10", f"self.fan.write(OnOff.ON if {tick} < {w.real(1)} * 10.0 else OnOff.OFF)"]


def alarm_word(w: Writer) -> list[str]:
    word = w.field("word", "0")
    return [f"{word} = ({word} << 1 | {w.truth(1)}) & 0xFF", f"self.c = {word} ^ ({word} >> 1)",
            f"self.yes = bool({word} & 0x81)"]  # fmt: skip


def checksum(w: Writer) -> list[str]:
    total, each = w.new("crc"), w.new("e")
    return [f"{total} = 0", f"for {each} in self.cells:", f"    {total} ^= {each} & 0xFF", "    for _ in range(4):",
            f"        {total} = ({total} >> 1) ^ 0x8C if {total} & 1 else {total} >> 1",
            f"self.d = {total}"]  # fmt: skip


def totalizer(w: Writer) -> list[str]:
    total, turns = w.field("total", "0.0"), w.field("turns", "0")
    return [f"{total} += {w.real(1)} * self.dt", f"while 1.0 <= {total} < 50.0:", f"    {total} -= 1.0",
            f"    {turns} += 1"]  # fmt: skip


def gain_scheduled(w: Writer) -> list[str]:
    return [f"self.s = GAINS[self.mode] * {w.real(1)} + TABLE[self.level]",
            f"self.level = Level.SOME if {w.truth(1)} else self.level"]  # fmt: skip


def retried(w: Writer) -> list[str]:
    left = w.field("retries", "3")
    return ["try:", f"    self.s = {w.real(1)} / {w.real(1)}", f"    {left} = 3", "except ZeroDivisionError:",
            f"    {left} -= 1", f"    if {left} < 0:", "        raise"]  # fmt: skip


def guarded_input(w: Writer) -> list[str]:
    kept, value = w.field("kept", "0.0"), w.new("value")
    return ["try:", f"    {value} = value_of(self.{w.pick('x', 'y')})", f"    {kept} = {value}", "except BadInput:",
            f"    {value} = {kept}", f"self.a.write({value} * 0.1)"]  # fmt: skip


def split_range(w: Writer) -> list[str]:
    out = w.new("out")
    return [f"{out} = max(-1.0, min(1.0, {w.real(1)}))", f"self.a.write(max(0.0, {out}) * 10.0)",
            f"self.b.write(-min(0.0, {out}) * 10.0)"]  # fmt: skip


def dead_band(w: Writer) -> list[str]:
    value = w.new("value")
    return [f"{value} = {w.real(1)}", f"self.s = 0.0 if abs({value}) < 0.5 else {value} - math.copysign(0.5, {value})"]


def peak_hold(w: Writer) -> list[str]:
    peak = w.field("peak", "-math.inf")
    return [f"{peak} = max({peak} - 0.25, {w.real(1)})", f"self.t = {peak}"]


def alternated(w: Writer) -> list[str]:
    hours, leads = w.field("hours", "[0.0, 0.0]"), w.field("leads", "0")
    return [f"if {w.truth(1)}:", f"    {leads} = 0 if {hours}[0] <= {hours}[1] else 1", f"{hours}[{leads}] += self.dt"]


def vector_written(w: Writer) -> list[str]:
    both = w.field("both", "Vector([self.a, self.b])")
    return [f"self.yes = {both}.write(np.array([{w.real(1)}, {w.real(0)}]))"]


def rate_of_change(w: Writer) -> list[str]:
    before, value = w.field("previous", "None"), w.new("value")
    return [f"{value} = {w.real(1)}", f"if {before} is not None and abs({value} - {before}) / self.dt > 1000.0:",
            "    self.c += 1", f"{before} = {value}"]  # fmt: skip


def lead_lag(w: Writer) -> list[str]:
    state = w.field("lag", "Pair(0.0, 0.0)")
    return [f"{state} = Pair({w.real(1)}, 0.75 * {state}.second + 0.25 * {state}.first)", f"self.s = {state}.second"]


def shifted_window(w: Writer) -> list[str]:
    window, rest = w.field("window", "[0.0, 0.0, 0.0]"), w.new("rest")
    return [f"_, *{rest} = {window}", f"{window}[:] = [*{rest}, {w.real(1)}]", f"self.t = {rest}[0] - {window}[2]"]


def chosen_by_set(w: Writer) -> list[str]:
    number = w.whole(1)
    return [f"if self.mode in {{Mode.HEAT, Mode.COOL}} or {number} in {w.pick('{1, 2, -3}', '{0, 2.0}', '{True}')}:",
            "    self.c = (self.c + 1) % 50"]  # fmt: skip


IDIOMS: Sequence[WriteLines] = [
    debounced, on_delay, off_delay_in_seconds, deadline, ramp, filtered, moving_average, moving_sum, dead_time, median,
    two_out_of_three, interpolated, selected, latched, two_point, pid, umo_pid, umo_servo, umo_hysteresis, sequence,
    state_machine, text_machine, edges, pulse_width, alarm_word, checksum, totalizer, gain_scheduled, retried,
    guarded_input, split_range, dead_band, peak_hold, alternated, vector_written, rate_of_change, lead_lag,
    shifted_window, chosen_by_set,
]  # fmt: skip
