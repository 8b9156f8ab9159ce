"""A lock for equipment that several sequences share, so that one sequence at a time uses it."""

from __future__ import annotations

from collections import deque
from weakref import WeakSet

from umo.cycle import wait_graph
from umo.cycle.sequences import AsyncBlock, Task, one_period, own_task
from umo.errors import TaskFailed


class Lock(AsyncBlock):
    """A lock for equipment that several sequences share, such as a scale. One sequence at a time has the lock:

        def setup(self) -> None:
            self.scale_lock = Lock()

        async with self.scale_lock:
            await self.weigh(...)

    The sequence that asked first gets the lock first; a paused sequence (`task.paused`, as in a part that is held) is
    passed over and keeps its position in the queue. The lock is released when the block ends, even by an error or a
    cancellation; the first waiting sequence then gets the lock immediately. A sequence that is cancelled while it waits
    leaves the queue. Raises TaskFailed, which names the circle, if the sequence can never get the lock, because the
    holder of the lock waits for this sequence, directly or through other locks and sequences.
    """

    def __init__(self) -> None:
        self._owner: Task | None = None
        """The innermost sequence that has the lock."""
        self._queue: deque[Task] = deque()
        """The sequences that wait for the lock, in the order of arrival."""
        self._users: WeakSet[Task] = WeakSet()
        """The sequences that have had the lock."""

    @property
    def holder(self) -> str | None:
        """The name of the sequence that has the lock, which is the name of its `async def` function; None if the lock
        is free."""
        return None if self._owner is None else self._owner.name

    @property
    def locked(self) -> bool:
        """True if a sequence has the lock."""
        return self._owner is not None

    async def __aenter__(self) -> Lock:
        own = await own_task("a Lock")
        if self._owner is not None:
            self._refuse(own, self._owner)
        self._queue.append(own)
        if self._owner is None:
            self._pass_on()
        own.waits_for = self
        try:
            while self._owner is not own:
                await one_period()
                if self._owner is None:  # those that wait were paused when it was given back
                    self._pass_on()
        except BaseException:
            self._leave(own)
            raise
        finally:
            own.waits_for = None
        return self

    async def __aexit__(self, *error: object) -> None:
        self._pass_on()

    def _refuse(self, own: Task, owner: Task) -> None:
        """Raise TaskFailed for a sequence that can never get the lock."""
        if own.machine is not owner.machine:
            raise TaskFailed(f"{own.name} waits for a Lock that {owner.name} of another machine has")
        if (why := wait_graph.circle(own, owner, "{waiting} waits for a Lock that {target} has")) is not None:
            raise TaskFailed(why)

    def _leave(self, own: Task) -> None:
        """Handle the cancellation of a waiting sequence, which may have got the lock already."""
        if self._owner is own:
            self._pass_on()
        else:
            self._queue.remove(own)

    def _pass_on(self) -> None:
        """Give the lock to the first sequence that waits and is not paused."""
        if self._owner is not None:
            self._owner.holds.remove(self)
        self._owner = next((each for each in self._queue if not _is_paused(each)), None)
        if self._owner is not None:
            self._queue.remove(self._owner)
            self._owner.holds.append(self)
            self._users.add(self._owner)


def _is_paused(task: Task) -> bool:
    """Return True if the sequence, or a sequence that runs it, is paused."""
    return any(each.paused for each in task.lineage)
