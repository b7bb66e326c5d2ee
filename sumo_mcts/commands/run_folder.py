"""What `run --out` leaves: rows, traces, manifests and pictures, and nothing of what is there is
lost."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from sumo_mcts import records
from sumo_mcts.commands import run_key
from sumo_mcts.episode.run import EpisodeResult
from sumo_mcts.experiments import folder as batch_folder
from sumo_mcts.records import MOMENTS, Row
from sumo_mcts.scenarios import Note

PATIENCE_S = 20.0  # for another run that writes into the same folder


class Kept(NamedTuple):
    """What was kept of a run."""

    result: EpisodeResult  # under the keys that it has in the folder
    remarks: tuple[str, ...]  # for a person: what was replaced, or renamed
    files: tuple[Path, ...]  # the files to open first


def keep(result: EpisodeResult, out: Path, command: Sequence[str]) -> Kept:
    """Write map, traces, manifests and rows into a folder.

    `command`: the words behind `sumo-mcts`, for the manifest. Raises OSError, and ConfigError where
    another run does not finish.
    """
    manifest = {**result.manifest, "command": ["sumo-mcts", *command]}
    with batch_folder.only_here(out, PATIENCE_S):
        there = {row["key"]: row for row in records.read_rows(out)}
        result, remarks = _placed(result, out, there)
        if result.traces and result.road is not None:
            records.save_map(out, result.road)
        (out / records.TRACES).mkdir(exist_ok=True)
        for trace in result.traces:
            records.save_trace(out / records.TRACES / f"{trace.key}.npz", trace)
        batch_folder.drop_traces(
            out, {row["key"] for row in result.rows} - {trace.key for trace in result.traces}
        )
        for row in result.rows:
            records.write_manifest_of(out, row["key"], manifest)
            if records.put_row(out, row):
                remarks.append(f"{out}: {row['key']}: its earlier row is replaced")
                _drop_pictures(out, row, there[row["key"]])
        records.write_csv(out)
        records.write_manifest(out, manifest)
    return Kept(result, tuple(remarks), (out / records.TABLE, out / records.MANIFEST))


def _placed(
    result: EpisodeResult, out: Path, there: Mapping[str, Row]
) -> tuple[EpisodeResult, list[str]]:
    """The result under keys of its own in the folder, and remarks for a person.

    `there`: the rows of the folder by key. Where they are of another scenario of the same name,
    with other settings or files, those rows stay and the result gets another name.
    """
    identity, first = result.manifest["identity"], result.rows[0]
    of_name = (
        records.read_manifest_of(out, key).get("identity")
        for key, row in there.items()
        if row["scenario"] == first["scenario"]
    )
    known = next((each for each in of_name if each), identity)
    untold = [
        row
        for row in result.rows
        if row["key"] in there and not records.read_manifest_of(out, row["key"])
    ]
    if known == identity and all(
        there[row["key"]].get("config_digest") == row["config_digest"] for row in untold
    ):
        return result, []
    name = f"{first['scenario']}.{identity[:8]}"
    remark = (
        f"{out}: holds another scenario {first['scenario']}, of other settings or files; this "
        f"one is kept as {name}"
    )
    return run_key.keyed(result, name, named=run_key.names_ego(first)), [remark]


def _drop_pictures(out: Path, row: Row, before: Row) -> None:
    """Remove the pictures of an earlier row, unless they show the same drive."""
    if row["trace_digest"] != before.get("trace_digest"):
        for end in (".png", ".gif", ".mp4", MOMENTS):
            (out / records.FIGURES / f"{row['key']}{end}").unlink(missing_ok=True)


def draw(result: EpisodeResult, out: Path, note: Note) -> list[Path]:
    """Draw a storyboard and an animation of each ego's drive into a folder; the files.

    Raises OSError.
    """
    from sumo_mcts.reporting import animation, storyboard

    (out / records.FIGURES).mkdir(exist_ok=True)
    shown = []
    for trace in result.traces:
        picture, film = (out / records.FIGURES / f"{trace.key}.{form}" for form in ("png", "gif"))
        note("drawing the storyboard")
        storyboard.storyboard(trace, picture)
        animation.animation(trace, film, note=note)
        shown += [picture, film]
    return shown
