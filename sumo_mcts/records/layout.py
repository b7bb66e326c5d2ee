"""The files in a folder of results.

manifest.json        what the last run or the batch was made with
manifests/KEY.json   the same of one episode, as `run` writes it
episodes.jsonl       the rows, a line for each ego of each episode
episodes.csv         the same as a table
traces/KEY.npz       every decision of one ego
maps/MAP.npz         the roads to which traces refer
figures/KEY.png      and .gif, .mp4, --moments.png: drawings
"""

MANIFEST, ROWS, TABLE = "manifest.json", "episodes.jsonl", "episodes.csv"
MANIFESTS, TRACES, MAPS, FIGURES = "manifests", "traces", "maps", "figures"
MOMENTS = "--moments.png"  # the end of the name of a drawing of chosen moments
SCHEMA_VERSION = 1  # of manifests and of what --json prints
