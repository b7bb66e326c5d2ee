"""Large networks are kept on disk as they were read."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers_networks import four_arms

from sumo_mcts.records.trace import same
from sumo_mcts.road import RoadMap
from sumo_mcts.world import kept_roads
from sumo_mcts.world.kept_roads import kept_roadmap
from sumo_mcts.world.roadmap import read_roadmap


class Reader:
    """Reads a network file, and counts how often."""

    def __init__(self, net: Path) -> None:
        self.net, self.count = net, 0

    def __call__(self) -> RoadMap:
        self.count += 1
        return read_roadmap(str(self.net))

    def kept(self) -> RoadMap:
        """The roads, as a process that starts now has them."""
        return kept_roadmap(self.net, self)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where networks of this size are kept."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(kept_roads, "LEAST_BYTES", 100)
    tmp_path.chmod(0o700)
    return tmp_path / "cache" / "sumo_mcts" / "networks"


@pytest.fixture
def reader(folder: Path, tmp_path: Path) -> Reader:
    four_arms(tmp_path, "traffic_light")
    return Reader(next(tmp_path.glob("*.net.xml")))


def test_a_large_network_is_read_once_and_stays_the_same(reader: Reader, folder: Path) -> None:
    first, second = reader.kept(), reader.kept()
    assert reader.count == 1
    assert same(RoadMap, first, second)
    for one, other in zip(first, second, strict=True):
        if isinstance(one, np.ndarray):  # else kernels would be compiled for other types
            assert (one.dtype, one.flags.writeable) == (other.dtype, other.flags.writeable)
    assert len(list(folder.iterdir())) == 1


def test_a_small_network_is_not_kept(
    reader: Reader, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept_roads, "LEAST_BYTES", 1 << 20)
    assert reader.kept().lane_ids and reader.kept().lane_ids
    assert reader.count == 2
    assert not folder.exists()


def test_a_file_with_another_content_is_another_network(reader: Reader) -> None:
    wide = reader.kept().width.max()
    text = reader.net.read_text().replace('speed="', 'width="2.5" speed="')
    reader.net.write_text(text)
    assert reader.kept().width.max() == 2.5 != wide
    assert reader.count == 2


def test_other_code_reads_again(reader: Reader, monkeypatch: pytest.MonkeyPatch) -> None:
    reader.kept()
    monkeypatch.setattr(kept_roads, "versions", lambda: {"sources": "others"})
    reader.kept()
    assert reader.count == 2


@pytest.mark.parametrize(
    "harm",
    [lambda whole: b"", lambda whole: whole[:-200], lambda whole: b"x" * len(whole)],
    ids=["empty", "cut off", "something else"],
)
def test_a_damaged_file_is_written_again(
    reader: Reader, folder: Path, harm: Callable[[bytes], bytes]
) -> None:
    whole = reader.kept()
    (file,) = folder.iterdir()
    content = file.read_bytes()
    file.write_bytes(harm(content))
    assert same(RoadMap, reader.kept(), whole)
    assert file.read_bytes() == content
    assert reader.count == 2


def test_those_used_last_stay(
    reader: Reader, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept_roads, "MOST_FILES", 2)
    text = reader.net.read_text()

    def read(content: str) -> None:
        """Read a network, and let time pass."""
        for file in folder.iterdir() if folder.exists() else ():
            os.utime(file, ns=(0, file.stat().st_mtime_ns - 10**9))
        reader.net.write_text(content)
        reader.kept()

    for content in (text, text + "<!-- b -->", text, text + "<!-- c -->"):
        read(content)
    assert reader.count == 3
    read(text)
    assert reader.count == 3  # it was used after b
    read(text + "<!-- b -->")
    assert reader.count == 4
    assert len(list(folder.iterdir())) == 2


def test_where_nothing_can_be_kept_the_network_is_read(
    reader: Reader, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept_roads, "lasting_folder", lambda _: None)
    assert reader.kept().lane_ids and reader.kept().lane_ids
    assert reader.count == 2
    assert not folder.exists()


def test_a_file_that_changes_while_it_is_read_is_not_kept(reader: Reader, folder: Path) -> None:
    def read() -> RoadMap:
        road = reader()
        reader.net.write_text(reader.net.read_text() + "<!-- more -->")
        return road

    assert kept_roadmap(reader.net, read).lane_ids
    assert not list(folder.iterdir())
