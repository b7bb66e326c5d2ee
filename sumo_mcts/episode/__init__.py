"""One episode: the loop that steps SUMO, and what it leaves behind."""

from sumo_mcts.episode.run import EpisodeResult, run_episode

__all__ = ["EpisodeResult", "run_episode"]
