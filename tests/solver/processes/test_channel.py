"""Messages in frames: whole or not at all, arrays without copies, classes by their name on this side."""

from __future__ import annotations

import os
import pickle
import threading
from collections.abc import Iterator
from io import FileIO

import numpy as np
import pytest
from sparse_surface.solver.processes.channel import FINISH_MESSAGE, OWN_PACKAGE, pack, receive, send, unpack
from sparse_surface.solver.settings import Settings

Pipe = tuple[FileIO, FileIO]


@pytest.fixture
def pipe() -> Iterator[Pipe]:
    reading, writing = (FileIO(end, mode) for end, mode in zip(os.pipe(), ("rb", "wb"), strict=True))
    yield reading, writing
    reading.close()
    writing.close()


def through(pipe: Pipe, parts: object) -> list[memoryview]:
    sender = threading.Thread(target=send, args=(pipe[1], parts))
    sender.start()
    received = receive(pipe[0])
    sender.join()
    return received


@pytest.mark.parametrize("snapshot", [False, True])
def test_arrays_arrive_as_they_were(pipe: Pipe, snapshot: bool) -> None:
    random = np.random.default_rng(0)
    sent = {
        "large": random.random((50_000, 3)),
        "single": np.float32(random.random(7)),
        "columns": np.asfortranarray(random.random((4, 5))),
        "strided": random.random((6, 8))[::2, ::3],
        "empty": np.empty((0, 3), dtype=np.int32),
        "text": "Grüße",
    }
    got = unpack(through(pipe, pack(sent, snapshot=snapshot)), OWN_PACKAGE)
    assert got["text"] == sent["text"]
    for name in set(sent) - {"text"}:
        assert got[name].dtype == sent[name].dtype
        assert got[name].tolist() == sent[name].tolist()
        got[name][...] = 0  # what arrived is the receiver's to change


def test_an_array_is_neither_copied_to_be_sent_nor_when_it_is_read(pipe: Pipe) -> None:
    sent = np.arange(10_000.0)
    parts = pack(sent)
    assert np.shares_memory(np.frombuffer(parts[1]), sent)
    received = through(pipe, parts)
    assert np.shares_memory(unpack(received, OWN_PACKAGE), np.frombuffer(received[1]))


def test_a_snapshot_does_not_follow_its_array() -> None:
    sent = np.zeros(1000)
    parts = pack(sent, snapshot=True)
    sent[:] = 1.0
    assert not unpack(parts, OWN_PACKAGE).any()


def test_messages_follow_each_other(pipe: Pipe) -> None:
    for message in (pack(1), FINISH_MESSAGE, pack([2, np.ones(3)])):
        send(pipe[1], message)
    assert unpack(receive(pipe[0]), OWN_PACKAGE) == 1
    assert len(receive(pipe[0])) == 0
    assert unpack(receive(pipe[0]), OWN_PACKAGE)[1].tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("kept", [0, 5, 8, 12, 24, 40, -1])
def test_a_cut_message_is_never_read(pipe: Pipe, kept: int) -> None:
    send(pipe[1], pack(["text", np.arange(20)]))
    whole = os.read(pipe[0].fileno(), 65536)
    os.write(pipe[1].fileno(), whole[:kept])
    pipe[1].close()
    with pytest.raises(EOFError):
        receive(pipe[0])


def test_a_class_of_the_package_is_found_under_the_other_sides_name() -> None:
    theirs = pickle.dumps(Settings(ring=5), protocol=2).replace(OWN_PACKAGE.encode(), b"bl_ext.elsewhere.solver")
    assert b"bl_ext.elsewhere.solver.settings" in theirs
    assert unpack([theirs], "bl_ext.elsewhere.solver") == Settings(ring=5)
    with pytest.raises(ModuleNotFoundError):
        unpack([theirs], "other")
