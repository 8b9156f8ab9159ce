"""What was once translated wrongly, as statements for programs at random: each is equal in C, or it is refused."""

from __future__ import annotations

from collections.abc import Sequence

from tools.fuzz.writer import WriteLines, Writer


def real_in_whole_list(w: Writer) -> list[str]:
    return [f"self.cells[1] = {w.real(1)}", f"self.s += self.cells[1] * {w.real(0)}"]


def number_in_bool_list(w: Writer) -> list[str]:
    return [f"self.marks[0] = {w.whole(1)}", "self.c = self.marks[0] + 1"]


def mixed_sign(w: Writer) -> list[str]:
    return [f"self.s = -{w.pick('max', 'min')}(0, {w.real(1)})"]


def mixed_name(w: Writer) -> list[str]:
    name = w.new("m")
    return [f"{name} = 0", f"if {w.truth(1)}:", f"    {name} = {w.real(1)} * 1.0", f"self.s = {name} * {w.whole(0)}",
            f"self.t = {w.pick('-', '', '1.0 * ')}{name}"]  # fmt: skip


def alias_of_a_list(w: Writer) -> list[str]:
    w.once("self.same = self.row")
    return [f"self.row[0] = {w.real(1)} * 1.0", "self.s += self.same[0]"]


def view_of_an_array(w: Writer) -> list[str]:
    w.once("self.head = self.other[:2]")
    return [f"self.other[1] = {w.real(1)}", "self.s += float(self.head[1])"]


def alias_of_an_object(w: Writer) -> list[str]:
    w.once("self.twin = self.part")
    return [f"self.twin.gain = {w.real(1)} * 1.0", "self.s = self.part.gain * 1.0"]


def local_alias(w: Writer) -> list[str]:
    name = w.new("z")
    return [f"{name} = self.{w.pick('row', 'array')}", f"self.row[1] = {w.real(1)} * 1.0",
            f"self.array[1] = {w.real(1)}", f"self.s = float({name}[1]) * 1.0"]  # fmt: skip


def list_of_a_class(w: Writer) -> list[str]:
    return [f"self.part.shared[0] = {w.real(1)} * 1.0", "self.s = self.spare.shared[0] * 1.0"]


def counter_of_a_class(w: Writer) -> list[str]:
    return ["Part.total += 1", "self.c = self.part.total"]


def frozen_object(w: Writer) -> list[str]:
    return [f"self.frozen.k = {w.real(1)} * 1.0"]


def computed_once(w: Writer) -> list[str]:
    return [f"self.part.gain = {w.real(1)} * 1.0", "self.s = self.part.once * 1.0"]


def setter(w: Writer) -> list[str]:
    return [f"self.part.half = {w.real(1)}", "self.s = self.part.gain * 1.0"]


def place_found_once(w: Writer) -> list[str]:
    return [f"self.cells[self.bump()] {w.pick('+=', '-=')} {w.pick('1', 'self.bump()')}"]


def place_found_first(w: Writer) -> list[str]:
    return ["self.c = self.c % 3", "self.row[self.c] += self.bump() * 1.0"]


def order_of_arguments(w: Writer) -> list[str]:
    return ["self.s = self.pairs(self.c * 1.0, self.bump())[0]", "self.two = (self.bump(), self.c * 1.0)"]


def tuple_then_call(w: Writer) -> list[str]:
    return ["self.s = max((self.c * 1.0, self.bump() * 1.0, self.c * 1.0))"]


def late_name(w: Writer) -> list[str]:
    name = w.new("late")
    return [
        f"for {w.new('k')} in range({w.pick('self.n', 'self.i')} % 3):",
        f"    {name} = {w.real(1)} * 1.0",
        f"self.s = {name} * 1.0",
    ]


def late_name_of_try(w: Writer) -> list[str]:
    name = w.new("late")
    return [
        "try:",
        f"    {name} = 1.0 / {w.real(1)}",
        "except ZeroDivisionError:",
        "    pass",
        f"self.s = {name} * 1.0",
    ]


def late_name_in_finally(w: Writer) -> list[str]:
    name = w.new("late")
    return ["try:", f"    {name} = 1.0 / {w.real(1)}", "finally:", f"    self.s = {name} * 1.0"]


def name_not_asked(w: Writer) -> list[str]:
    name = w.new("walrus")
    return [f"if {w.truth(1)} and ({name} := {w.real(1)} * 1.0) > 0.0:", "    self.c = 1", f"self.s = {name} * 1.0"]


def leaking_name(w: Writer) -> list[str]:
    name = w.new("each")
    return [f"{name} = {w.real(1)} * 1.0", f"self.yes = any({name} > {w.real(0)} for {name} in (2.0, {w.real(0)}))",
            f"self.s = {name} * 1.0"]  # fmt: skip


