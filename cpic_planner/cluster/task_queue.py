"""Which task is sent to a cluster next, and which are to blame for the workers that died with them."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterable

from cpic_planner.engine import ClusterError

__all__ = ["TaskQueue"]

_LOG = logging.getLogger(__name__)
_DEATHS_ALONE = 4  # of workers with one and the same task alone in flight, after which the task is to blame
_ENOUGH_BLAMED = 3  # such tasks, after which the run ends: it may be all of them


class TaskQueue:
    """Tasks that are not sent out: those that wait, and those that Dask gave up and that are to run alone."""

    def __init__(self, total: int) -> None:
        self._total = total
        self._waiting = deque(range(total))
        self._suspects: deque[int] = deque()
        self._deaths_alone: dict[int, int] = {}
        self._blamed: list[int] = []

    @property
    def left(self) -> int:
        """How many they are."""
        return len(self._waiting) + len(self._suspects)

    def next(self, flying: int, room: int) -> int | None:
        """Task to send out next, if any, with so many in flight and room for so many."""
        if self._waiting:
            return self._waiting[0] if flying < room else None
        return self._suspects[0] if self._suspects and not flying else None

    def sent(self, index: int) -> None:
        """Note that the next task has gone."""
        (self._suspects if index in self._deaths_alone else self._waiting).popleft()

    def put_back(self, indices: Iterable[int]) -> None:
        """Have tasks that were lost sent out again, before the others."""
        for index in sorted(indices, reverse=True):
            (self._suspects if index in self._deaths_alone else self._waiting).appendleft(index)

    def judge(self, index: int, deaths: int) -> None:
        """Put a task that Dask gave up aside, or blame it for the deaths that nothing else in flight explains."""
        if index not in self._deaths_alone:
            _LOG.warning(
                "task %d of %d: %d workers died with it; it will run alone at the end", index + 1, self._total, deaths
            )
            self._deaths_alone[index] = 0
        else:
            self._deaths_alone[index] += deaths
        if self._deaths_alone[index] < _DEATHS_ALONE:
            self._suspects.append(index)
            return
        self._blamed.append(index)
        if len(self._blamed) >= _ENOUGH_BLAMED:
            self.tell_blamed()

    def tell_blamed(self) -> None:
        """Raise for the tasks to blame."""
        if self._blamed:
            numbers = ", ".join(str(index + 1) for index in sorted(self._blamed))
            rest = f"{self.left} others are not finished" if self.left else "all others are done"
            raise ClusterError(
                f"task {numbers} of {self._total} ended its worker {_DEATHS_ALONE} times or more with "
                f"nothing else running: short of memory, or a crash in native code; {rest}"
            )
