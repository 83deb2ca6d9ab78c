"""A function applied to many things, each by itself: one after the other, or several at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol, TypeVar

Thing = TypeVar("Thing")
Result = TypeVar("Result")


class Each(Protocol):
    """Applies a function to things like `map`, in threads or not: it must do the same for each in any order."""

    def __call__(self, function: Callable[[Thing], Result], things: Iterable[Thing], /) -> Iterable[Result]:
        """The results, in the order of the things."""
        ...


def all_done(each: Each, function: Callable[[Thing], None], things: Iterable[Thing]) -> None:
    """Apply a function that returns nothing to all things."""
    for _ in each(function, things):
        pass
