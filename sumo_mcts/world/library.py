"""The one import of libsumo, and what to install where it cannot be loaded."""

from typing import Any

from sumo_mcts.errors import ConfigError

# What each shared library that libsumo asks for is called in Debian and Ubuntu.
_PACKAGES = {
    "libGL.so": "libgl1",
    "libX11.so": "libx11-6",
    "libXext.so": "libxext6",
    "libXrender.so": "libxrender1",
    "libatomic.so": "libatomic1",
}


def import_libsumo() -> Any:
    """The libsumo module.

    Raises ConfigError that says which package to install where a system library is missing.
    """
    try:
        import libsumo  # type: ignore[import-untyped]
    except ImportError as error:
        package = next((name for library, name in _PACKAGES.items() if library in str(error)), None)
        hint = f"; install it with: apt-get install {package}" if package else ""
        raise ConfigError(f"libsumo cannot be loaded: {error}{hint}") from None
    return libsumo
