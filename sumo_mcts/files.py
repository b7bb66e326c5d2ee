"""Reads files that may hold anything: only regular ones, only so many bytes, packed or not."""

import errno
import os
import stat
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO
from xml.parsers import expat

_MISSING = "no such file"
_CHUNK = 1 << 16  # bytes read at a time
_GZIP = b"\x1f\x8b"  # how a packed file begins
_GZIP_FORMAT = 16 + zlib.MAX_WBITS
_LOOKED_AT = 1 << 20  # bytes in which the root element of an XML file has to begin
_KINDS = (
    (stat.S_ISDIR, "a folder, not a file"), (stat.S_ISFIFO, "a pipe, not a file"),
    (stat.S_ISSOCK, "a socket, not a file"),
    (stat.S_ISCHR, "a device, not a file"), (stat.S_ISBLK, "a device, not a file"),
)  # fmt: skip


def problem(path: str | Path) -> str:
    """Why a file cannot be read, in a few words; "" where this user may read it.

    Only a regular file can be read. Nothing is opened.
    """
    try:
        mode = Path(path).stat().st_mode
    except FileNotFoundError:
        return _MISSING
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    except ValueError:  # a name with a NUL
        return _MISSING
    if not stat.S_ISREG(mode):
        return next(
            (words for is_kind, words in _KINDS if is_kind(mode)), "something else, not a file"
        )
    return "" if os.access(path, os.R_OK) else f"cannot be read: {os.strerror(errno.EACCES)}"


def absolute(path: Path) -> Path:
    """The path with its links followed. Loops and impossible names stay: `problem` reports them."""
    try:
        return path.resolve()
    except (OSError, RuntimeError, ValueError):
        return path.absolute()


@contextmanager
def naming(path: Path, temporary: Path | None = None) -> Iterator[None]:
    """Every OSError that is raised inside names a file.

    That is `path` if the error names no file, as with a full disk. It is also `path` if the error
    names the `temporary` file that was to replace it.
    """
    try:
        yield
    except OSError as error:
        if error.errno is None:  # of a library, in its own words
            raise OSError(errno.EIO, " ".join(str(error).split()), str(path)) from None
        if error.filename is None or str(error.filename) == str(temporary):
            error.filename = str(path)
            error.filename2 = None
        raise


@contextmanager
def opened(path: str | Path) -> Iterator[BinaryIO]:
    """A regular file for reading: a folder, a pipe or a device may never end.

    Raises OSError that names it and whose `strerror` says what is wrong.
    """
    with naming(Path(path)):
        why = problem(path)
        if why:
            raise OSError(errno.ENOENT if why == _MISSING else errno.EINVAL, why, str(path))
        with Path(path).open("rb") as file:
            yield file


def between(text: str, begin: str, end: str, content: str) -> str:
    """The text of a document with other content between two marks.

    Raises ValueError where a mark is missing or there twice.
    """
    before, rest = text.split(begin)
    _, after = rest.split(end)
    return f"{before}{begin}\n\n{content}\n\n{end}{after}"


def content(path: str | Path, most: int) -> bytes:
    """The bytes of a regular file.

    Raises OSError whose `strerror` says what is wrong, also where there are more than `most`.
    """
    with opened(path) as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise _broken(path, f"more than {most:_} bytes".replace("_", " "))
    return data


def unpacked(path: str | Path, most: int) -> Iterator[bytes]:
    """The content of a regular file, in chunks of about 64 kB; it ends after `most` bytes.

    What is packed with gzip is unpacked. Raises OSError as `content` does, also where the archive
    is damaged or cut off.
    """
    with opened(path) as file:
        chunk = file.read(_CHUNK)
        pump = _Gzip(path) if chunk.startswith(_GZIP) else None
        left = most
        while chunk and left > 0:
            for part in (chunk,) if pump is None else pump.parts(chunk):
                yield part[:left]
                left -= len(part)
                if left <= 0:
                    return
            chunk = file.read(_CHUNK)
        if pump is not None and not chunk:
            pump.require_end()


def require_whole(path: str | Path, most: int) -> None:
    """Raise OSError where a file that is packed with gzip is damaged, cut off, or more than `most`
    bytes when unpacked."""
    with opened(path) as file:
        if file.read(len(_GZIP)) != _GZIP:
            return
    if sum(len(part) for part in unpacked(path, most + 1)) > most:
        raise _broken(path, f"unpacks to more than {most >> 20} MB")


def beginning(path: str | Path, most: int) -> bytes:
    """The first `most` bytes of a file, unpacked. Raises OSError as `unpacked` does."""
    return b"".join(unpacked(path, most))


def xml_root(path: str | Path) -> str:
    """The name of the root element of an XML file, packed or not.

    Raises OSError as `unpacked` does, ValueError where it is no XML, or declares entities.
    """
    looker = _RootLooker()
    for chunk in unpacked(path, _LOOKED_AT):
        looker.feed(chunk)
        if looker.root:
            return looker.root
    raise ValueError("no element is found")


class _RootLooker:
    """Reads XML up to its first element."""

    def __init__(self) -> None:
        self.root = ""
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self._element
        self._parser.EntityDeclHandler = self._entity

    def feed(self, chunk: bytes) -> None:
        """Raises ValueError where this is no XML."""
        try:
            self._parser.Parse(chunk, False)
        except expat.ExpatError as error:
            if not self.root:  # SUMO reads what follows
                raise ValueError(str(error)) from None
        except (LookupError, TypeError) as error:  # an encoding that Python does not support
            raise ValueError(str(error)) from None

    def _element(self, name: str, _: object) -> None:
        self.root = self.root or name.rpartition(":")[2]

    def _entity(self, *_: object) -> None:
        raise ValueError("entities may not be declared")


class _Gzip:
    """Unpacks chunk by chunk: a few packed bytes may stand for gigabytes."""

    def __init__(self, path: str | Path) -> None:
        self._path, self._inner = path, zlib.decompressobj(_GZIP_FORMAT)

    def parts(self, packed: bytes) -> Iterator[bytes]:
        """What a piece of the archive holds, in parts. Raises OSError where it is damaged."""
        while packed:
            if self._inner.eof:  # archives may stand one behind the other
                packed = packed.lstrip(b"\0")  # ... with padding between
                if not packed:
                    return
                self._inner = zlib.decompressobj(_GZIP_FORMAT)
            try:
                part = self._inner.decompress(packed, _CHUNK)
            except zlib.error:
                raise _broken(self._path, "a damaged archive") from None
            yield part
            packed = self._inner.unconsumed_tail or self._inner.unused_data

    def require_end(self) -> None:
        """Raise OSError where the archive is not whole."""
        if not self._inner.eof:
            raise _broken(self._path, "an archive that is cut off")


def _broken(path: str | Path, why: str) -> OSError:
    return OSError(errno.EINVAL, why, str(path))
