"""What a worker process and the control process share: texts, banks, requests and answers. The report of a run and its
outcome are texts, too."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from tools.memory_orders.explore import Model
from tools.memory_orders.threads import Access, Call, Shape, Thread, demand
from umo.drivers.off_cycle.proxy import OffCycle
from umo.drivers.off_cycle.shared_memory import Banks, Cell, Exchange
from umo.process.worker import WorkerProcess
from umo.system.shared_cells import HEAD as TEXT_HEAD
from umo.system.shared_cells import SharedText

# Texts ----------------------------------------------------------------------------------------------------
# src/umo/system/shared_cells.py SharedText. Written: content, then number, size, checksum. Writers: one (report: the
# control process; outcome: the guardian; request: the control process; answer: the worker), which may be killed; then
# the one that has taken its place. Readers: any number.

TEXTS = {0: b"0" * 16, 1: b"first..1" * 2, 2: b"second.2" * 2, 3: b"third..3" * 2}
TEXT_SHAPE = Shape(TEXT_HEAD.size + 16, {0: "number", 8: "size", 16: "checksum", 24: "text a", 32: "text b"})


def texts(readers: int = 1, looks: int = 2) -> Model:
    """Texts of growing number; the first writer may be killed, the next one goes on."""

    def place(memory: Access) -> SharedText:
        return SharedText(memory.view(), 0, TEXT_SHAPE.stops[-1])

    def put(number: int) -> Call:
        def call(memory: Access, _: Any) -> Any:
            memory.do("begin")
            place(memory).put(number, TEXTS[number])
            return number

        return call

    def look(memory: Access, last: Any) -> Any:
        found = place(memory).get()
        if found is None:
            return last
        demand(TEXTS.get(found[0]) == found[1], f"text {found[0]} is torn")
        demand(found[0] >= last, f"text {found[0]} after {last}")
        return found[0]

    def final(memory: Access, results: Sequence[Any]) -> None:
        found = place(memory).get()
        if results[1] is not None:
            demand(found == (3, TEXTS[3]), "the last text is not read")

    return Model(
        TEXT_SHAPE,
        [
            Thread("writer", [put(1), put(2)], killable=True),
            Thread("next writer", [put(3)], after=0),
            *(Thread(f"reader {each}", [look] * looks, 0) for each in range(readers)),
        ],
        final,
    )


# Banks ----------------------------------------------------------------------------------------------------
# src/umo/drivers/off_cycle/shared_memory.py Banks. Written: the bank that is not valid (checksum, count, rows), then
# the count. Writer: the worker (arrivals), which may be killed, then the next; the control process (wanted). Reader:
# the other of the two.

ROWS = (1, 2)
BANKS_AT = 8 * len(Cell)
BANK_NAMES = {BANKS_AT + 8 * (4 * bank + word): f"bank {bank} {name}" for bank in (0, 1)
              for word, name in enumerate(("checksum", "count", "row a", "row b"))}  # fmt: skip


def _rows(number: int) -> Any:
    return np.array([[100 + number, 200 + number]], np.int64)


def banks(readers: int = 1, looks: int = 2, replaced: bool = True) -> Model:
    """The first writer may be killed. `replaced`: the next one goes on."""
    cells, words = np.zeros(len(Cell), np.int64), np.zeros(Banks.words(ROWS), np.int64)
    template = Banks(words, cells, Cell.ARRIVED, _rows(0))
    shape = Shape(
        BANKS_AT + words.nbytes,
        {8 * Cell.ARRIVED: "count", 8 * Cell.ARRIVED + 8: "", **BANK_NAMES},
        cells.tobytes() + words.tobytes(),
    )
    allowed = {0: [_rows(0)], 1: [_rows(1), _rows(3)], 2: [_rows(2), _rows(3)], 3: [_rows(3)]}

    def on(memory: Access, last: bytes = template._last) -> Any:
        half = BANKS_AT + words.nbytes // 2
        mine: Any = copy.copy(template)
        mine._banks = [memory.view(BANKS_AT, half, "q"), memory.view(half, None, "q")]
        mine._cells, mine._new, mine._last = memory.view(0, BANKS_AT, "q"), template._new.copy(), last
        return mine

    def post(number: int) -> Call:
        def call(memory: Access, _: Any) -> Any:
            memory.do("begin")
            on(memory).post(_rows(number))
            return number

        return call

    def look(memory: Access, known: Any) -> Any:
        last, bank = known
        mine = on(memory, bank)
        count, rows = mine.read()
        demand(any((rows == each).all() for each in allowed.get(count, [])), f"bank {count} is torn: {rows.tolist()}")
        demand(count >= last, f"bank {count} after {last}")
        return count, mine._last

    def final(memory: Access, results: Sequence[Any]) -> None:
        mine = on(memory)
        demand(mine.read()[0] == mine.count, "the valid bank is not whole")
        demand(not replaced or (mine.read()[1] == _rows(3)).all(), "the last bank is not read")

    return Model(
        shape,
        [
            Thread("writer", [post(1), post(2)], killable=True),
            *([Thread("next writer", [post(3)], after=0)] if replaced else []),
            *(Thread(f"reader {each}", [look] * looks, (0, template._last)) for each in range(readers if looks else 0)),
        ],
        final,
    )


# Requests and answers -------------------------------------------------------------------------------------
# shared_memory.py Exchange.ask, asked, answer, answered; off_cycle/proxy.py OffCycle.end; process/worker.py
# WorkerProcess._serve. Written: the request as a text of its number, then the number; the same for the answer. Writers:
# the control process asks, the worker answers. Before the first request of the end the control process takes back the
# level that lets the worker transfer by itself.

REQUEST_AT, ANSWER_AT, TEXT_ROOM = 80, 144, 64
EXCHANGE_SHAPE = Shape(
    ANSWER_AT + TEXT_ROOM,
    {0: "", 8 * Cell.ANSWERED: "answered", 8 * Cell.REQUESTED: "requested", 8 * Cell.POSTED: "",
     8 * Cell.CYCLIC: "cyclic", 8 * Cell.NOW: "",
     **{at + offset: f"{name} {part}" for at, name in ((REQUEST_AT, "request"), (ANSWER_AT, "answer"))
        for offset, part in ((0, "number"), (8, "size"), (16, "checksum"), (24, "text a"), (30, "text b"))},
     REQUEST_AT + 34: "", ANSWER_AT + 34: ""},
    b"".join((cell is Cell.CYCLIC).to_bytes(8, "little") for cell in Cell),
)  # fmt: skip


def _exchange(memory: Access) -> Any:
    mine: Any = Exchange.__new__(Exchange)
    mine.cells = memory.view(0, REQUEST_AT, "q")
    mine._request = SharedText(memory.view(), REQUEST_AT, TEXT_ROOM)
    mine._answer = SharedText(memory.view(), ANSWER_AT, TEXT_ROOM)
    return mine


def requests(looks: int = 2) -> Model:
    """Two requests; the first may be given up before it is answered."""

    def ask(memory: Access, _: Any) -> Any:
        return _exchange(memory).ask({"now": 1})

    def ask_again(memory: Access, _: Any) -> Any:
        return _exchange(memory).ask({"now": 2})

    def wait(memory: Access, number: Any) -> Any:
        answer = _exchange(memory).answered(number)
        demand(answer in (None, {"got": number}), f"the answer to {number} is {answer}")
        return number

    def serve(memory: Access, done: Any) -> Any:
        exchange = _exchange(memory)
        asked = exchange.asked()
        if asked is None:
            return done
        number, request = asked
        demand(request == {"now": number}, f"request {number} is {request}")
        demand(number > done, f"request {number} is carried out after {done}")
        exchange.answer(number, {"got": number})
        return number

    def final(memory: Access, results: Sequence[Any]) -> None:
        if results[1] == 2:
            demand(_exchange(memory).answered(2) == {"got": 2}, "the answer is not found")

    return Model(
        EXCHANGE_SHAPE,
        [Thread("control", [ask, wait, ask_again, *([wait] * looks)]), Thread("worker", [serve] * (looks + 1), 0)],
        final,
    )


def end_of_transfers() -> Model:
    """After the reset that the control process asks for, the worker transfers nothing more by itself."""

    def end(memory: Access, _: Any) -> Any:
        exchange = _exchange(memory)
        proxy: Any = SimpleNamespace(exchange=exchange, running=True)
        OffCycle.end(proxy)
        return exchange.ask({"now": 1})

    def serve(memory: Access, was_reset: Any) -> Any:
        done = [was_reset]

        def perform(_: Any) -> dict[str, Any]:
            memory.do("pause")  # it waits for the device
            done[0] = True
            return {"got": 1}

        server = SimpleNamespace(perform=perform, work=lambda: demand(not done[0], "a transfer follows the reset"))
        process: Any = SimpleNamespace(_set_fault_time=lambda _: None, _lost=False)
        proxy: Any = SimpleNamespace(exchange=_exchange(memory), server=server)
        WorkerProcess._serve(process, proxy)
        return done[0]

    return Model(EXCHANGE_SHAPE, [Thread("control", [end], killable=True), Thread("worker", [serve] * 3, False)])