def none_after_continue(w: Writer) -> list[str]:
    return ["for limit in (1.0, 2.0):", f"    if {w.pick('self.maybe', 'self.last')} is None:", "        continue",
            "    self.t += limit", f"self.s = {w.pick('self.maybe', 'self.last')} + 1.0"]  # fmt: skip


def none_after_a_call(w: Writer) -> list[str]:
    if w.chance(0.5):
        return ["self.last = self.u * 1.0", "self.clears()", "self.s = self.last + 1.0"]
    return ["self.last = self.u * 1.0", "if self.last is not None and self.clears():", "    self.s = self.last + 1.0"]


def returned_in_try(w: Writer) -> list[str]:
    return ["try:", f"    if {w.truth(1)}:", "        return", f"    self.s = {w.real(1)} * 1.0", "finally:",
            "    self.c = (self.c + 1) % 50"]  # fmt: skip


def array_in_a_list(w: Writer) -> list[str]:
    w.once("self.both = [self.array, self.other]")
    return [f"self.array[0] = {w.real(1)}", "for each in self.both:", "    self.s += float(each[0])"]


def list_of_the_module(w: Writer) -> list[str]:
    w.once("self.mine = ROW")
    return [f"self.mine[0] = {w.real(1)} * 1.0", "self.s = ROW[0] * 1.0"]


def returned_list(w: Writer) -> list[str]:
    return [f"self.its_row()[0] = {w.real(1)} * 1.0", "self.s = self.row[0] * 1.0"]


def size_of_an_object(w: Writer) -> list[str]:
    return [f"self.part.count = {w.whole(1)} % 3", f"self.c = {w.pick('len(self.part)', '1 if self.part else 2')}"]


def none_after_a_handler(w: Writer) -> list[str]:
    return ["try:", f"    self.s = self.maybe / {w.real(1)}", "except TypeError:", "    self.s = self.maybe + 1.0"]


def none_assigned(w: Writer) -> list[str]:
    return ["self.last = self.maybe", "self.s = self.last + 1.0"]


def not_none(w: Writer) -> list[str]:
    return ["if self.maybe != None:", "    self.s = self.maybe * 1.0"]


def filtered(w: Writer) -> list[str]:
    return [f"self.yes = all(1.0 / each > {w.real(0)} for each in (self.u, 0.0, {w.real(0)}) if each != 0.0)"]


def rebound_array(w: Writer) -> list[str]:
    return ["for each in self.array:", "    self.s += float(each)", f"    self.array = self.array * {w.real(1)}"]


def range_to_the_end(w: Writer) -> list[str]:
    return [f"for {w.new('k')} in range({w.pick('2147483640', 'self.n')}, 2147483647, {w.pick('5', '1000000007')}):",
            "    self.d = self.d % 1000 + 1", "    if self.d > 50:", "        break"]  # fmt: skip


def range_of_reals(w: Writer) -> list[str]:
    return [f"for {w.new('k')} in range({w.real(0)}):", "    self.c = 2", "    break"]


def small_numbers(w: Writer) -> list[str]:
    w.once("self.small = np.zeros(2, np.int8)")
    return ["self.small = self.small + 100", "self.c = int(self.small[0])"]


def class_of_a_number(w: Writer) -> list[str]:
    name = w.new("kind")
    return [f"{name} = 0", f"if {w.truth(1)}:", f"    {name} = {w.real(1)} * 1.0",
            f"self.c = 1 if isinstance({name}, float) else 2"]  # fmt: skip


def logarithm(w: Writer) -> list[str]:
    return [f"self.s = math.log({w.real(1)}) * 1.0", f"self.t = {w.real(1)} ** {w.real(1)}"]


def nan_among(w: Writer) -> list[str]:
    return [f"self.yes = self.u in (self.u, {w.real(0)})"]


def list_and_tuple(w: Writer) -> list[str]:
    return [f"self.yes = [{w.whole(0)}, 1] == ({w.whole(0)}, 1)"]


def levels(w: Writer) -> list[str]:
    return [f"self.level = Level.SOME if {w.truth(1)} else Level.NONE", "if self.level:", "    self.c = 3",
            f"self.yes = self.level {w.pick('== 1', 'is Level.SOME', '== Level.NONE', '> Level.NONE')}"]  # fmt: skip


def truth_of_a_state(w: Writer) -> list[str]:
    return ["if self.fan.pending:", "    self.c = 3"]


def odd_names(w: Writer) -> list[str]:
    names = w.random.sample(
        ["x", "_x", "x_", "m", "out", "fault", "t1", "n1", "isnan", "double", "umo_max", "NAN", "machine_reals_3",
         "v_x", "sin", "errno", "p0", "py_bump", "k1", "end1"], 4)  # fmt: skip
    lines = [f"{name} = {w.real(1)} * 1.0" for name in names]
    return [*lines, f"self.s = {' - '.join(names)}"]


