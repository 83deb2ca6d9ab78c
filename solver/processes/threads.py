"""One BLAS thread for the solver's work, whatever the machine offers.

The solver stacks many small products and systems: threads only slow them down, and LAPACK takes another routine for a
small system where it has more than one, so that the last bit would depend on the number of cores.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from functools import lru_cache, wraps
from typing import Any, ParamSpec, TypeVar

import scipy.linalg  # noqa: F401  its BLAS has to be loaded before threads are counted
import threadpoolctl
from threadpoolctl import ThreadpoolController

from ..progress import Steps, relayed

Result = TypeVar("Result")
Given = ParamSpec("Given")


@lru_cache(maxsize=1)
def _libraries() -> ThreadpoolController:
    """Libraries of this process that keep threads; looking for them takes longer than limiting them."""
    return ThreadpoolController()


def _take_control() -> None:
    """Let this thread change the limit: from 3.8 on threadpoolctl lets only that one which set it before."""
    clear = getattr(getattr(threadpoolctl, "OpenBLASController", None), "clear_controlling_thread", None)
    if clear is not None:
        clear(force=True)


class _Limit:
    """The limit, from the first of overlapping contexts to the last: it holds for all threads of the process."""

    def __init__(self) -> None:
        self._lock, self._contexts, self._set = threading.Lock(), 0, ExitStack()

    def __enter__(self) -> None:
        with self._lock:
            if not self._contexts:
                _take_control()
                self._set.enter_context(_libraries().limit(limits=1, user_api="blas"))
            self._contexts += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._contexts -= 1
            if not self._contexts:
                _take_control()
                self._set.close()


_LIMIT = _Limit()


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which BLAS and LAPACK use one thread; other threads may be in it at the same time."""
    return _LIMIT


def on_one_thread(make: Callable[Given, Steps[Result]]) -> Callable[Given, Steps[Result]]:
    """Run each step of a computation on one BLAS thread; between the steps the caller has its own number again."""

    @wraps(make)
    def limited(*args: Given.args, **kwargs: Given.kwargs) -> Steps[Result]:
        return relayed(make(*args, **kwargs), around=one_thread)

    return limited
