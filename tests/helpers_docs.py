"""Examples in the documents as files."""

import re
from pathlib import Path

DOCS = Path(__file__).resolve().parent.parent / "docs"


def unpack(page: str, folder: Path) -> None:
    """Write every fenced example of a page that names a file after its language."""
    for name, text in re.findall(
        r"^```\w+ ([\w./]+)\n(.*?)^```",
        (DOCS / page).read_text(encoding="utf-8"),
        re.DOTALL | re.MULTILINE,
    ):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
