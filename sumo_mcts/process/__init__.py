"""The process of a command: how it is watched (supervisor.py) and how it ends (ending.py)."""
