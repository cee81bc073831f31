"""Threads that share the blocks of a large batch."""

import os
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

INLINE_BLOCKS = 16
"""Fewer blocks than these are stepped by the caller's thread alone: to wake another costs more."""

Share = tuple[int, int]


class Threads:
    """A pool of threads, made at first need and again in a forked child.

    Parameters
    ----------
    count
        Threads that work, the caller's included.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool: ThreadPoolExecutor | None = None
        self._pool_owner = -1

    def __reduce__(self) -> tuple[type["Threads"], tuple[int]]:
        """Copy the number of threads; a copy makes its own at first need."""
        return Threads, (self.count,)

    def shares(self, blocks: int) -> list[Share]:
        """Return first block and end of each thread's share; one share if there is too little."""
        if self.count == 1 or blocks < INLINE_BLOCKS:
            return [(0, blocks)]
        share = -(-blocks // self.count)
        return [(first, min(first + share, blocks)) for first in range(0, blocks, share)]

    def run_parallel(self, call: Callable[[int, int], int], shares: list[Share]) -> list[int]:
        """Return what a compiled function returns for each share, in any order.

        It is called in all threads at once. An interrupt (Ctrl-C) waits for all.
        """
        left = deque(shares)  # whose pops are safe between threads, also without the GIL
        finished_shares: list[Share] = []
        results: list[int] = []

        def work() -> None:
            while True:
                try:
                    share = left.popleft()
                except IndexError:
                    return
                try:
                    results.append(call(*share))
                finally:
                    finished_shares.append(share)

        pool = self._present_pool()
        try:
            jobs = [pool.submit(work) for _ in range(self.count - 1)]
            work()
            for job in jobs:
                job.result()
        except BaseException:
            work()
            while len(finished_shares) < len(shares):
                time.sleep(1e-4)
            raise
        return results

    def close(self) -> None:
        """Stop the threads, if there are any."""
        if self._pool is not None and self._pool_owner == os.getpid():
            self._pool.shutdown(wait=False)
        self._pool = None

    def _present_pool(self) -> ThreadPoolExecutor:
        if self._pool is None or self._pool_owner != os.getpid():
            self._pool = ThreadPoolExecutor(self.count - 1, thread_name_prefix="pter")
            self._pool_owner = os.getpid()
        return self._pool
