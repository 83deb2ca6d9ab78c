"""The methods that fit a patch, as data: what panel, command line, estimate and pipeline need to know of each.

To add a method, write a module in `fitting/methods/` with the functions of `fitting.methods.PatchSolver` and add its
entry to `METHODS`.  This module imports nothing heavy: a solver's module is loaded when it first fits a patch.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple


def _steps(iterations: int, sweeps: int) -> float:
    """Selecting the functions costs about as much as four iterations, a sweep almost half of the solve."""
    return (iterations + 4) * (1.0 + 0.45 * sweeps)


class PatchMethod(NamedTuple):
    """What the rest of the program knows of a method.

    Attributes
    ----------
    name
        Value of the setting `method`.
    module
        Its module in `fitting/methods/`.
    text
        One sentence on how it works, its accuracy and its cost.
    defaults
        What the method uses for each setting that is left at "auto".
    own_settings
        Settings that only this method reads.
    turns_domain
        Whether each problem is turned to the principal axes of its signals.
    keeps_balance
        Whether a sweep scales its weights so that their sum, and so their balance with Q, stays the same, and holds
        each patch near the data.  Otherwise eq. 6 is taken as printed.
    anneals
        Whether beta1 decays over the iterations; the module then has `iterations_down_to`.
    compiled
        Whether the compiled kernel solves it too.
    work
        Steps, in units of one iteration, for given numbers of iterations and sweeps: what the estimate of the run time
        grows with.
    """

    name: str
    module: str
    text: str
    defaults: Mapping[str, str]
    own_settings: tuple[str, ...] = ()
    turns_domain: bool = False
    keeps_balance: bool = False
    anneals: bool = False
    compiled: bool = False
    work: Callable[[int, int], float] = _steps


PRINTED = {"blending": "uniform", "basis": "monomial", "pursuit": "omp", "observations": "vertices", "creases": "off"}
"""The choices of the paper."""

METHODS = {
    method.name: method
    for method in (
        PatchMethod(
            "default",
            "variable_projection",
            "Variable projection: Gauss-Newton on the domain with the coefficients eliminated. Most accurate",
            {
                "blending": "partition",
                "basis": "legendre",
                "pursuit": "ols",
                "observations": "centroids",
                "creases": "auto",
            },
            turns_domain=True,
            keeps_balance=True,
            anneals=True,
            compiled=True,
            # Half of the patches settle after 9 iterations, soon after the regularisation is annealed.
            work=lambda iterations, sweeps: _steps(min(iterations, 9), sweeps),
        ),
        PatchMethod(
            "paper",
            "augmented_lagrangian",
            "The augmented-Lagrangian iteration of the paper, as printed. Slower and less accurate",
            PRINTED,
            own_settings=("rho", "tau", "initial_fit", "regularisation", "rigidity_reference"),
        ),
        PatchMethod(
            "traditional",
            "fixed_domain",
            "Sparse fit on the fixed initial domain. Fast; rounds creases off",
            PRINTED,
            work=lambda iterations, sweeps: 2.0,
        ),
    )
}
"""All methods by name, in the order in which they are offered."""
