"""Chunks of patches on Dask: the same bytes from a cluster's workers."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.progress import Progress

distributed = pytest.importorskip("distributed", reason="Dask is not installed")

SETTINGS = {"ring": 4, "degree": 7, "sparsity": 8, "iterations": 3}


@pytest.fixture(scope="module")
def client() -> Iterator[object]:
    """A client of two worker processes on this machine."""
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    )
    with cluster, distributed.Client(cluster) as connected:
        yield connected


def test_a_cluster_gives_the_same_bytes(client) -> None:
    vertices, faces = models.cube()
    alone = approximate(vertices, faces, Settings(**SETTINGS, workers=1))
    with client.get_executor(pure=False) as executor:
        steps: list[Progress] = []
        spread = approximate(vertices, faces, Settings(**SETTINGS, workers=2), executor=executor, report=steps.append)
    assert spread.vertices.tobytes() == alone.vertices.tobytes()
    assert spread.representation.coefficients.tobytes() == alone.representation.coefficients.tobytes()
    assert spread.report["surface_error"] == alone.report["surface_error"]
    assert [step.fraction for step in steps] == sorted(step.fraction for step in steps)


def test_both_workers_take_part(client) -> None:
    before = executed(client)
    assert len(before) == 2
    vertices, faces = models.cube()
    with client.get_executor(pure=False) as executor:
        approximate(
            vertices, faces, Settings(**{**SETTINGS, "iterations": 0, "sweeps": 0}, workers=2), executor=executor
        )
    after = executed(client)
    assert all(after[worker] > before[worker] for worker in before)


def executed(client) -> dict[str, int]:
    """How many tasks each worker has carried out so far."""
    return client.run(lambda dask_worker: dask_worker.state.executed_count)
