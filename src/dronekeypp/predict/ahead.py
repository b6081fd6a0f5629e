"""Work ahead: make the next items of an iterator in a thread, while the last one is used."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
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
