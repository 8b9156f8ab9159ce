"""A lock: equipment that several sequences share is used by one at a time."""

from __future__ import annotations

from collections import deque

from umo.cycle.sequences import Task, advancing, next_period
from umo.errors import TaskFailed


class Lock:
    """Equipment that several sequences share, such as a scale, for one of them at a time:

        def setup(self) -> None:
            self.scale_lock = Lock()

        async with self.scale_lock:
            await self.weigh(...)

    First come, first served; one that is paused (`task.paused`: a part that is held) is passed over, and keeps its
    place. It is given back when the block ends, also by an error or a cancellation; then the first one that waits has
    it at once. A sequence that is cancelled while it waits leaves the queue. TaskFailed if the sequence has it already,
    itself or by a sequence that awaits it.
    """

    def __init__(self) -> None:
        self._holder: Task | None = None
        self._queue: deque[tuple[Task, ...]] = deque()
        """Those that wait: each with the sequences that it is a part of, the outermost first."""

    @property
    def holder(self) -> str | None:
        """The name of the sequence that has it: that of its `async def` function. None: it is free."""
        return None if self._holder is None else self._holder.name

    @property
    def locked(self) -> bool:
        """Whether a sequence has it."""
        return self._holder is not None

    async def __aenter__(self) -> Lock:
        chain = tuple(advancing())
        if not chain:
            raise TaskFailed("a Lock can be used only in a sequence that the cycle advances")
        if self._holder in chain:
            raise TaskFailed(f"{chain[-1].name} waits for a Lock that {self.holder} has: it would wait for itself")
        own = chain[-1]
        self._queue.append(chain)
        if self._holder is None:
            self._pass_on()
        try:
            while self._holder is not own:
                await next_period()
                if self._holder is None:  # those that wait were paused when it was given back
                    self._pass_on()
        except BaseException:
            self._leave(chain)
            raise
        return self

    async def __aexit__(self, *error: object) -> None:
        self._pass_on()

    def _leave(self, chain: tuple[Task, ...]) -> None:
        """A sequence that waits is cancelled, perhaps after the lock was passed on to it."""
        if self._holder is chain[-1]:
            self._pass_on()
        else:
            self._queue.remove(chain)

    def _pass_on(self) -> None:
        """To the first one that waits and is not paused."""
        chain = next((each for each in self._queue if not any(task.paused for task in each)), None)
        self._holder = None if chain is None else chain[-1]
        if chain is not None:
            self._queue.remove(chain)
