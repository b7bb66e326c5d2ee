"""The folder of compiled kernels, and its files."""

import errno
import grp
import os
import pwd
import signal
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from sumo_mcts.numerics import kept
from sumo_mcts.numerics.kept import NOTHING_KEPT, Kept, folder_for, is_ours


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which the cache folder and the temporary folder lie."""
    tmp_path.chmod(0o700)
    (tmp_path / "tmp").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    return tmp_path


def _quiet(line: str) -> None:
    raise AssertionError(line)


def _fallback(own: Path) -> Path:
    return own / "tmp" / f"sumo_mcts-{os.getuid()}" / "kernels-key"


# --- which folder ---


def test_it_lies_in_the_cache_folder_and_is_the_users_alone(own: Path) -> None:
    folder = folder_for("key", _quiet)
    assert folder == own / "cache" / "sumo_mcts" / "kernels-key"
    assert stat.S_IMODE(folder.stat().st_mode) & 0o077 == 0
    assert is_ours(folder)


def test_folders_that_it_makes_are_closed_to_the_group_whatever_the_habit(own: Path) -> None:
    before = os.umask(0o002)
    try:
        assert folder_for("key", _quiet) == own / "cache" / "sumo_mcts" / "kernels-key"
    finally:
        os.umask(before)
    assert stat.S_IMODE((own / "cache").stat().st_mode) == 0o700


def test_without_a_named_cache_folder_it_lies_in_the_home(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(own / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    assert (
        folder_for("key", _quiet) != own / "home" / ".cache" / "sumo_mcts" / "kernels-key"
    )  # a home that there is not is not made
    assert not (own / "home").exists()
    (own / "home").mkdir()
    for ignored in ("", "relative/cache"):
        monkeypatch.setenv("XDG_CACHE_HOME", ignored)
        assert folder_for("key", _quiet) == own / "home" / ".cache" / "sumo_mcts" / "kernels-key"


def _is_file(own: Path) -> None:
    (own / "cache").write_text("")


def _is_open_to_others(own: Path) -> None:
    (own / "cache" / "sumo_mcts").mkdir(parents=True)
    (own / "cache" / "sumo_mcts").chmod(0o777)


def _is_open_to_the_group(own: Path) -> None:
    (own / "cache" / "sumo_mcts" / "kernels-key").mkdir(parents=True)
    (own / "cache" / "sumo_mcts" / "kernels-key").chmod(0o770)


def _is_link_of_its_own(own: Path) -> None:
    (own / "elsewhere").mkdir(mode=0o700)
    (own / "cache" / "sumo_mcts").mkdir(parents=True)
    (own / "cache" / "sumo_mcts" / "kernels-key").symlink_to(own / "elsewhere")


def _is_link_into_an_open_folder(own: Path) -> None:
    (own / "open").mkdir()
    (own / "open").chmod(0o777)
    (own / "cache").symlink_to(own / "open")


def _is_circle(own: Path) -> None:
    (own / "cache").symlink_to(own / "cache")


@pytest.mark.parametrize(
    "spoil",
    [
        _is_file,
        _is_open_to_others,
        _is_open_to_the_group,
        _is_link_of_its_own,
        _is_link_into_an_open_folder,
        _is_circle,
    ],
)
def test_where_the_cache_folder_is_no_good_it_lies_in_one_of_the_users_own_in_the_temporary_folder(
    own: Path, spoil: Callable[[Path], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        grp, "getgrgid", lambda group: grp.struct_group(("staff", "x", group, ["somebody"]))
    )
    spoil(own)
    assert folder_for("key", _quiet) == _fallback(own)
    assert stat.S_IMODE(_fallback(own).parent.stat().st_mode) == 0o700


@pytest.mark.parametrize(
    ("name", "members", "ours"),
    [("me", [], True), ("me", ["me"], True), ("me", ["me", "her"], False), ("staff", [], False)],
)
def test_a_group_of_this_user_alone_may_write(
    name: str, members: list[str], ours: bool, own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in the homes of systems that give each user a group."""
    _is_open_to_the_group(own)
    monkeypatch.setattr(
        grp, "getgrgid", lambda group: grp.struct_group((name, "x", group, members))
    )
    monkeypatch.setattr(
        pwd,
        "getpwuid",
        lambda user: pwd.struct_passwd(("me", "x", user, own.stat().st_gid, "", str(own), "")),
    )
    assert is_ours(own / "cache" / "sumo_mcts" / "kernels-key") == ours


def test_a_home_that_does_not_exist(own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (own / "closed").write_text("")  # root could make a folder anywhere else
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(own / "closed" / "home"))
    assert folder_for("key", _quiet) == _fallback(own)


def test_links_and_folders_of_the_users_own_may_lie_on_the_way(own: Path) -> None:
    """A home on another disk; and others may add files to a folder with the sticky bit."""
    (own / "disk").mkdir()
    (own / "disk").chmod(0o1777)
    (own / "disk" / "mine").mkdir(mode=0o700)
    (own / "there").symlink_to(Path("disk"))
    (own / "cache").symlink_to(Path("there", "..", "there", "mine"))
    assert folder_for("key", _quiet) == own / "cache" / "sumo_mcts" / "kernels-key"


def _foreign(monkeypatch: pytest.MonkeyPatch, *paths: Path) -> None:
    """Make these look as if they belonged to somebody else."""
    real = Path.lstat

    def lstat(path: Path) -> os.stat_result:
        state = real(path)
        return os.stat_result((*state[:4], os.getuid() + 1, *state[5:])) if path in paths else state

    monkeypatch.setattr(Path, "lstat", lstat)


