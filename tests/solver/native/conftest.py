"""The compiled kernel, where it was built."""

from __future__ import annotations

import pytest
from sparse_surface.solver.native import library


@pytest.fixture(params=library.INSTRUCTION_SETS)
def instructions(request: pytest.FixtureRequest) -> str:
    """An instruction set of this processor that the kernel was compiled for."""
    reason = library.reason_against()
    if reason is not None:
        pytest.skip(reason)
    if request.param not in library.supported_sets():
        pytest.skip(f"This processor does not have {request.param}.")
    return str(request.param)
