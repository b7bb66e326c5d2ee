"""Where results come from: the versions of all code that made them."""

import functools
import hashlib
import platform
from importlib import metadata
from pathlib import Path

from sumo_mcts import files

PACKAGES = {"sumo_mcts": "sumo-mcts", "sumo": "libsumo", "numpy": "numpy", "numba": "numba"}


def versions() -> dict[str, str | None]:
    """Versions of the packages, the Python and the platform that run this; null where a package is
    not installed."""
    return {
        **{name: _version(package) for name, package in PACKAGES.items()},
        "sources": sources(),
        "python": platform.python_version(),
        "platform": platform.platform(),
    }


@functools.cache
def sources() -> str:
    """A digest of the whole package's code: a version number outlives many changes."""
    folder = Path(files.__file__).resolve().parent
    return hashlib.sha256(
        b"".join(path.read_bytes() for path in sorted(folder.rglob("*.py")))
    ).hexdigest()[:16]


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
