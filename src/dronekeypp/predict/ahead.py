"""Work in threads: make the next items of an iterator while the last one is used, or several at once."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch

T = TypeVar("T")
Result = TypeVar("Result")
END = object()  # what comes after the last item


def ahead(items: Iterator[T], count: int) -> Iterator[T]:
    """Yield the items in their order, while a thread makes those that follow.

    Decoding, drawing and networks leave Python's lock while they compute, so that two of them run at once.
    What the iterator raises is raised here, in the place of the item. When this generator is closed, the
    thread ends after the item that it is making.

    Args:
        items: only the thread asks for them, one after the other.
        count: how many items are made ahead, at most.
    """
    with ThreadPoolExecutor(1, "ahead") as thread:
        waiting = deque(thread.submit(next, items, END) for _ in range(count))
        try:
            while (item := waiting.popleft().result()) is not END:
                waiting.append(thread.submit(next, items, END))
                yield item
        finally:
            thread.shutdown(cancel_futures=True)


def side_by_side(function: Callable[[T], Result], items: Iterable[T], count: int) -> Iterator[Result]:
    """Yield `function` of every item, in their order, while threads compute it of those that follow.

    The threads share the cores that torch computes on. A small network is faster on two batches at once, each
    on one core, than on one after the other with both cores, which wait for each other after every layer.

    What the function raises is raised here, in the place of the item. When this generator is closed, the
    threads end after the items that they are computing.

    Args:
        function: it is called in the threads.
        items: only the thread that asks this generator asks for them.
        count: how many threads there are. One item more than that is asked for ahead.
    """
    cores = torch.get_num_threads()
    each = max(1, cores // count)
    with ThreadPoolExecutor(count, "side_by_side", torch.set_num_threads, (each,)) as threads:
        waiting = deque()
        try:
            for item in items:
                waiting.append(threads.submit(function, item))
                while waiting and (len(waiting) > count or waiting[0].done()):
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            threads.shutdown(cancel_futures=True)
            torch.set_num_threads(cores)  # what a thread chose holds for threads that begin later
