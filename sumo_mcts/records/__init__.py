"""What episodes leave behind in a folder: rows, manifests, traces and maps.

Each module describes its part; these are the names that the rest of the package uses.
"""

from sumo_mcts.records.codec import TraceError
from sumo_mcts.records.layout import (
    FIGURES,
    MANIFEST,
    MANIFESTS,
    MAPS,
    MOMENTS,
    ROWS,
    SCHEMA_VERSION,
    TABLE,
    TRACES,
)
from sumo_mcts.records.manifest import (
    read_manifest,
    read_manifest_of,
    write_manifest,
    write_manifest_of,
)
from sumo_mcts.records.measures import ROW_KEYS, Row
from sumo_mcts.records.provenance import versions
from sumo_mcts.records.rows import (
    append_row,
    complete_row,
    episode_key,
    put_row,
    read_rows,
    rows_and_torn,
    write_csv,
)
from sumo_mcts.records.trace import (
    CycleRecord,
    Lanes,
    Setting,
    Trace,
    load_map,
    load_trace,
    map_bytes,
    map_name,
    require_fit,
    same,
    save_map,
    save_trace,
    scenario_of,
    trace_bytes,
)
from sumo_mcts.records.writing import json_text, write_table, write_whole, written_whole

__all__ = [
    "FIGURES",
    "MANIFEST",
    "MANIFESTS",
    "MAPS",
    "MOMENTS",
    "ROWS",
    "ROW_KEYS",
    "SCHEMA_VERSION",
    "TABLE",
    "TRACES",
    "CycleRecord",
    "Lanes",
    "Row",
    "Setting",
    "Trace",
    "TraceError",
    "append_row",
    "complete_row",
    "episode_key",
    "json_text",
    "load_map",
    "load_trace",
    "map_bytes",
    "map_name",
    "put_row",
    "read_manifest",
    "read_manifest_of",
    "read_rows",
    "require_fit",
    "rows_and_torn",
    "same",
    "save_map",
    "save_trace",
    "scenario_of",
    "trace_bytes",
    "versions",
    "write_csv",
    "write_manifest",
    "write_manifest_of",
    "write_table",
    "write_whole",
    "written_whole",
]
