"""What every patch method has in common, and that one more is one module and one entry."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from numpy.typing import NDArray
from sparse_surface.benchmarks.generated_models import cube
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.fitting.batch import Batch, Problem, build_batch
from sparse_surface.solver.fitting.dictionary import Dictionary
from sparse_surface.solver.fitting.methods import annealing_solver_of, solver_of
from sparse_surface.solver.fitting.solution import Solution
from sparse_surface.solver.patch_methods import METHODS
from synthetic import crease, hill, problem

Array = NDArray[np.float64]
FIELDS = {item.name: item for item in dataclasses.fields(Settings)}
every_method = pytest.mark.parametrize("name", METHODS)


def settings_for(name: str, **changes: object) -> Settings:
    return replace(Settings(method=name, **changes).resolved(), initial_fit="data")


def batch_of(name: str, *problems: Problem) -> Batch:
    return build_batch(list(problems), turn=METHODS[name].turns_domain)


def solved(batch: Batch, settings: Settings) -> Solution:
    return solver_of(settings).solve(batch, Dictionary(settings.degree, settings.basis), settings)


def fitted(batch: Batch, solution: Solution, settings: Settings) -> Array:
    """Return the values at the observations, (B, D, N), by evaluating the whole dictionary."""
    functions = Dictionary(settings.degree, settings.basis).evaluate(batch.observed(solution.domain))
    every = np.zeros((*solution.support.shape[:2], functions.shape[1]))
    problem, signal, place = np.nonzero(solution.support >= 0)
    chosen = problem, signal, solution.support[problem, signal, place]
    np.add.at(every, chosen, solution.coefficients[problem, signal, place])
    return every @ functions


@every_method
def test_an_entry_is_complete(name: str) -> None:
    method = METHODS[name]
    assert method.name == name
    assert FIELDS["method"].metadata["choices"][name] == method.text
    automatic = {item.name for item in FIELDS.values() if item.default == "auto"}
    assert set(method.defaults) == automatic
    assert all(value in FIELDS[setting].metadata["choices"] for setting, value in method.defaults.items())
    assert {getattr(Settings(method=name).resolved(), setting) for setting in automatic} == set(
        method.defaults.values()
    )
    assert set(method.own_settings) <= set(FIELDS)
    module = import_module(f"sparse_surface.solver.fitting.methods.{method.module}")
    assert solver_of(Settings(method=name)) is module
    assert (
        (annealing_solver_of(Settings(method=name)) is module)
        == method.anneals
        == hasattr(module, "iterations_down_to")
    )


@every_method
def test_work_grows_with_what_is_asked_for(name: str) -> None:
    work = METHODS[name].work
    assert 0.0 < work(0, 0) <= work(5, 0) <= work(5, 1) <= work(5, 3)


@every_method
def test_a_planar_patch_is_reproduced(name: str) -> None:
    settings = settings_for(name)
    batch = batch_of(name, problem(lambda u, v: 0.3 * u - 0.1 * v, seed=4, inside=True))
    np.testing.assert_allclose(fitted(batch, solved(batch, settings), settings), batch.values, atol=1e-6)


@every_method
def test_the_fit_is_close_and_uses_no_function_twice(name: str) -> None:
    settings = settings_for(name, sparsity=12)
    batch = batch_of(name, problem(crease, 12, seed=1), problem(hill, 10, seed=2))
    solution = solved(batch, settings)
    left = (fitted(batch, solution, settings) - batch.values) * batch.root_weights
    assert ((left**2).sum(axis=(1, 2)) < 0.02 * (batch.values**2).sum(axis=(1, 2))).all()
    for support in solution.support.reshape(-1, solution.support.shape[-1]):
        used = support[support >= 0]
        assert len(set(used)) == len(used) <= 12


@every_method
def test_same_input_same_bytes_and_no_problem_affects_another_one(name: str) -> None:
    settings = settings_for(name, iterations=4)
    first, other = problem(crease, 10, seed=3), problem(hill, 12, seed=5)
    one, again = (solved(batch_of(name, first, other), settings) for _ in range(2))
    for array in ("domain", "support", "coefficients"):
        assert getattr(one, array).tobytes() == getattr(again, array).tobytes()
    batch = batch_of(name, first)
    alone = fitted(batch, solved(batch, settings), settings)[0]
    together = fitted(batch_of(name, first, other), one, settings)[0, :, : alone.shape[1]]
    np.testing.assert_allclose(together, alone, atol=2e-3)


@every_method
def test_improving_is_never_worse_than_refitting_the_same_functions(name: str) -> None:
    """Without regularisation the objective is the misfit; NumPy's least squares tells what refitting leaves."""
    settings = settings_for(name, beta1=0.0, beta2=0.0)
    first = problem(crease, 10, seed=6)
    before = solved(batch_of(name, first), settings)
    changed = replace(first, values=first.values + 0.05 * np.sin(9.0 * first.values[:, [1, 2, 0]]))
    batch = replace(batch_of(name, first), values=batch_of(name, changed).values)
    dictionary = Dictionary(settings.degree, settings.basis)
    after = solver_of(settings).improve(batch, dictionary, settings, before.domain, before.support, 3)
    functions = dictionary.evaluate(batch.observed(before.domain))[0]
    kept = 0.0
    for support, values in zip(before.support[0], batch.values[0], strict=True):
        used = functions[support[support >= 0]].T
        kept += ((values - used @ np.linalg.lstsq(used, values, rcond=None)[0]) ** 2).sum()
    assert ((fitted(batch, after, settings) - batch.values) ** 2).sum() <= kept * (1 + 1e-6)


