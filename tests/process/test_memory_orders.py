"""What umo's own functions do in shared memory, in every order that x86-64 and ARM allow (`tools/memory_orders`)."""

from __future__ import annotations

from typing import Any

import pytest

from tools.memory_orders import worker_protocols
from tools.memory_orders.cases import CASES, Case, of_case, of_mutant
from tools.memory_orders.explore import Model, TooMany, explore
from tools.memory_orders.machines import Arm, Machine, Tso
from tools.memory_orders.mutants import MUTANTS, Mutant
from tools.memory_orders.sizes import small
from tools.memory_orders.threads import Access, Shape, Thread
from tools.planted_faults import Edit, edited
from umo.process.start import LINUX
from umo.system.shared_cells import SharedText

pytestmark = pytest.mark.skipif(not LINUX, reason="machines run in other processes on Linux only")

ORDERS = [pytest.param(case, machine, id=f"{case.name}, {machine.name}",
                       marks=[] if machine in case.quick_machines else pytest.mark.full)
          for case in CASES for machine in case.machines]  # fmt: skip
PLANTED = [
    pytest.param(mutant, machine, id=f"{mutant.what}, {machine.name}",
                 marks=[] if machine in mutant.quick_machines else pytest.mark.full)
    for mutant in MUTANTS for machine in mutant.machines
]  # fmt: skip


@pytest.mark.parametrize(("case", "machine"), ORDERS)
def test_no_reader_takes_for_true_what_nobody_has_written_as_a_whole(case: Case, machine: type[Machine]) -> None:
    assert bool(of_case(case, machine).broken) is (machine in case.breaks)


@pytest.mark.parametrize(("mutant", "machine"), PLANTED)
def test_a_step_that_is_left_out_or_swapped_is_found(mutant: Mutant, machine: type[Machine]) -> None:
    assert bool(of_mutant(mutant, machine).broken) is (machine in mutant.found)


# The checker itself -------------------------------------------------------------------------------------

PLACES = Shape(16, {0: "x", 8: "y"})


def stores(*places: int) -> Any:
    def call(memory: Access, _: Any) -> None:
        for place in places:
            memory.store(8 * place, (1).to_bytes(8, "little"))

    return call


def loads(*places: int) -> Any:
    return lambda memory, _: tuple(memory.load(8 * place, 8 * place + 8)[0] for place in places)


def copies(memory: Access, _: Any) -> Any:
    """Both places in one copy."""
    return tuple(memory.load(0, 16)[::8])


def stores_then_loads(own: int, other: int) -> Any:
    def call(memory: Access, _: Any) -> Any:
        stores(own)(memory, None)
        return loads(other)(memory, None)

    return call


def outcomes(machine: type[Machine], *calls: Any) -> set[Any]:
    """What the threads that make these calls may have read at the end."""
    found = set()

    def final(memory: Access, results: Any) -> None:
        found.add(tuple(each for each in results if each is not None))

    explore(Model(PLACES, [Thread(str(number), [call]) for number, call in enumerate(calls)], final), machine)
    return found


def test_the_machines_order_stores_and_loads_as_their_manuals_say() -> None:
    """The litmus tests MP (message passing), SB (store buffering) and CoRR (coherence)."""
    writer = stores(0, 1)
    assert outcomes(Tso, writer, loads(1, 0)) == {((0, 0),), ((0, 1),), ((1, 1),)}
    assert ((1, 0),) in outcomes(Arm, writer, loads(1, 0))
    assert ((0, 1),) in outcomes(Tso, writer, copies)  # the words of one copy are loaded in any order
    for machine in (Tso, Arm):
        assert ((0,), (0,)) in outcomes(machine, stores_then_loads(0, 1), stores_then_loads(1, 0))
        assert outcomes(machine, stores(0), loads(0, 0)) == {((0, 0),), ((0, 1),), ((1, 1),)}


def test_a_lock_and_a_wait_are_fences_on_both_machines() -> None:
    def locked(memory: Access, known: Any) -> Any:
        memory.do("lock")
        before = memory.load(0, 8)[0]
        memory.store(0, (before + 1).to_bytes(8, "little"))
        memory.do("unlock")
        return before

    def waits(memory: Access, known: Any) -> Any:
        seen = loads(1)(memory, None)
        memory.do("pause")
        return seen + loads(0)(memory, None)

    for machine in (Tso, Arm):
        assert outcomes(machine, locked, locked) == {(0, 1), (1, 0)}
        assert ((1, 0),) not in outcomes(machine, stores(0, 1), waits)


def test_a_lock_ends_with_the_death_of_its_holder() -> None:
    def locked(memory: Access, known: Any) -> Any:
        memory.do("lock")
        memory.store(0, bytes([1] * 8))
        memory.do("unlock")
        return 1

    ends = set()
    threads = [Thread("a", [locked], killable=True), Thread("b", [locked])]
    for machine in (Tso, Arm):
        explore(Model(PLACES, threads, lambda memory, results: ends.add(tuple(results))), machine)
    assert ends == {(1, 1), (None, 1)}


def test_a_mutant_of_a_text_that_no_longer_stands_in_the_function_is_an_error() -> None:
    with pytest.raises(AssertionError, match="put no longer has"), edited([Edit(SharedText, "put", ("nothing", ""))]):
        pass


def test_more_states_than_are_allowed_are_an_error() -> None:
    with small(), pytest.raises(TooMany, match="more than 100 states"):
        explore(worker_protocols.texts(), Tso, most=100)