def message_with_a_call(w: Writer) -> list[str]:
    return [f"if {w.truth(1)}:", "    raise ValueError(f'{self.bump()}')"]


def numpy_bools(w: Writer) -> list[str]:
    return ["self.c = int((self.array[0] > 0.0) + (self.array[1] >= 0.0))"]


def numpy_number(w: Writer) -> list[str]:
    return [f"self.s = float({w.pick('max', 'min')}(self.array[0], self.array[1]) / self.array[2])"]


def returned_array(w: Writer) -> list[str]:
    return ["self.array = self.other", f"self.other = self.array + {w.real(1)}", f"self.other[0] = {w.real(1)}"]


def constant_array(w: Writer) -> list[str]:
    w.once("self.GAINS = np.ones(3)")
    return [f"self.GAINS {w.pick('+=', '*=')} {w.real(1)}", "self.s = float(self.GAINS[0])"]


def deleted(w: Writer) -> list[str]:
    return [w.pick("del self.row[0]", "self.row.append(1.0)", "self.row.sort()", "self.__dict__['s'] = 1.0",
                   "setattr(self, 's', 2.0)", "self.row = [2.0, 3.0, 4.0]", "self.s = self.row.pop()")]  # fmt: skip


def class_of_an_error(w: Writer) -> list[str]:
    told = w.pick("isinstance(error, ZeroDivisionError)", "type(error) is ZeroDivisionError", "hasattr(error, 'args')")
    return [
        "try:",
        f"    self.s = 1.0 / {w.real(1)}",
        "except ArithmeticError as error:",
        f"    self.c = 1 if {told} else 2",
    ]


def late_text(w: Writer) -> list[str]:
    w.once("self.note = ''")
    told = w.pick("self.note == ''", "self.note", "isinstance(self.note, int)")
    return [f"self.a.write(1.0 if {told} else 2.0)", "self.note = 'seen'"]


def bool_as_a_number(w: Writer) -> list[str]:
    given = w.pick(f"max({w.real(1)}, {w.truth(0)})", f"({w.real(1)} or False)", f"(1 if {w.truth(1)} else True)")
    return [f"self.a.write({given})"]


def list_in_a_tuple(w: Writer) -> list[str]:
    w.once("self.inner = ([1, 2], 3.0)")
    return ["self.c = self.inner[0][0]"]


def deques(w: Writer) -> list[str]:
    """Refused on split parts, whose host does not see them."""
    ring, other = w.field("window", "deque([0.0], maxlen=4)"), w.new("ring")
    changed = w.pick(f"append({w.real(1)} * 1.0)", f"appendleft({w.real(1)} * 1.0)", "pop()", "popleft()", "clear()",
                     "rotate(1)", f"extend([{w.real(0)} * 1.0, 2.0])")  # fmt: skip
    return [f"{other} = {ring}", f"if {w.truth(1)}:", f"    {other}.{changed}", "else:",
            f"    {ring}.append({w.real(1)} * 1.0)",
            f"self.s = {w.pick('max({0}, default=0.5)', 'min({0})', 'sum({0})').format(ring)} * 1.0",
            f"self.c = len({other})",
            f"self.t = {ring}[{w.pick('0', '-1', '1', 'self.i')}]"]  # fmt: skip


def limit_before_finally(w: Writer) -> list[str]:
    """What does not fit into 32 bits ends a law, whatever its `finally` raises."""
    return ["try:", f"    self.c = ({w.whole(1)}) * 1000000007", "finally:", f"    self.d = 7 // ({w.whole(1)})"]


HAZARDS: Sequence[WriteLines] = [
    real_in_whole_list, number_in_bool_list, mixed_sign, mixed_name, alias_of_a_list, view_of_an_array,
    alias_of_an_object, local_alias, list_of_a_class, counter_of_a_class, frozen_object, computed_once, setter,
    place_found_once, place_found_first, order_of_arguments, tuple_then_call, late_name, late_name_of_try,
    late_name_in_finally, name_not_asked, leaking_name, none_after_continue, none_after_a_call, none_after_a_handler,
    none_assigned, not_none, filtered, rebound_array, range_to_the_end, range_of_reals, small_numbers,
    class_of_a_number, logarithm, nan_among, list_and_tuple, levels, truth_of_a_state, odd_names, message_with_a_call,
    numpy_bools, numpy_number, returned_array, constant_array, deleted, returned_in_try, array_in_a_list,
    list_of_the_module, returned_list, size_of_an_object, class_of_an_error, late_text, bool_as_a_number,
    list_in_a_tuple, deques, limit_before_finally,
]  # fmt: skip
