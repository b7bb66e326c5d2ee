"""Rebuild every NAME/NAME.net.xml from the plain XML sources beside it: python networks/build.py
[NAME]..."""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import sumo

NETWORKS = Path(__file__).resolve().parent
_GENERATED = re.compile(r"<!-- generated on .*?-->\s*", re.DOTALL)


def names() -> list[str]:
    """Every network that has sources here."""
    return sorted(path.stem for path in NETWORKS.glob("*/*.netccfg"))


def built(name: str) -> str:
    """The text of the network as netconvert builds it now, without the comment that holds date and
    paths. Raises CalledProcessError."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "built.net.xml"
        command = [
            str(Path(sumo.SUMO_HOME) / "bin" / "netconvert"),
            "-c",
            f"{name}.netccfg",
            "-o",
            str(output),
        ]
        subprocess.run(command, cwd=NETWORKS / name, check=True, capture_output=True, text=True)
        return _GENERATED.sub("", output.read_text(encoding="utf-8"))


def net_path(name: str) -> Path:
    """Where the built network lies."""
    return NETWORKS / name / f"{name}.net.xml"


def main() -> None:
    """Rebuild the networks named on the command line, or all."""
    for name in sys.argv[1:] or names():
        net_path(name).write_text(built(name), encoding="utf-8")
        print(f"built {net_path(name)}")


if __name__ == "__main__":
    main()