@every_method
def test_a_history_is_kept_when_asked_for(name: str) -> None:
    settings = settings_for(name, iterations=3, keep_iterations=True)
    batch = batch_of(name, problem(crease, 8), problem(hill, 9))
    trace = solved(batch, settings).trace
    assert len(trace.values) == len(trace.energy) == len(trace.squared_error) > 0
    assert all(values.shape == (2, 3, 81) for values in trace.values)
    assert solved(batch, replace(settings, keep_iterations=False)).trace.values == []


@every_method
def test_sweeps_bring_the_blended_surface_nearer(name: str) -> None:
    vertices, faces = cube(6)
    errors = []
    for sweeps in (0, 2):
        quick = settings_for(name, ring=4, degree=8, sparsity=8, iterations=4, sweeps=sweeps, workers=1, beta1=0.0)
        quick = replace(quick, creases="off")
        result = approximate(vertices, faces, quick)
        errors.append(((result.vertices - vertices) ** 2).sum())
    assert errors[1] < errors[0]


ADD_A_METHOD = '''
import os, sys, types
import numpy as np
from sparse_surface.solver import patch_methods
from sparse_surface.solver.patch_methods import PatchMethod

def solve(batch, dictionary, settings):
    """A quadratic over the initial domain."""
    from sparse_surface.solver.fitting.solution import Solution, Trace
    support = np.tile(np.arange(6), (*batch.values.shape[:2], 1))
    coefficients = np.zeros(support.shape)
    functions = dictionary.evaluate(batch.observed(batch.start))[:, :6]
    for at in np.ndindex(support.shape[:2]):
        coefficients[at] = np.linalg.lstsq(functions[at[0]].T, batch.values[at], rcond=None)[0]
    return Solution(batch.start, support, coefficients, Trace())

def improve(batch, dictionary, settings, domain, support, iterations):
    return solve(batch, dictionary, settings)

module = types.ModuleType("quadratic")
module.solve, module.improve = solve, improve
sys.modules["sparse_surface.solver.fitting.methods.quadratic"] = module
patch_methods.METHODS["quadratic"] = PatchMethod(
    "quadratic", "quadratic", "A quadratic.", patch_methods.PRINTED, work=lambda iterations, sweeps: 0.5)

from sparse_surface.benchmarks.generated_models import sphere
from sparse_surface.command_line.arguments import parse
from sparse_surface.operators.run.estimate import estimate
from sparse_surface.solver import Settings, approximate

settings = parse(["approximate", "a.obj", "--method", "quadratic", "--workers", "1"]).settings
assert settings == Settings(method="quadratic", workers=1)
result = approximate(*sphere(12), settings)
assert result.report["method"] == "quadratic" and result.representation.support.max() == 5
assert 1e-6 < result.report["relative"]["surface_rms"] < 0.05, result.report["relative"]
assert estimate(1000, settings).seconds < estimate(1000, Settings(method="traditional")).seconds
print("added", flush=True)
os._exit(0)  # bpy, which the command line loads, now and then waits for itself when it is unloaded
'''


def test_a_method_is_added_by_one_module_and_one_entry() -> None:
    done = subprocess.run([sys.executable, "-c", ADD_A_METHOD], capture_output=True, text=True, cwd="/")
    assert done.stdout == "added\n", done.stderr