def test_what_belongs_to_somebody_else_is_not_used(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert folder_for("key", _quiet) == own / "cache" / "sumo_mcts" / "kernels-key"
    for place in (
        own / "cache",
        own / "cache" / "sumo_mcts",
        own / "cache" / "sumo_mcts" / "kernels-key",
    ):
        with monkeypatch.context() as patch:
            _foreign(patch, place)
            assert folder_for("key", _quiet) == _fallback(own)


def test_a_link_that_somebody_else_made_is_not_followed(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (own / "disk").mkdir(mode=0o700)
    (own / "cache").symlink_to(own / "disk")
    _foreign(monkeypatch, own / "cache")
    assert folder_for("key", _quiet) == _fallback(own)


@pytest.mark.parametrize("mode", [0o777, 0o702, None])
def test_where_somebody_was_there_first_the_folder_is_this_processs_alone(
    own: Path, mode: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the temporary folder anybody can make a folder with our name."""
    monkeypatch.setattr("tempfile.tempdir", str(own))
    monkeypatch.setattr("atexit.register", lambda *_: None)
    _is_file(own)
    _fallback(own).parent.mkdir(mode=0o700)
    if mode is None:
        _foreign(monkeypatch, _fallback(own).parent)
    else:
        _fallback(own).parent.chmod(mode)
    said: list[str] = []
    folder = folder_for("key", said.append)
    assert folder is not None
    assert folder.parent == own
    assert is_ours(folder)
    assert [line.startswith(NOTHING_KEPT) for line in said] == [True]
    assert not _fallback(own).exists()


def test_where_nothing_can_be_written_nothing_is_kept(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _is_file(own)
    monkeypatch.setattr("tempfile.tempdir", str(own / "cache"))
    monkeypatch.setenv("TMPDIR", str(own / "cache"))
    said: list[str] = []
    assert folder_for("key", said.append) is None
    assert [line.startswith(NOTHING_KEPT) for line in said] == [True]


def test_the_folder_of_a_process_goes_with_it(own: Path) -> None:
    """But not with a fork of it."""
    _is_file(own)
    (own / "tmp" / f"sumo_mcts-{os.getuid()}").write_text("")
    program = """
import os, sys
from sumo_mcts.numerics.kept import folder_for
folder = folder_for("key", lambda _: None)
if (child := os.fork()) == 0:
    sys.exit()
os.waitpid(child, 0)
print(folder, folder.is_dir())
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    folder, there = done.stdout.split()
    assert there == "True"
    assert Path(folder).parent == own / "tmp"
    assert not Path(folder).exists()


# --- its files ---


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "a.kernel"


def _write(file: Path, content: bytes) -> None:
    one = Kept(file)
    one.take(_waits)
    one.write(content)
    one.release()


def _waits(seconds: float) -> None:
    raise AssertionError("there is nothing to wait for")


def test_what_is_written_can_be_read(file: Path) -> None:
    assert Kept(file).read() is None
    assert not Kept(file).is_there()
    _write(file, b"some code")
    assert Kept(file).read() == b"some code"
    assert Kept(file).is_there()
    _write(file, b"other")
    assert Kept(file).read() == b"other"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600


@pytest.mark.parametrize(
    "damage",
    [
        lambda b: b"",
        lambda b: b[:10],
        lambda b: b[:-1],
        lambda b: b[:40] + b"?" + b[41:],
        lambda b: b + b"?",
        lambda b: b"\0" * 99,
    ],
)
def test_what_is_damaged_is_as_if_it_were_not_there(
    file: Path, damage: Callable[[bytes], bytes]
) -> None:
    _write(file, bytes(range(100)))
    file.write_bytes(damage(file.read_bytes()))
    assert Kept(file).read() is None


def test_a_folder_or_a_link_in_its_place_is_not_there_either(file: Path, tmp_path: Path) -> None:
    file.symlink_to(tmp_path / "target")
    _write(file, b"some code")
    assert not (tmp_path / "target").exists()
    file.unlink()
    file.mkdir()
    _write(file, b"some code")
    assert Kept(file).read() is None


def test_only_one_holds_the_lock_and_the_others_wait(file: Path) -> None:
    one, other = Kept(file), Kept(file)
    one.take(_waits)
    assert other.is_taken()
    assert not one.is_taken()
    waited: list[float] = []

    def waits(seconds: float) -> None:
        waited.append(seconds)
        if len(waited) == 3:
            one.write(b"some code")
            assert not other.is_there()  # it may be half of it
            one.release()

    other.take(waits)
    assert len(waited) == 3
    assert waited == sorted(waited)
    assert other.read() == b"some code"
    other.release()
    assert not one.is_taken()


def test_a_process_that_holds_the_lock_too_long_stops_nobody(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept, "LONGEST_WAIT_S", 0.2)
    one, other = Kept(file), Kept(file)
    one.take(_waits)
    other.take(lambda _: None)
    other.write(b"some code")  # without the lock nothing is written
    other.release()
    assert one.read() is None


HOLDER = """
import sys, time
from pathlib import Path
from sumo_mcts.numerics.kept import Kept
one = Kept(Path(sys.argv[1]))
one.take(print)
print("held", flush=True)
time.sleep(60)
"""


def test_the_lock_of_a_process_that_was_killed_is_free(file: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(file)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        assert Kept(file).is_taken()
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert not Kept(file).is_taken()
    assert Kept(file).read() is None


def test_on_a_full_disk_nothing_is_left(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = os.write

    def write(number: int, content: bytes) -> int:
        if len(content) < 50:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(number, content[:50])

    monkeypatch.setattr(os, "write", write)
    with pytest.raises(OSError, match="No space left"):
        _write(file, bytes(200))
    assert file.stat().st_size == 0
