"""Experiments: many episodes under several variants, from one file into one folder."""

from sumo_mcts.experiments.batch import run_batch

__all__ = ["run_batch"]
